"""Coordinates that are means over a window lie off to the side on a slanting wall, and that is taken out."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.arrays import FloatArray
from calibration.geometry.bundle_unknowns import PlanarScene
from calibration.geometry.flat.averaging import without_averaging
from calibration.geometry.pinhole import PinholeModel
from calibration.geometry.planes import Axes

FOCAL_PX, CENTRE_PX = 120.0, np.array([159.5, 119.5])
BASELINE = np.array([1.0, 0.1, -0.2])
WALL = np.array([0.9, 0.0, 0.5]) / 1.8
"""Normal over offset: it slants by 60 degrees."""
WINDOW = np.stack(np.meshgrid(np.arange(-4, 5), np.arange(-4, 5)), axis=-1).reshape(-1, 2).astype(np.float64)
WINDOW_PX2 = (9**2 - 1) / 12


def landed(camera_xy_px: FloatArray) -> FloatArray:
    """Where the projector, which looks along the camera's axis, lights what pixels see of the wall; by hand."""
    rays = np.concatenate([(camera_xy_px - CENTRE_PX) / FOCAL_PX, np.ones((len(camera_xy_px), 1))], axis=1)
    points = rays / (rays @ WALL)[:, None] - BASELINE
    return np.asarray(1.5 * FOCAL_PX * points[:, :2] / points[:, 2:] + CENTRE_PX)


def device(focal_px: float, translation: FloatArray) -> PinholeModel:
    return PinholeModel(
        width_px=320,
        height_px=240,
        focal_px=(focal_px, focal_px),
        principal_point_px=(float(CENTRE_PX[0]), float(CENTRE_PX[1])),
        distortion=(0.0, 0.0, 0.0, 0.0, 0.0),
        rotation=np.eye(3),
        translation_m=translation,
    )


@pytest.fixture
def scene() -> PlanarScene:
    return PlanarScene(
        camera=device(FOCAL_PX, np.zeros(3)),
        projector=device(1.5 * FOCAL_PX, -BASELINE),
        planes=WALL[None],
        axes=Axes(np.eye(3), np.array([-1])),
    )


@pytest.fixture
def pixels() -> FloatArray:
    return np.random.default_rng(1).uniform((125, 40), (160, 200), (300, 2))


def test_means_over_a_window_become_what_its_middle_sees(scene: PlanarScene, pixels: FloatArray) -> None:
    means = np.mean([landed(pixels + step) for step in WINDOW], axis=0)
    off = np.abs(means - landed(pixels)).max(axis=1)
    assert np.median(off) > 0.003
    left = np.abs(without_averaging(pixels, means, scene, WINDOW_PX2) - landed(pixels)).max(axis=1)
    assert (left < 0.1 * off).all()


def test_what_no_window_averaged_stays_as_it_is(scene: PlanarScene, pixels: FloatArray) -> None:
    np.testing.assert_array_equal(without_averaging(pixels, landed(pixels), scene, 0.0), landed(pixels))


def test_points_on_no_wall_stay_as_they_are(scene: PlanarScene, pixels: FloatArray) -> None:
    elsewhere = landed(pixels) + 40.0
    np.testing.assert_array_equal(without_averaging(pixels, elsewhere, scene, WINDOW_PX2), elsewhere)
