"""Devices that change pictures on their own: a session names what they do, or is right in spite of it.

`benchmarks/calibration/meddling_devices.py` goes through forty such habits, this through a few.
"""

import json
import runpy
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from calibration.structured_light.correspondence import PixelReason
from rig.session import Session
from rig.stages.correspondence import load_correspondence

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


def test_what_is_seen_in_a_mirror_is_left_out(outcome: Outcome, tmp_path: Path) -> None:
    assert "| within |" in outcome("mirror on a wall")
    with Session.read(tmp_path / "mirror-on-a-wall") as session:
        mirrored = load_correspondence(session).reason == PixelReason.MIRRORED
    rows, columns = np.nonzero(mirrored)
    assert (rows.min(), rows.max()) == pytest.approx((100, 199), abs=4)
    assert (columns.min(), columns.max()) == pytest.approx((180, 279), abs=4)
    assert mirrored[100:200, 180:280].mean() > 0.9


def test_a_camera_that_sharpens_its_pictures_is_told_by_the_middles_of_checks(outcome: Outcome) -> None:
    assert "OUTSIDE" in (line := outcome("camera's sharpness"))
    assert "direct light by the middles of checks" in line


def test_a_camera_that_moved_among_the_steps_is_told_by_its_whites(outcome: Outcome) -> None:
    assert "standing still: displacement of white between two photographs: 2.1" in outcome(
        "camera moved by 2 px at frame 114"
    )


def test_a_camera_that_moved_among_the_stripes_is_told_by_a_pattern_and_its_inverse(outcome: Outcome) -> None:
    said = outcome("camera moved by 2 px at frame 84")
    assert "the picture moved by +2.0 px to the right and +0.8 px down between long-run-column-04 and " in said
    assert "long-run-column-03, the limit is 0.5 px" in said
    assert "begin a new session" in said


def test_a_camera_that_sinks_on_its_stand_is_told_by_its_whites(outcome: Outcome) -> None:
    assert "standing still: displacement of white between two photographs: 1." in outcome("camera creeps")


def test_somebody_who_lingers_among_the_pictures_of_checks_is_named(outcome: Outcome) -> None:
    assert "Somebody or something stood in the light" in outcome("somebody who lingers at frame 135")


def test_pictures_of_checks_that_somebody_walked_through_are_left_out(outcome: Outcome, tmp_path: Path) -> None:
    assert "| within |" in outcome("passer-by at frame 135")
    metrics = json.loads((tmp_path / "passer-by-at-frame-135" / "metrics.json").read_text("utf-8"))
    row = next(row for row in metrics["limits"] if row["what"] == "separation: pictures of checks left out")
    assert 2 <= row["value"] <= 5
    assert "checker-" in row["advice"]
    assert abs(metrics["truth"]["direct_bias_percent"]) < 0.5
    assert abs(metrics["truth"]["global_bias_percent"]) < 0.5


def test_somebody_who_walks_through_the_projectors_levels_is_named(outcome: Outcome) -> None:
    said = outcome("passer-by at frame 54")
    assert "refused (1): projector response" in said
    assert "level-128" in said
    assert "Somebody or something stood in the light" in said
