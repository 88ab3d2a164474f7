"""What a run of the device lab says at its end, whatever became of its suites."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

PASSES = "def test_that_passes(): pass\n"
OTHERS = "import pytest\ndef test_that_fails(): assert False\ndef test_to_skip(): pytest.skip('no reason')\n"
HANGS = "import time\ndef test_that_hangs(): time.sleep(3600)\n"
DIES = "import os\ndef test_that_dies(): os.kill(os.getpid(), 9)\n"
SCRIPTS = ("run", "machine", "kernel")


@pytest.fixture(scope="module")
def lab() -> Iterator[ModuleType]:
    """The lab's script, its folder on the path as when Python runs it."""
    sys.path.insert(0, str(Path(__file__).parent))
    try:
        yield importlib.import_module("run")
    finally:
        sys.path.pop(0)
        for name in SCRIPTS:
            sys.modules.pop(name, None)


def last_lines(lab: ModuleType, folder: Path, *suites: tuple[str, str, float]) -> list[str]:
    """Last lines of a run of suites on this machine: (name, source of its tests, time limit)."""
    outcomes = []
    for name, source, limit_s in suites:
        file = folder / f"test_{name}.py"
        file.write_text(source)
        suite = lab.Suite(name, (str(file),), limit_s=limit_s, machine=None)
        outcomes.append(lab.run_suite(suite, folder / name, no_kernel=""))
    lines: list[str] = lab.summary(outcomes)
    return lines


def test_suites_that_came_to_their_end_are_counted(lab: ModuleType, tmp_path: Path) -> None:
    lines = last_lines(lab, tmp_path, ("good", PASSES, 600), ("mixed", PASSES + OTHERS, 600))
    assert lines == ["device lab: tests failed in mixed (1)", "2 passed, 1 failed, 1 skipped"]


def test_a_suite_that_runs_out_of_time_is_told_apart_from_failures(lab: ModuleType, tmp_path: Path) -> None:
    short, counts = last_lines(lab, tmp_path, ("slow", HANGS, 5))
    assert short.startswith("device lab: cut short: slow after ")
    assert "out of time, which was 5 s" in short
    assert counts.startswith("0 passed, ")


def test_a_suite_whose_tests_died_is_told_apart_from_failures(lab: ModuleType, tmp_path: Path) -> None:
    short, counts = last_lines(lab, tmp_path, ("dead", DIES, 600))
    assert short.startswith("device lab: cut short: dead after 0 tests: killed")
    assert counts == "0 passed, 1 failed, 0 skipped"


def test_suites_without_a_kernel_say_so(lab: ModuleType, tmp_path: Path) -> None:
    outcome = lab.run_suite(lab.SUITES[0], tmp_path / "session", no_kernel="no kernel: apt knows none")
    assert lab.summary([outcome]) == [
        "device lab: cut short: session after 0 tests: no kernel: apt knows none",
        "0 passed, 1 failed, 0 skipped",
    ]


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({}, "its machine died before it began: the kernel was not loaded"),
        ({"began": ""}, "its machine died"),
        ({"began": "", "status": "124\n"}, "out of time, which was 60 s by its machine's clock"),
        ({"began": "", "status": "1\n"}, ""),
    ],
)
def test_what_a_machine_leaves_tells_how_it_ended(
    lab: ModuleType, tmp_path: Path, files: dict[str, str], said: str
) -> None:
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    assert sys.modules["machine"].ending_in(tmp_path, limit_s=60, by_itself=True).cut_short == said
