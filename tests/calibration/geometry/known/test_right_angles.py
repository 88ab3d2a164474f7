"""What rests on right angles that were promised: rooms whose walls stand askew, fitted as if they were square."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.geometry.bundle_residual import LandingError, rays_of
from calibration.geometry.bundle_unknowns import CAMERA, PROJECTOR, ROTATION
from calibration.geometry.known.right_angles import by_askew_walls
from calibration.geometry.pinhole import rotation_of
from calibration.geometry.plane_bundle import refit, transfer_of
from calibration.geometry.planes import USUAL_ASKEW_DEG, Axes
from calibration.geometry.stereo import calibrate_stereo
from calibration.geometry.support import plane_errors_px
from tests.calibration.geometry.test_contradictions import FACES, WALLS, true_scene

DRAWS = 30
NOISE_PX2 = 1e-6
"""Of an independent observation, against which data sheets are weighed."""
SLIGHTLY_DEG = 0.03
"""So little that errors are straight in it."""


def seen(room):
    """A corner of three square walls as its true devices see it, without noise: scene, points and axes."""
    bare = room.changed(faces=FACES, noise_px=0.0, edge_bias_px=0.0, outlier_share=0.0)
    scene, (x1, x2) = true_scene(room), bare.correspondences(12)
    errors = plane_errors_px(scene, x1, x2)
    near = errors.min(axis=0) < 1
    axes = Axes(room.camera.rotation.T, np.array([WALLS[face] for face in FACES]))
    return scene, x1[near], errors.argmin(axis=0)[near], axes


def fitted(room, askew_deg, seed):
    """A fit with right angles to walls that are each turned about the foot of the camera's perpendicular, by chance."""
    scene, x1, label, axes = seen(room)
    random = np.random.default_rng(seed)
    turned = []
    for plane in scene.planes:
        across = np.cross(plane / np.linalg.norm(plane), random.normal(size=3))
        across /= np.linalg.norm(across)
        tilt = np.radians(askew_deg) * np.hypot(*random.normal(size=2))
        turned.append(rotation_of(tilt * across) @ plane)
    x2 = transfer_of(scene.projector)(rays_of(scene.camera, x1), np.array(turned)[label])
    error = LandingError(x1=x1, x2=x2, label=label, axes=axes, nominal=room.nominal)
    return refit(error, scene.with_planes(scene.planes, axes), NOISE_PX2)


def test_fits_to_walls_askew_are_off_by_what_is_stated(room):
    """Lenses, and the turn of the devices against each other: rms of the draws over what is stated."""
    square = fitted(room, 0.0, 0)
    stated = np.sqrt(np.diag(by_askew_walls(square, SLIGHTLY_DEG)))[: ROTATION.stop]
    shifts = [(fitted(room, SLIGHTLY_DEG, seed).fit.z - square.fit.z)[: ROTATION.stop] for seed in range(DRAWS)]
    over = np.sqrt(np.mean(np.square(shifts), axis=0)) / stated
    assert np.median(over) == pytest.approx(1.0, abs=0.2)
    assert over == pytest.approx(1.0, abs=0.5)


def test_focal_lengths_are_what_rests_on_right_angles(room):
    """A corner seen as here moves them by some percent for a third of a degree, and leaves a hundredth of a pixel."""
    square, askew = (fitted(room, degrees, 1) for degrees in (0.0, USUAL_ASKEW_DEG))
    stated = np.sqrt(np.diag(by_askew_walls(square)))
    assert 0.01 < stated[CAMERA.start] == pytest.approx(stated[PROJECTOR.start], rel=0.2)
    assert askew.fit.residual.std() < 0.05


def test_twice_as_much_askew_is_twice_as_much_off(room):
    square = fitted(room, 0.0, 0)
    once, twice = (by_askew_walls(square, degrees) for degrees in (0.2, 0.4))
    assert twice == pytest.approx(4 * once, rel=1e-9)


def test_walls_that_are_taken_as_they_are_rest_on_no_right_angle(room):
    square = fitted(room, 0.0, 0)
    free = refit(
        replace(square.error, axes=square.with_planes(square.planes).axes), square.with_planes(square.planes), NOISE_PX2
    )
    assert not by_askew_walls(free).any()


def test_a_calibration_says_it_beside_its_own_uncertainty(room):
    pair = calibrate_stereo(*room.correspondences(8), room.nominal)
    known = pair.uncertainty
    assert known.askew.shape == known.covariance.shape
    assert known.askew[CAMERA.start, CAMERA.start] > 0
