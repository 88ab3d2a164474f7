"""The units of the pages under a real systemd, on a real display driver.

Runs in a device lab machine: `python tests/device_lab/machine.py 'python -m pytest THIS'`.
"""

import shutil
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.contract.lab import display_output, display_profile
from tests.device_lab.guest.rights import let_everybody_read_the_program
from tests.device_lab.guest.test_live import is_coloured
from tests.device_lab.programs import output_of
from tests.device_lab.waiting import wait_until
from tests.docs.units import unit_of

UNITS = Path("/run/systemd/system")
RIG = Path(sys.executable).with_name("rig")
WITHOUT_A_SYSTEM = "[Unit]\nDefaultDependencies=no\n"
"""What a system starts before its services takes an emulated processor minutes, and no show needs it."""
Systemctl = Callable[..., str]


@pytest.fixture(scope="module")
def systemctl() -> Iterator[Systemctl]:
    """Command a systemd that is the first process of a name space of its own, as in a container."""
    UNITS.mkdir(parents=True, exist_ok=True)
    (UNITS / "lab.target").write_text("[Unit]\nDescription=nothing but what is started by hand\n")
    Path("/etc/fstab").write_text("")
    groups = Path("/sys/fs/cgroup")
    if not (groups / "cgroup.procs").exists():
        output_of("mount", "-t", "cgroup2", "none", groups)
    own = ["unshare", "--fork", "--pid", "--mount-proc", "--mount", "--cgroup"]
    started = subprocess.Popen(
        ["env", "container=lab", *own, "/lib/systemd/systemd", "--unit=lab.target"], stdin=subprocess.DEVNULL
    )
    within = ["nsenter", "--pid", "--mount", "--cgroup", "--target"]

    def command(*words: str, may_fail: bool = False) -> str:
        number = output_of("pgrep", "-o", "-x", "systemd").strip()
        done = subprocess.run([*within, number, "systemctl", *words], capture_output=True, text=True, check=False)
        assert may_fail or done.returncode == 0, done.stderr + done.stdout
        return done.stdout

    def runs() -> bool:
        return started.poll() is None and "running" in command("is-system-running", may_fail=True).split()

    try:
        wait_until(lambda: shutil.which("pgrep") and _is_there("systemd"), "systemd")
        wait_until(runs, "systemd's answer", poll_s=0.5)
        yield command
    finally:
        started.kill()
        started.wait()


def _is_there(program: str) -> bool:
    return subprocess.run(["pgrep", "-x", program], stdout=subprocess.DEVNULL, check=False).returncode == 0


@pytest.fixture(scope="module")
def output() -> str:
    return display_output("vkms")


@pytest.fixture(scope="module")
def folder(output: str, systemctl: Systemctl) -> Path:
    """The show's folder, of a user who may open displays and nothing else."""
    folder = Path("/srv/show")
    (folder / "shows").mkdir(parents=True)
    (folder / "live.toml").write_bytes(display_profile("kms", output).raw)
    let_everybody_read_the_program()
    for group in ("video", "render", "input"):
        output_of("groupadd", "--force", "--system", group)
    output_of("useradd", "--system", "--home-dir", folder, "show")
    # What udev's rules give to real cards, which a machine without udev at its start has not seen.
    for card in Path("/dev/dri").glob("card*"):
        shutil.chown(card, group="video")
        card.chmod(0o660)
    return folder


def keep_show(folder: Path, text: str) -> None:
    (folder / "shows/lobby.toml").write_text(text)
    output_of("chown", "-R", "show", folder)


def state_of(systemctl: Systemctl, unit: str) -> dict[str, str]:
    shown = systemctl("show", unit, "-p", "ActiveState,Result,NRestarts,ExecMainStatus,MainPID")
    return dict(line.split("=", 1) for line in shown.splitlines())


def start(systemctl: Systemctl, name: str, unit: str) -> None:
    (UNITS / f"{name}.service").write_text(unit)
    (UNITS / f"{name}.service.d").mkdir(exist_ok=True)
    (UNITS / f"{name}.service.d/lab.conf").write_text(WITHOUT_A_SYSTEM)
    systemctl("daemon-reload")
    systemctl("start", name)


SHOW = 'profile = "../live.toml"\nstrategy = "none"\n'


def test_the_unit_of_a_kept_show_restarts_what_is_killed_and_ends_dark(
    systemctl: Systemctl, folder: Path, output: str
) -> None:
    keep_show(folder, SHOW)
    start(systemctl, "rig-show", unit_of("shows.md", ExecStart=f"{RIG} live --show lobby"))
    wait_until(lambda: is_coloured(output), "the picture", poll_s=0.5)
    first = state_of(systemctl, "rig-show")["MainPID"]
    systemctl("kill", "--signal=KILL", "rig-show")
    wait_until(lambda: state_of(systemctl, "rig-show")["NRestarts"] == "1", "the restart", poll_s=0.5)
    wait_until(lambda: is_coloured(output), "the picture", poll_s=0.5)
    again = state_of(systemctl, "rig-show")
    assert again["ActiveState"] == "active"
    assert again["MainPID"] != first
    systemctl("stop", "rig-show")
    # Not "failed": 143 is among the unit's good ends. The number itself is forgotten with a unit that nobody needs.
    assert state_of(systemctl, "rig-show")["ActiveState"] == "inactive"
    assert not is_coloured(output)
    assert (folder / "shows/lobby.log").stat().st_size > 0


def test_a_show_that_is_written_wrong_is_not_tried_for_ever(systemctl: Systemctl, folder: Path) -> None:
    keep_show(folder, SHOW + "gain = 100\n")
    start(systemctl, "rig-show", unit_of("shows.md", ExecStart=f"{RIG} live --show lobby"))
    wait_until(lambda: state_of(systemctl, "rig-show")["ActiveState"] == "failed", "the refusal", poll_s=0.5)
    assert state_of(systemctl, "rig-show")["ExecMainStatus"] == "2"
    assert state_of(systemctl, "rig-show")["NRestarts"] == "0"


def test_the_unit_of_the_page_starts_its_show_and_says_that_it_is_well(
    systemctl: Systemctl, folder: Path, output: str
) -> None:
    keep_show(folder, SHOW)
    port, token = 8021, "a-word-of-16-signs-or-more"
    serve = f"{RIG} serve {folder} --show lobby --host 0.0.0.0 --port {port} --token {token}"
    start(systemctl, "rig-page", unit_of("operators-page.md", ExecStart=serve, ReadWritePaths=str(folder)))
    wait_until(lambda: is_coloured(output), "the picture", poll_s=1.0)
    wait_until(lambda: health(port) == 200, "the page's word that all is well", poll_s=1.0)
    systemctl("stop", "rig-page")
    assert state_of(systemctl, "rig-page")["Result"] == "success"
    assert not is_coloured(output)


def health(port: int) -> int:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=60) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code
    except OSError:
        return 0
