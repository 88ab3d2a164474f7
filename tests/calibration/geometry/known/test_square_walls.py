"""Right angles held against the points: how sure a contradiction is, and which angle it is about."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.geometry.bundle_residual import LandingError, rays_of
from calibration.geometry.known.square_walls import angles_held, angles_of, check_right_angles
from calibration.geometry.noise import normal_deviate, observation_variance
from calibration.geometry.plane_bundle import Rounds, adjust_to_held_planes, refit, transfer_of
from calibration.geometry.planes import Axes
from calibration.geometry.support import plane_errors_px
from tests.calibration.geometry.test_contradictions import FACES, WALLS, true_scene


@pytest.mark.parametrize(("chi_squared", "freedom", "sigmas"), [(5.0, 5, 0.1), (20.5, 5, 3.1)])
def test_a_chi_squared_sum_is_told_in_sigmas(chi_squared, freedom, sigmas):
    assert normal_deviate(chi_squared, freedom) == pytest.approx(sigmas, rel=0.2, abs=0.3)


@pytest.mark.parametrize(
    ("of_plane", "angles"),
    [((0, 1, 2), 3), ((0, 1), 1), ((0, 0), 2), ((0, 0, 1, 2), 5), ((0, 1, -1), 1), ((-1, -1), 0), ((2,), 0)],
)
def test_right_angles_take_two_of_each_plane_less_those_by_which_all_turn(of_plane, angles):
    assert angles_held(Axes(np.eye(3), np.array(of_plane))) == angles


def square_and_free(room, seed, lean_deg=0.0):
    """Fits to a corner with right angles and without; codes are off by whole lines; the first wall leans."""
    bare = room.changed(faces=FACES, noise_px=0.04, edge_bias_px=0.0, outlier_share=0.0)
    scene, (x1, x2) = true_scene(room), bare.correspondences(12)
    errors = plane_errors_px(scene, x1, x2)
    near, label, random = errors.min(axis=0) < 1, errors.argmin(axis=0), np.random.default_rng(seed)
    wall, turn = scene.planes[0], np.radians(lean_deg)
    upright = room.camera.rotation @ np.array([0.0, 0.0, np.linalg.norm(wall)])
    middle = np.median(rays_of(scene.camera, x1[label == 0]), axis=0)
    leaning = np.cos(turn) * wall + np.sin(turn) * upright
    leaning *= (wall @ middle) / (leaning @ middle)
    there = np.where((label == 0)[:, None], transfer_of(scene.projector)(rays_of(scene.camera, x1), leaning), x2)
    line = np.repeat(random.normal(0, 0.03, (3, 2, 700)), 5, axis=2)
    off = np.stack([line[label, k, x2[:, k].astype(int)] for k in (0, 1)], axis=1)
    square = Axes(room.camera.rotation.T, np.array([WALLS[face] for face in FACES]))
    free = LandingError(
        x1=x1[near],
        x2=(there + off)[near],
        label=label[near],
        axes=scene.axes,
        nominal=room.nominal,
    )
    held = refit(replace(free, axes=square), scene.with_planes(scene.planes, square), 0.02)
    return held, refit(free, held.with_planes(held.planes), 0.02)


def test_true_right_angles_gain_by_chance_what_their_number_says(room):
    """Codes that are off by whole lines do not make them look wrong; nor may the test lose what it can see."""
    gains = []
    for seed in range(12):
        held, free = square_and_free(room, seed)
        check_right_angles(held, free)
        variance = observation_variance(free.fit, free.error.x1, free.fit_label)
        gains.append((held.fit.cost - free.fit.cost) / variance)
    assert 0.5 < np.mean(gains) / angles_held(held.axes) < 2.0


def test_a_wall_that_leans_is_refused_where_codes_are_off_by_lines(room):
    for lean_deg in (-0.5, 0.5):
        with pytest.raises(CalibrationError, match="the walls are not at right angles"):
            check_right_angles(*square_and_free(room, 1, lean_deg))


def test_a_wall_that_lost_all_its_points_stands_at_no_measured_angle(room):
    held, free = square_and_free(room, 1, 0.5)
    on = free.error.label != 1
    seen = {name: getattr(free.error, name)[on] for name in ("x1", "x2", "label")}
    free = refit(replace(free.error, **seen), free, 0.02)
    assert [np.isfinite(angle.sigma_deg) for angle in angles_of(free, [(0, 1), (0, 2)])] == [False, True]
    with pytest.raises(CalibrationError, match="right angles"):
        check_right_angles(held, free)


def test_walls_along_one_axis_that_are_not_parallel_are_refused(room):
    """No two of them are taken for perpendicular: there is no angle to name."""
    _, free = square_and_free(room, 1)
    along_one = Axes(room.camera.rotation.T, np.zeros(3, dtype=int))
    held = refit(replace(free.error, axes=along_one), free.with_planes(free.planes, along_one), 0.02)
    with pytest.raises(CalibrationError, match="which of the angles it is, the points leave open"):
        check_right_angles(held, free)


def test_points_that_are_on_none_of_the_walls_are_refused_with_their_number(room):
    """Not passed on as if they had been fitted: a wild rig went on with a start that nothing had held."""
    scene, (x1, x2) = true_scene(room), room.changed(faces=FACES).correspondences(28)
    off = x2 + np.random.default_rng(4).normal(0, 30, x2.shape)
    rounds = Rounds(limits_px=(1.0,), iterations=8)
    with pytest.raises(CalibrationError, match=f"fewer than 200 of {len(x1)} correspondences lie within 1 px"):
        adjust_to_held_planes(x1, off, scene, room.nominal, rounds=rounds, weight=np.ones_like(x2))
