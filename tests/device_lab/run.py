"""All suites of the device lab, each in its own fresh machine, some at a time: `make test-devices`.

    python tests/device_lab/run.py                # all
    python tests/device_lab/run.py kms vivid      # some
    python tests/device_lab/run.py --list

Ends with the suites that were cut short and why, and one line: how many tests passed, failed and were skipped; a suite
that was cut short counts as one failure more. Logs and machine-readable results stay in the folder that it names.
"""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from kernel import prepare_kernel
from machine import Ending, Machine, ending_of, limited, run_in_machine

ROOT = Path(__file__).parents[2]
PYTEST = "{python} -m pytest -p pytest_timeout -p no:cacheprovider -q --durations=5"
REPORTED = PYTEST + " --junitxml={results}/results-{number}.xml {tests}"
FEW_PLUGINS = {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
"""An emulated machine takes seconds to import one that no test of the lab needs."""
PROGRAMS = {
    "qemu-system-x86_64": "qemu-system-x86",
    "busybox": "busybox-static",
    "depmod": "kmod",
    "v4l2-ctl": "v4l-utils",
    "lsusb": "usbutils",
    "systemctl": "systemd",
    "pgrep": "procps",
    "Xvfb": "xvfb",
    "Xorg": "xserver-xorg-core xserver-xorg-video-dummy",
    "xrandr": "x11-xserver-utils",
    "xwd": "x11-apps",
    "xwininfo": "x11-utils",
    "weston": "weston",
}
"""What the lab calls, and Debian's package of it."""
DEFAULT = Machine()
ONE_MORE = 1
"""Machine than processors: each waits now and then, and none minds, for its time is its own."""
GIVES_WAY = 4
"""Niceness of all machines but the one that takes longest. Not more: beside a busy process of another program, which is
not nice, a machine of niceness 10 gets a tenth of a processor."""
COMPLETE = (0, 1)
"""pytest's exit statuses when all tests ran; 5, that there were none, is not among them."""


@dataclass(frozen=True)
class Suite:
    """Tests that share one machine. `tests`: pytest's arguments, a run each."""

    name: str
    tests: tuple[str, ...]
    limit_s: float = 900
    """By the clock of the machine that it runs on; the emulated ones' does not run on while the host is busy."""
    before: str = "true"
    """Shell command in the machine, before the tests."""
    machine: Machine | None = DEFAULT
    """None: on this machine itself."""


LAB = "tests/device_lab"
PATIENT = "--timeout=1800"
"""Where a test's time is real time, which other programs take from it."""
SUITES = (
    Suite("session", (f"{LAB}/guest/test_session.py -s",), limit_s=1800),
    Suite(
        "emulated",
        (
            f"tests/contract/test_camera.py tests/contract/test_projector.py tests/contract/test_rig.py "
            f"{LAB}/guest/test_emulated_rig.py -k emulated",
        ),
        before="export PROCAM_DEVICE_LAB_BACK_ENDS=emulated",
        limit_s=1500,
    ),
    Suite("systemd", (f"{LAB}/guest/test_systemd.py",)),
    Suite(
        "vivid",
        (f"{LAB}/guest/test_vivid.py", "tests/contract/test_camera.py"),
        before="export PROCAM_DEVICE_LAB_BACK_ENDS=vivid",
    ),
    Suite(
        "kms",
        (
            f"{LAB}/guest/test_kms.py",
            "tests/contract/test_projector.py tests/contract/test_rig.py -k 'vkms or virtio'",
        ),
        before="export PROCAM_DEVICE_LAB_BACK_ENDS=vkms,virtio-gpu",
        machine=Machine(displays=2),
    ),
    Suite("live", (f"{LAB}/guest/test_live.py",)),
    Suite("usb", (f"{LAB}/guest/test_usb.py {LAB}/guest/test_devices_verb.py",)),
    Suite("uvc", (f"{LAB}/guest/test_uvc.py {LAB}/guest/test_uvc_faults.py",)),
    Suite("uvc-rig", (f"{LAB}/guest/test_uvc_rig.py",)),
    Suite(
        "windows",
        (f"{LAB}/host {PATIENT}", f"tests/contract/test_projector.py tests/contract/test_rig.py {PATIENT}"),
        before="export PROCAM_DEVICE_LAB_BACK_ENDS=window",
        machine=None,
        limit_s=3600,
    ),
)
"""The longest first (1200, 700, 560, 400, 380, 300, 240, 200, 200 and 60 s where they shared two processors), or one of
these has nothing to do for the last one's minutes."""


@dataclass(frozen=True)
class Outcome:
    """What became of one suite; `cut_short` says why it did not come to its end, if it did not."""

    suite: Suite
    passed: int
    failed: int
    skipped: int
    cut_short: str

    @property
    def tests(self) -> int:
        return self.passed + self.failed + self.skipped


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--list", action="store_true", help="print the suites' names and stop")
    parser.add_argument("suites", nargs="*", help="names; default: all")
    given = parser.parse_args()
    known = {suite.name: suite for suite in SUITES}
    if given.list:
        print("\n".join(known))
        return 0
    unknown = set(given.suites) - set(known)
    if unknown:
        parser.error(f"no suite {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    _need_programs()
    no_kernel = _prepare_kernel()
    _compile()
    chosen = [known[name] for name in dict.fromkeys(given.suites)] or list(SUITES)
    results = Path(tempfile.mkdtemp(prefix="device-lab-"))
    began_s = time.monotonic()
    with ThreadPoolExecutor((os.cpu_count() or 1) + ONE_MORE) as executor:
        outcomes = list(executor.map(lambda suite: run_suite(suite, results / suite.name, no_kernel=no_kernel), chosen))
    print(f"device lab: logs in {results}; {time.monotonic() - began_s:.0f} s")
    print("\n".join(summary(outcomes)))
    return 1 if any(outcome.failed or outcome.cut_short for outcome in outcomes) else 0


def summary(outcomes: list[Outcome]) -> list[str]:
    """Return the last lines: suites that failed, suites that were cut short, and the counts."""
    failed = [f"{outcome.suite.name} ({outcome.failed})" for outcome in outcomes if outcome.failed]
    lines = [f"device lab: tests failed in {', '.join(failed)}"] if failed else []
    short = [outcome for outcome in outcomes if outcome.cut_short]
    for outcome in short:
        lines.append(f"device lab: cut short: {outcome.suite.name} after {outcome.tests} tests: {outcome.cut_short}")
    passed, skipped = sum(outcome.passed for outcome in outcomes), sum(outcome.skipped for outcome in outcomes)
    failures = sum(outcome.failed for outcome in outcomes) + len(short)
    return [*lines, f"{passed} passed, {failures} failed, {skipped} skipped"]


def _prepare_kernel() -> str:
    """Why there is no kernel; empty if there is one."""
    try:
        prepare_kernel()
    except SystemExit as problem:
        print(problem, file=sys.stderr)
        return f"no kernel: {str(problem).splitlines()[0]}"
    return ""


def _need_programs() -> None:
    missing = sorted({package for program, package in PROGRAMS.items() if shutil.which(program) is None})
    if missing:
        raise SystemExit(f"the device lab needs: apt-get install {' '.join(missing)}")


def _compile() -> None:
    """Compile all and collect the tests once on this machine, which keeps it: guests cannot, and are slow at it."""
    subprocess.run([sys.executable, "-m", "compileall", "-q", "calibration", "rig", "sim"], cwd=ROOT, check=True)
    command = [*PYTEST.format(python=sys.executable).split(), "--collect-only", LAB, "tests/contract"]
    environment = {**os.environ, **FEW_PLUGINS, "PROCAM_DEVICE_LAB": "1"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"the device lab's tests cannot be collected:\n{done.stdout}{done.stderr}")


def run_suite(suite: Suite, results: Path, *, no_kernel: str) -> Outcome:
    """Run one suite; its output goes to a file, and to the terminal as a whole when it is done."""
    results.mkdir()
    (results / "output.txt").touch()
    began_s = time.monotonic()
    if no_kernel and suite.machine is not None:
        ending = Ending(1, no_kernel)
    else:
        with (results / "output.txt").open("w") as output:
            ending = _run_command(suite, _command(suite, results), results, output.fileno())
    what = ending.cut_short or f"exit status {ending.status}"
    print(f"\n== {suite.name}: {time.monotonic() - began_s:.0f} s, {what}", flush=True)
    print((results / "output.txt").read_text(errors="replace"), flush=True)
    return _outcome(suite, ending, results)


def _command(suite: Suite, results: Path) -> str:
    """Shell command of all of a suite's runs of pytest; exits with the highest of their statuses.

    Interrupted, it waits for the run that is on, and begins no other.
    """
    inside = results if suite.machine is None else Path("/lab")
    command = "".join(f"export {name}={value}; " for name, value in FEW_PLUGINS.items())
    command += f"trap 'exit 130' INT; {suite.before} || exit 2; status=0; "
    for number, tests in enumerate(suite.tests):
        run = REPORTED.format(python=shlex.quote(sys.executable), results=inside, number=number, tests=tests)
        command += f"{run} || {{ now=$?; [ $now -le $status ] || status=$now; }}; "
    return command + "exit $status"


def _run_command(suite: Suite, command: str, results: Path, output: int) -> Ending:
    if suite.machine is not None:
        return run_in_machine(
            command,
            machine=suite.machine,
            limit_s=suite.limit_s,
            lab=results,
            cwd=ROOT,
            output=output,
            niceness=0 if suite is SUITES[0] else GIVES_WAY,
        )
    done = subprocess.run(
        [*limited(suite.limit_s), "sh", "-c", command],
        cwd=ROOT,
        env={**os.environ, "PROCAM_DEVICE_LAB": "1"},
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=output,
        check=False,
    )
    return ending_of(done.returncode, suite.limit_s)


def _outcome(suite: Suite, ending: Ending, results: Path) -> Outcome:
    reports = [root for file in sorted(results.glob("results-*.xml")) if (root := _parsed(file)) is not None]
    counts = {"tests": 0, "failures": 0, "errors": 0, "skipped": 0}
    for part in (part for report in reports for part in report.iter("testsuite")):
        for kind in counts:
            counts[kind] += int(part.get(kind, "0"))
    failed = counts["failures"] + counts["errors"]
    short = ending.cut_short
    if not short and (ending.status not in COMPLETE or len(reports) != len(suite.tests)):
        short = f"exit status {ending.status}, results of {len(reports)} of its {len(suite.tests)} runs"
    return Outcome(suite, counts["tests"] - failed - counts["skipped"], failed, counts["skipped"], short)


def _parsed(report: Path) -> ElementTree.Element | None:
    """None of a report that was not written to its end."""
    try:
        return ElementTree.parse(report).getroot()
    except ElementTree.ParseError:
        return None


if __name__ == "__main__":
    sys.exit(main())
