"""Devices that change pictures on their own: a session names what they do, or is right in spite of it.

`benchmarks/calibration/meddling_devices.py` goes through forty such habits, this through a few.
"""

import runpy
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
Outcome = Callable[[str], str]


@pytest.fixture
def outcome(tmp_path: Path) -> Iterator[Outcome]:
    """Return what became of a session of the tiny rig with a habit, by its name."""
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(ROOT / "benchmarks" / "calibration")
        bench = runpy.run_path(str(ROOT / "benchmarks" / "calibration" / "meddling_devices.py"))
        yield lambda name: str(bench["outcome"](name, ROOT / "hw_profiles" / "ci-tiny.toml", tmp_path))


@pytest.mark.parametrize("name", ["mirrored for rear projection", "mirrored camera"])
def test_a_mirrored_picture_is_called_mirrored(outcome: Outcome, name: str) -> None:
    assert "one of the pictures is mirrored" in outcome(name)


def test_a_projector_that_hangs_upside_down_is_no_fault(outcome: Outcome) -> None:
    assert "mirrored" not in outcome("upside down")
