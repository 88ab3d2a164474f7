"""All suites of the device lab, each in its own fresh machine, some at a time: `make test-devices`.

    python tests/device_lab/run.py                # all
    python tests/device_lab/run.py kms vivid      # some
    python tests/device_lab/run.py --list

Ends with one line: how many tests passed, failed and were skipped. Logs and machine-readable results stay in the
folder that it names.
"""

from __future__ import annotations

import argparse
import os
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
from machine import Machine, run_in_machine

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
GIVES_WAY = 10
"""Niceness of all machines but the one that takes longest."""


@dataclass(frozen=True)
class Suite:
    """Tests that share one machine. `tests`: pytest's arguments, a run each."""

    name: str
    tests: tuple[str, ...]
    timeout_s: float = 600
    before: str = "true"
    """Shell command in the machine, before the tests."""
    machine: Machine | None = DEFAULT
    """None: on this machine itself."""


LAB = "tests/device_lab"
SUITES = (
    Suite("session", (f"{LAB}/guest/test_session.py -s",), timeout_s=1800),
    Suite(
        "virtual",
        (
            f"tests/contract/test_camera.py tests/contract/test_projector.py tests/contract/test_rig.py "
            f"{LAB}/guest/test_virtual_rig.py -k virtual",
        ),
        before="export PROCAM_DEVICE_LAB_BACK_ENDS=virtual",
        timeout_s=900,
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
    Suite(
        "vivid",
        (f"{LAB}/guest/test_vivid.py", "tests/contract/test_camera.py"),
        before="export PROCAM_DEVICE_LAB_BACK_ENDS=vivid",
    ),
    Suite("uvc", (f"{LAB}/guest/test_uvc.py {LAB}/guest/test_uvc_faults.py",)),
    Suite("live", (f"{LAB}/guest/test_live.py",)),
    Suite("uvc-rig", (f"{LAB}/guest/test_uvc_rig.py",)),
    Suite("usb", (f"{LAB}/guest/test_usb.py {LAB}/guest/test_devices_verb.py",)),
    Suite(
        "windows",
        (f"{LAB}/host", "tests/contract/test_projector.py tests/contract/test_rig.py"),
        before="export PROCAM_DEVICE_LAB_BACK_ENDS=window",
        machine=None,
    ),
)
"""The longest first."""


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
    prepare_kernel()
    _compile()
    chosen = [known[name] for name in given.suites] or list(SUITES)
    results = Path(tempfile.mkdtemp(prefix="device-lab-"))
    began_s = time.monotonic()
    with ThreadPoolExecutor((os.cpu_count() or 1) + ONE_MORE) as executor:
        codes = list(executor.map(lambda suite: _run(suite, results / suite.name), chosen))
    return _summary(chosen, codes, results, time.monotonic() - began_s)


def _need_programs() -> None:
    missing = sorted({package for program, package in PROGRAMS.items() if shutil.which(program) is None})
    if missing:
        raise SystemExit(f"the device lab needs: apt-get install {' '.join(missing)}")


def _compile() -> None:
    """Collect all tests once on this machine, which keeps what it compiles: the guests cannot, and are slow at it."""
    command = [*PYTEST.format(python=sys.executable).split(), "--collect-only", LAB, "tests/contract"]
    environment = {**os.environ, **FEW_PLUGINS, "PROCAM_DEVICE_LAB": "1"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"the device lab's tests cannot be collected:\n{done.stdout}{done.stderr}")


def _run(suite: Suite, results: Path) -> int:
    """Run one suite; its output goes to a file, and to the terminal as a whole when it is done."""
    results.mkdir()
    inside = results if suite.machine is None else Path("/lab")
    runs = [
        REPORTED.format(python=sys.executable, results=inside, number=number, tests=tests)
        for number, tests in enumerate(suite.tests)
    ]
    command = "".join(f"export {name}={value}; " for name, value in FEW_PLUGINS.items())
    command += f"{suite.before} || exit 1; status=0; " + "; ".join(f"{run} || status=1" for run in runs)
    command += "; exit $status"
    began_s = time.monotonic()
    with (results / "output.txt").open("w") as output:
        code = _run_command(suite, command, results, output.fileno())
    print(f"\n== {suite.name}: {time.monotonic() - began_s:.0f} s, exit status {code}", flush=True)
    print((results / "output.txt").read_text(errors="replace"), flush=True)
    return code


def _run_command(suite: Suite, command: str, results: Path, output: int) -> int:
    if suite.machine is not None:
        return run_in_machine(
            command,
            machine=suite.machine,
            timeout_s=suite.timeout_s,
            lab=results,
            cwd=ROOT,
            output=output,
            niceness=0 if suite is SUITES[0] else GIVES_WAY,
        )
    environment = {**os.environ, "PROCAM_DEVICE_LAB": "1"}
    try:
        done = subprocess.run(
            ["sh", "-c", command],
            cwd=ROOT,
            env=environment,
            stdout=output,
            stderr=output,
            timeout=suite.timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return 124
    return done.returncode


def _summary(suites: list[Suite], codes: list[int], results: Path, elapsed_s: float) -> int:
    totals = {"tests": 0, "failures": 0, "errors": 0, "skipped": 0}
    broken = []
    for suite, code in zip(suites, codes, strict=True):
        files = sorted((results / suite.name).glob("results-*.xml"))
        if code not in (0, 1) or len(files) != len(suite.tests):
            broken.append(suite.name)
        for file in files:
            for part in ElementTree.parse(file).getroot().iter("testsuite"):
                for key in totals:
                    totals[key] += int(part.get(key, "0"))
    failed = totals["failures"] + totals["errors"]
    print(f"device lab: logs in {results}; {elapsed_s:.0f} s")
    for name in broken:
        print(f"device lab: suite {name} did not come to its end")
    skipped = totals["skipped"]
    passed = totals["tests"] - failed - skipped
    print(f"{passed} passed, {failed + len(broken)} failed, {skipped} skipped")
    return 0 if not any(codes) and not broken else 1


if __name__ == "__main__":
    sys.exit(main())
