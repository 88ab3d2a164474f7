"""Walls allow a second room, with near and far exchanged: the likelier one is taken, or both are named."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.geometry.flat.depth_reversal import reversed_fit, reversed_scene, unheld_reversal
from calibration.geometry.flat.third_wall import WeighedPoints
from calibration.geometry.known import right_angles
from calibration.geometry.plane_search import candidates
from calibration.geometry.stereo import calibrate_stereo


def two_walls(room, projector_m=(2.764, 1.259, 4.184), **changes):
    """Of `random_rigs.py --kind small --rigs 1 --seed 9911`, without its ceiling."""
    camera = {
        "shape": (240, 320),
        "focal_px": 145.0,
        "principal_point_px": (158.8, 119.4),
        "distortion": (0.0, 0.0, 0.0, 0.0, 0.0),
        "position_m": (2.733, 0.986, 4.363),
        "look_at_m": (1.215, 2.286, 4.447),
    }
    projector = {
        "shape": (192, 256),
        "focal_px": 241.0,
        "principal_point_px": (127.2, 118.5),
        "distortion": (-0.065, 0.0, 0.0, 0.0, 0.0),
        "position_m": projector_m,
        "look_at_m": (1.132, 2.415, 4.147),
    }
    how = {"camera_hfov_deg": 94.8, "projector_hfov_deg": 54.6, "noise_px": 0.03, "outlier_share": 0.0} | changes
    return room.changed(camera=camera, projector=projector, size_m=(4.19, 3.204, 8.0), **how)


def shuffled(room, step_px=1):
    x1, x2 = room.correspondences(step_px)
    order = np.random.default_rng(0).permutation(len(x1))[:10_000]
    return WeighedPoints(x1[order], x2[order], np.ones((len(order), 2)))


def begun_inside_out(monkeypatch, wrong):
    """Let the search end in the other room."""
    monkeypatch.setattr(right_angles, "candidates", lambda *_, **__: iter([wrong]))


def side(pair_or_fit):
    """Where the projector is, in the camera's frame and baselines."""
    return pair_or_fit.projector.position_m / np.linalg.norm(pair_or_fit.projector.position_m)


def true_side(room):
    between = np.subtract(room.projector.position_m, room.camera.position_m)
    return room.camera.rotation @ between / np.linalg.norm(between)


@pytest.fixture(scope="module")
def seen(room):
    """Twice as far apart: there the pictures' perspective tells the two rooms apart."""
    return two_walls(room, projector_m=(2.795, 1.532, 4.005))


@pytest.fixture(scope="module")
def both(seen):
    """The fit to the room, and the one to its reversal, of the same points."""
    points = shuffled(seen)
    found = next(candidates(points.camera_xy_px, points.projector_xy_px, seen.nominal, right_angles=True))
    other = reversed_fit(found, points, seen.nominal)
    return points, *sorted((found, other), key=lambda fit: -side(fit) @ true_side(seen))


def test_the_other_room_explains_the_points_to_a_tenth_of_a_pixel(seen, both):
    _, right, reversed_ = both
    assert side(right) @ true_side(seen) > 0.98
    assert side(reversed_) @ true_side(seen) < -0.98
    assert reversed_.share > 0.99
    assert np.sqrt((reversed_.fit.residual**2).mean()) < 0.1


def test_a_search_that_ended_in_the_other_room_comes_back(seen, both, monkeypatch):
    points, _, wrong = both
    begun_inside_out(monkeypatch, wrong)
    pair = calibrate_stereo(points.camera_xy_px, points.projector_xy_px, seen.nominal)
    assert side(pair) @ true_side(seen) > 0.98


def test_what_noise_leaves_open_is_refused_with_both_rooms(room):
    noisy = two_walls(room, noise_px=0.4)
    points = shuffled(noisy)
    with pytest.raises(CalibrationError, match="two rooms explain the points equally well") as caught:
        calibrate_stereo(points.camera_xy_px, points.projector_xy_px, noisy.nominal)
    assert "show a strip of floor or ceiling" in str(caught.value)


@pytest.fixture(scope="module")
def corner(room):
    """Of `random_rigs.py --rigs 1 --seed 13003`: two walls and a floor, narrow lenses, one below the other."""
    devices = {
        "camera": {
            "shape": (480, 640),
            "focal_px": 509.2,
            "principal_point_px": (321.8, 241.5),
            "distortion": (0.0, 0.0, 0.0, 0.0, 0.0),
            "position_m": (3.112, 1.982, 1.129),
            "look_at_m": (1.631, 3.320, 1.002),
        },
        "projector": {
            "shape": (384, 512),
            "focal_px": 312.4,
            "principal_point_px": (256.6, 262.5),
            "distortion": (0.0, 0.0, 0.0, 0.0, 0.0),
            "position_m": (3.177, 1.826, 0.801),
            "look_at_m": (1.721, 3.132, 0.385),
        },
    }
    how = {"camera_hfov_deg": 64.3, "projector_hfov_deg": 80.6, "noise_px": 0.05, "outlier_share": 0.0}
    return room.changed(**devices, size_m=(3.948, 4.805, 2.391), **how)


@pytest.fixture(scope="module")
def both_corners(corner):
    points = shuffled(corner, step_px=3)
    found = next(candidates(points.camera_xy_px, points.projector_xy_px, corner.nominal, right_angles=True))
    other = reversed_fit(found, points, corner.nominal)
    return points, *sorted((found, other), key=lambda fit: -side(fit) @ true_side(corner))


def test_three_walls_seen_from_nearly_one_place_have_a_second_room_too(corner, both_corners):
    """The second is bought with lenses: focal lengths and axes that are far from their data sheets."""
    _, right, wrong = both_corners
    assert len(set(right.axes.of_plane.tolist())) == 3
    assert side(wrong) @ true_side(corner) < -0.95
    assert wrong.share > 0.95
    assert wrong.fit.priors.cost(wrong.fit.z) > 5 * right.fit.priors.cost(right.fit.z)


def test_a_search_that_took_a_corner_for_its_reversal_comes_back(corner, both_corners, monkeypatch):
    """Held alone, the wrong room is contradicted, too, but by a cause that is false: walls that are not square."""
    points, *_ = both_corners

    def inside_out(x1, x2, nominal, *, right_angles):
        found = next(candidates(x1, x2, nominal, right_angles=right_angles))
        other = unheld_reversal(found, WeighedPoints(x1, x2, np.ones_like(x1)), nominal)
        yield min((found, other), key=lambda fit: side(fit) @ true_side(corner))

    monkeypatch.setattr(right_angles, "candidates", inside_out)
    pair = calibrate_stereo(points.camera_xy_px, points.projector_xy_px, corner.nominal)
    assert side(pair) @ true_side(corner) > 0.98
    assert pair.camera.focal_px[0] == pytest.approx(509.2, rel=0.02)


def test_a_corner_with_parallax_has_no_second_room(room):
    points = shuffled(room, step_px=8)
    found = next(candidates(points.camera_xy_px, points.projector_xy_px, room.nominal, right_angles=True))
    assert reversed_fit(found, points, room.nominal) is None


def test_walls_along_one_axis_are_not_reversed(room):
    points = shuffled(room, step_px=8)
    found = next(candidates(points.camera_xy_px, points.projector_xy_px, room.nominal, right_angles=True))
    one = replace(found, axes=replace(found.axes, of_plane=np.where(found.axes.of_plane == 0, 0, -1)))
    assert reversed_scene(one, points.camera_xy_px, points.projector_xy_px) is None
