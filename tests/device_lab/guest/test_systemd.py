"""The units of the documentation, run by systemd in a container of its own: started, killed, stopped, refused."""

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest

from tests.device_lab.programs import output_of
from tests.device_lab.waiting import wait_until

ROOT = Path(__file__).parents[3]
UNITS = Path("/run/systemd/system")
SYSTEMD = "/usr/lib/systemd/systemd"
RIG = f"{sys.executable} -m rig"
Systemctl = Callable[..., str]
SHOW = 'profile = "ci-tiny"\nstrategy = "none"\n'


@dataclass(frozen=True)
class Documented:
    """A unit that a page shows, and where its show is."""

    page: str
    folder: Path
    show: str

    @property
    def text(self) -> str:
        """With this machine's Python in place of an installed program; everything else as it is documented."""
        text = (ROOT / "docs" / "how-to" / self.page).read_text(encoding="utf-8")
        unit = re.search(r"^```text\n(\[Unit\].*?)^```", text, re.MULTILINE | re.DOTALL)
        assert unit is not None
        made, count = re.subn(r"^ExecStart=\S+/bin/rig ", f"ExecStart={RIG} ", unit[1], flags=re.MULTILINE)
        assert count == 1
        return made.replace("[Service]\n", f"[Service]\nEnvironment=PYTHONPATH={ROOT}\n")

    @property
    def log(self) -> Path:
        """Which the show begins when it is prepared."""
        return self.folder / "shows" / f"{self.show}.log"


DOCUMENTED = [
    Documented("shows.md", Path("/srv/show"), "lobby"),
    Documented("operators-page.md", Path("/srv/rig"), "evening"),
]


@pytest.fixture(scope="module")
def systemctl() -> Iterator[Systemctl]:
    """Orders to a systemd that is the first process of a container, with the machine's own control groups."""
    UNITS.mkdir(parents=True, exist_ok=True)
    output_of("mount", "-t", "cgroup2", "none", "/sys/fs/cgroup")
    with Path("/etc/passwd").open("a", encoding="ascii") as users:
        users.write("show:x:1234:1234::/srv:/bin/sh\n")
    with Path("/etc/group").open("a", encoding="ascii") as groups:
        groups.write("show:x:1234:\n")
    (UNITS / "test.target").write_text("[Unit]\nDefaultDependencies=no\n")
    command = ("unshare", "--pid", "--mount", "--fork", "--mount-proc", SYSTEMD, "--system", "--unit=test.target")
    environment = {"container": "lab", "PATH": os.environ["PATH"]}
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL) as process:
        wait_until(lambda: Path("/run/systemd/private").exists())
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text(encoding="ascii")
        yield partial(output_of, "nsenter", "-t", children.split()[0], "-p", "-m", "systemctl")
        os.kill(int(children.split()[0]), signal.SIGKILL)


def told(systemctl: Systemctl, unit: str, what: str) -> str:
    return systemctl("show", "--value", "-p", what, unit).strip()


@pytest.mark.parametrize("documented", DOCUMENTED, ids=lambda one: one.page)
def test_a_show_is_begun_again_when_it_is_killed_ends_when_told_and_is_left_when_its_file_is_wrong(
    documented: Documented, systemctl: Systemctl
) -> None:
    unit = f"test-{documented.show}.service"
    (documented.folder / "shows").mkdir(parents=True)
    file = documented.folder / "shows" / f"{documented.show}.toml"
    file.write_text(SHOW)
    for path in (documented.folder, documented.folder / "shows", file):
        shutil.chown(path, "show", "show")
    (UNITS / unit).write_text(documented.text)
    output_of("systemd-analyze", "verify", str(UNITS / unit))
    systemctl("daemon-reload")
    systemctl("start", unit)
    wait_until(documented.log.exists)
    assert documented.log.owner() == "show"
    first = told(systemctl, unit, "MainPID")
    systemctl("kill", "--kill-whom=main", f"--signal={signal.SIGKILL.name}", unit)
    wait_until(
        lambda: told(systemctl, unit, "NRestarts") == "1" and told(systemctl, unit, "MainPID") not in ("0", first),
        poll_s=0.5,
    )
    documented.log.unlink()
    wait_until(documented.log.exists)
    systemctl("stop", unit)
    assert (told(systemctl, unit, "ActiveState"), told(systemctl, unit, "Result")) == ("inactive", "success")
    file.write_text("profile = ")
    systemctl("start", unit)
    wait_until(lambda: told(systemctl, unit, "ActiveState") in ("failed", "inactive"), poll_s=0.5)
    assert told(systemctl, unit, "ExecMainStatus") == "2"
