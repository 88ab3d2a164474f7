"""The kernel lands points on walls as its definition in numpy does, and its slopes are those of its landings."""

from dataclasses import replace

import numpy as np
import pytest

from calibration import _kernel
from calibration.geometry.bundle_residual import LandingError, rays_of
from calibration.geometry.bundle_unknowns import CAMERA, PlanarScene, devices_of, unknowns_of
from calibration.geometry.epipolar import models_of, nominal_unknowns
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.pinhole import (
    defined_image,
    fold_squared,
    image_of,
    lens_slope_units,
    lens_slopes,
    rotation_of,
)
from calibration.geometry.planes import Axes
from calibration.reference.landing import bearing_slopes, landing_errors, landing_slopes

NOMINAL = NominalIntrinsics.of(
    camera_shape=(480, 640), projector_shape=(384, 512), camera_hfov_deg=70, projector_hfov_deg=55
)
AXES = Axes(rotation_of([0.2, -0.3, 0.1]), np.array([0, -1, 2, 1]))
"""Of a scene whose second plane is free."""
POINTS = 300


def fitted(seed: int) -> tuple[LandingError, np.ndarray]:
    """Points on random walls, some of them behind the devices or where a lens folds back, and unknowns near them."""
    random = np.random.default_rng(seed)
    q = nominal_unknowns()
    q[8:11] = random.normal(scale=0.3, size=3)
    camera, projector = models_of(q, NOMINAL)
    planes = np.array([plane * random.uniform(0.1, 0.5) for plane in (AXES.directions + np.array([0, 0, 0.9]))])
    planes = np.insert(planes, 1, random.normal(size=3), axis=0)
    z = unknowns_of(PlanarScene(camera=camera, projector=projector, planes=planes, axes=AXES), NOMINAL)
    z += random.normal(scale=0.02, size=len(z))
    x1 = random.uniform((0, 0), (639, 479), size=(POINTS, 2))
    x2 = random.uniform((0, 0), (511, 383), size=(POINTS, 2))
    weight = random.uniform(0.2, 1, size=x2.shape)
    label = random.integers(0, len(planes), POINTS)
    return LandingError(x1=x1, x2=x2, label=label, axes=AXES, nominal=NOMINAL, weight=weight), z


@pytest.mark.parametrize("seed", range(8))
def test_points_land_as_defined(seed: int) -> None:
    error, z = fitted(seed)
    assert np.allclose(error(z), landing_errors(error, z), rtol=1e-9, atol=1e-9)
    one_weight = replace(error, weight=0.5)
    assert np.allclose(one_weight(z), landing_errors(one_weight, z), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_slopes_are_as_defined(seed: int) -> None:
    error, z = fitted(seed)
    assert np.allclose(error.jacobian(z), landing_slopes(error, z), rtol=1e-7, atol=1e-7)


def test_slopes_are_those_of_the_landings() -> None:
    """By central differences, of the points that land near the picture from before the devices."""
    error, z = fitted(3)
    near = (np.abs(error(z)).max(axis=1) < 500) & (np.abs(error.jacobian(z)).max(axis=(0, 2)) < 5000)
    slopes, step = error.jacobian(z), 1e-6
    assert near.sum() > 30
    for k, direction in enumerate(np.eye(len(z))):
        difference = (error(z + step * direction) - error(z - step * direction)) / (2 * step)
        scale = np.abs(difference[near]).max() + 1
        assert np.allclose(slopes[k, near], difference[near], rtol=1e-3, atol=1e-3 * scale), k


def test_bearings_move_as_defined() -> None:
    error, z = fitted(5)
    camera, _ = devices_of(z, NOMINAL)
    rays, units = rays_of(camera, error.x1), lens_slope_units(camera, z[CAMERA.start])
    expected = bearing_slopes(error.x1, rays, camera, units)
    assert np.allclose(lens_slopes(camera, error.x1, rays, units), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_pixels_of_points_are_as_defined(seed: int) -> None:
    """Also of such as lie behind, nowhere, in the device itself, or where the lens folds back."""
    random = np.random.default_rng(seed)
    points = random.normal(size=(500, 3))
    points[:3], points[3], points[4:9, 2] = np.nan, 0.0, 0.0
    lens = ((300.0, 310.0), (320.5, 700.0), random.normal(scale=0.1, size=5))
    assert np.allclose(image_of(points, *lens), defined_image(points, *lens), rtol=1e-10, atol=1e-9, equal_nan=True)
    assert np.array_equal(image_of(points.T.copy().T, *lens), image_of(points, *lens), equal_nan=True)


@pytest.mark.parametrize("seed", range(4))
def test_a_lens_folds_back_where_its_radius_first_falls(seed: int) -> None:
    for scale in (1.0, 0.1, 1e-3):
        k1, k2, k3 = np.random.default_rng(seed).normal(size=3) * (scale, scale**2, scale**3)
        roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])
        real = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)]
        assert fold_squared((k1, k2, 0.0, 0.0, k3)) == pytest.approx(real.min(initial=np.inf), rel=1e-9)


@pytest.mark.parametrize(
    ("k1", "k2", "k3", "fold"),
    [
        (0.0, 0.0, 0.0, np.inf),
        (0.1, 0.0, 0.0, np.inf),
        (-0.1, 0.0, 0.0, 1 / 0.3),
        (0.0, -0.2, 0.0, 1.0),
        (0.0, 0.0, -1 / 7, 1.0),
        (0.3, 0.2, 0.1, np.inf),
        (0.0, 0.0, 0.1, np.inf),
    ],
)
def test_lenses_of_one_term_fold_back_where_sums_by_hand_say(k1: float, k2: float, k3: float, fold: float) -> None:
    assert fold_squared((k1, k2, 0.0, 0.0, k3)) == pytest.approx(fold, rel=1e-12)


def test_points_of_no_plane_and_arrays_of_other_shapes_are_refused() -> None:
    error, z = fitted(0)
    with pytest.raises(ValueError, match="a label of no plane"):
        replace(error, label=error.label + 1)(z)
    with pytest.raises(ValueError, match="as many weights"):
        replace(error, label=error.label[1:])(z)
    with pytest.raises(ValueError, match="twelve numbers"):
        _kernel.land(
            bearings=rays_of(devices_of(z, NOMINAL)[0], error.x1),
            seen=error.x2,
            weight=np.ones_like(error.x2),
            label=error.label,
            planes=np.ones((4, 3)),
            optics=np.ones(9),
            pose=np.ones(11),
            fold=1.0,
            far=1e4,
            error=np.empty_like(error.x2),
        )
