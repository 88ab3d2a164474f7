"""Small pictures of walls many baselines away, where two walls differ by a few pixels of parallax."""

from contextlib import suppress

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.geometry import plane_bundle, plane_search
from calibration.geometry.contradictions import hold_against_all
from calibration.geometry.plane_bundle import Rounds, adjust
from calibration.geometry.stereo import calibrate_stereo

NOISE_PX = 0.03


@pytest.fixture(scope="module")
def far_corner(room):
    """A corner thirteen baselines away: `random_rigs.py --kind small --rigs 1 --seed 9724`."""
    camera = {
        "shape": (240, 320),
        "focal_px": 290.0,
        "principal_point_px": (160.0, 119.4),
        "distortion": (0.016, 0.023, -0.0003, 0.0005, 0.0),
        "position_m": (1.579, 4.561, 0.910),
        "look_at_m": (3.095, 3.267, 1.079),
        "roll_deg": 1.4,
    }
    projector = {
        "shape": (192, 256),
        "focal_px": 131.1,
        "principal_point_px": (126.8, 206.3),
        "distortion": (-0.026, -0.002, 0.0002, -0.0001, 0.0),
        "position_m": (1.232, 4.630, 0.925),
        "look_at_m": (2.436, 3.517, -0.221),
        "roll_deg": -4.3,
    }
    return room.changed(
        camera=camera,
        projector=projector,
        size_m=(6.394, 5.326, 2.464),
        camera_hfov_deg=56.7,
        projector_hfov_deg=88.96,
        noise_px=NOISE_PX,
        outlier_share=0.0,
    )


def test_a_wall_that_is_near_another_all_over_keeps_points(far_corner):
    pair = calibrate_stereo(*far_corner.correspondences(2), far_corner.nominal)
    walls = np.sqrt(np.diag(pair.uncertainty.covariance))[-len(pair.planes) :]
    assert len(pair.planes) == 4
    assert walls.max() < 0.1
    assert pair.projector.focal_px[0] == pytest.approx(far_corner.projector.focal_px, rel=0.02)


def test_one_device_before_the_other_is_tried_before_walls_are_called_curved(far_corner, monkeypatch):
    """Rig small-9713: no start by the essential matrix leads anywhere."""
    starts = plane_search.starts_by_lines

    def swapped(*of, ahead, bent=False):
        return starts(*of, ahead=False) if ahead and not bent else iter(())

    monkeypatch.setattr(plane_search, "starts_by_lines", swapped)
    x1, x2 = far_corner.correspondences(2)
    order = np.random.default_rng(0).permutation(len(x1))
    found = next(plane_search.candidates(x1[order], x2[order], far_corner.nominal, right_angles=True))
    assert found.share > 0.9


@pytest.fixture(scope="module")
def strip_of_floor(room):
    """Two walls, the ceiling, and a strip of floor below: of `random_rigs.py --rigs 1 --seed 13008`."""
    camera = {
        "shape": (480, 640),
        "focal_px": 407.7,
        "principal_point_px": (325.2, 232.8),
        "distortion": (0.006, -0.003, 0.0005, 0.0002, 0.0),
        "position_m": (4.085, 1.398, 1.132),
        "look_at_m": (2.279, 2.188, 1.470),
    }
    projector = {
        "shape": (384, 512),
        "focal_px": 259.0,
        "principal_point_px": (255.1, 247.3),
        "distortion": (-0.019, 0.0003, -0.0004, 0.0, 0.0),
        "position_m": (4.480, 1.281, 1.403),
        "look_at_m": (2.661, 2.090, 1.204),
    }
    how = {"camera_hfov_deg": 74.8, "projector_hfov_deg": 91.5, "noise_px": 0.04, "outlier_share": 0.0}
    return room.changed(camera=camera, projector=projector, size_m=(5.935, 3.193, 2.964), **how)


def test_a_floor_all_of_which_is_near_a_wall_keeps_points_below_a_ceiling(strip_of_floor):
    """The ceiling is parallel to it, but no strip of the same curved wall: it faces it."""
    x1, x2 = strip_of_floor.correspondences(3)
    order = np.random.default_rng(0).permutation(len(x1))[:10_000]
    start = next(plane_search.candidates(x1[order], x2[order], strip_of_floor.nominal, right_angles=True))
    fit = adjust(x1[order], x2[order], start, strip_of_floor.nominal, rounds=Rounds(limits_px=(1.0,), iterations=8))
    assert len(fit.planes) == 4
    assert np.bincount(fit.fit_label, minlength=4).min() > 20


def test_no_wall_is_left_standing_that_no_point_of_the_fit_holds(strip_of_floor, monkeypatch):
    """Where it stands is where the search happened to begin, and its sigma would be none."""
    x1, x2 = strip_of_floor.correspondences(3)
    order = np.random.default_rng(0).permutation(len(x1))[:10_000]
    x1, x2 = x1[order], x2[order]
    start = next(plane_search.candidates(x1, x2, strip_of_floor.nominal, right_angles=True))
    monkeypatch.setattr(plane_bundle, "_HALVINGS", 0)
    with suppress(CalibrationError):
        fit = hold_against_all(x1, x2, start, strip_of_floor.nominal, weight=np.ones_like(x2))
        assert np.bincount(fit.fit_label, minlength=len(fit.planes)).min() > 0
