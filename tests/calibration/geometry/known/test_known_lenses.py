"""Lenses that boards measured, as priors of the geometry: what they add, and how a wrong one is named."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.geometry.bundle_residual import LandingError
from calibration.geometry.bundle_unknowns import expected_lenses
from calibration.geometry.known.lenses import KnownLenses, MeasuredLens, ideal_pixels
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.planes import Axes
from calibration.geometry.stereo import calibrate_stereo
from calibration.lenses.lens import PARAMETERS, project_points, projection

RATIONAL = np.array([540.0, 542.0, 640.0, 470.0, -0.2, 0.05, 0.001, -0.0005, 0.002, 0.05, 0.01, 0.001])
SIGMAS = np.array([0.3, 0.3, 0.5, 0.5, 1e-3, 1e-3, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3, 1e-3])


def covariance(sigmas, correlation=0.9):
    """(12, 12), all parameters correlated alike."""
    together = np.full((len(PARAMETERS), len(PARAMETERS)), correlation)
    np.fill_diagonal(together, 1.0)
    return together * np.outer(sigmas, sigmas)


def rays(shape, focal_px):
    height, width = shape
    x, y = np.meshgrid(np.linspace(-0.45, 0.45, 9) * width, np.linspace(-0.45, 0.45, 7) * height)
    return np.column_stack([x.ravel() / focal_px, y.ravel() / focal_px, np.ones(x.size)])


def test_eight_terms_say_of_each_pixel_what_twelve_parameters_said():
    lens = MeasuredLens(shape=(960, 1280), vector=RATIONAL, covariance=covariance(SIGMAS), noise_px=0.1)
    f, cx, cy, *terms = lens.brown.values
    points = rays(lens.shape, f) * [0.8, 0.8, 1]
    brown = np.array([f, f * lens.aspect, cx, cy, *terms, 0, 0, 0])
    assert lens.brown.misfit_px < 0.3
    assert np.abs(project_points(brown, points) - project_points(RATIONAL, points)).max() < 4 * lens.brown.misfit_px
    whole = projection(RATIONAL, points).by_lens
    own = projection(brown, points).by_lens
    slopes = np.concatenate([own[..., :1] + lens.aspect * own[..., 1:2], own[..., 2:9]], axis=-1)
    expected = np.sqrt(np.einsum("nij,jk,nik->ni", whole, lens.covariance, whole))
    told = np.sqrt(np.einsum("nij,jk,nik->ni", slopes, KnownLenses(camera=lens).covariance()[:8, :8], slopes))
    assert np.median(told / expected) == pytest.approx(1.0, abs=0.15)


def test_terms_that_boards_did_not_fit_are_not_taken_for_certain():
    sigmas = np.where(np.arange(12) < 4, SIGMAS, 0.0)
    vector = np.where(np.arange(12) < 4, RATIONAL, 0.0)
    lens = MeasuredLens(shape=(960, 1280), vector=vector, covariance=covariance(sigmas), noise_px=0.1)
    assert (np.diag(KnownLenses(camera=lens).covariance())[:8] > 0).all()


def test_pixels_are_undone_to_those_of_a_lens_without_distortion():
    lens = MeasuredLens(shape=(960, 1280), vector=RATIONAL, covariance=covariance(SIGMAS), noise_px=0.1)
    points = rays(lens.shape, 540.0)
    ideal = ideal_pixels(lens, project_points(RATIONAL, points), (639.5, 479.5))
    assert np.abs(ideal - (points[:, :2] * 540.0 + [639.5, 479.5])).max() < 1e-5


def of_boards(device, focal_share=1.0, sigma_share=5e-4):
    """What boards would say of a room's device, off its true focal length by a share."""
    f, (cx, cy) = device.focal_px * focal_share, device.principal_point_px
    vector = np.array([f, f, cx, cy, *device.distortion, 0, 0, 0])
    sigmas = np.array([sigma_share * f, sigma_share * f, 0.3, 0.3, 5e-4, 5e-4, 5e-5, 5e-5, 5e-4, 0, 0, 0])
    return MeasuredLens(shape=device.shape, vector=vector, covariance=covariance(sigmas, 0.5), noise_px=0.1)


def sheets_of(room, camera_hfov_deg):
    return NominalIntrinsics.of(
        camera_shape=room.camera.shape,
        projector_shape=room.projector.shape,
        camera_hfov_deg=camera_hfov_deg,
        projector_hfov_deg=room.projector_hfov_deg,
    )


def calibrated(room, known):
    return calibrate_stereo(*room.correspondences(14), sheets_of(room, 100.0).with_lenses(known))


@pytest.fixture(scope="module")
def barrel_room(room):
    """Lenses that no start without their file would find: strong distortion, an axis far off the middle."""
    return room.changed(camera={"distortion": (-0.12, 0.015, 0.0, 0.0, 0.0), "principal_point_px": (600.0, 430.0)})


def test_a_lens_file_makes_the_outcome_surer_and_does_not_fix_it(barrel_room):
    known = KnownLenses(camera=of_boards(barrel_room.camera), projector=of_boards(barrel_room.projector))
    pair = calibrated(barrel_room, known)
    prior = np.sqrt(np.diag(known.covariance()))
    assert 0 < pair.sigmas["camera_f"] < prior[0]
    assert 0 < pair.sigmas["projector_f"] < prior[8]
    for model, truth, name in (
        (pair.camera, barrel_room.camera, "camera"),
        (pair.projector, barrel_room.projector, "projector"),
    ):
        assert abs(model.focal_px[0] - truth.focal_px) < 4 * pair.sigmas[f"{name}_f"]
        for found, true, term in zip(model.principal_point_px, truth.principal_point_px, ("cx", "cy"), strict=True):
            assert abs(found - true) < 4 * pair.sigmas[f"{name}_{term}"]


@pytest.mark.parametrize("off", [1.02, 1.25])
def test_a_file_of_another_lens_is_named(room, off):
    known = KnownLenses(camera=of_boards(room.camera, off))
    with pytest.raises(CalibrationError, match=r"contradict the camera's lens file: without it .* the file says"):
        calibrated(room, known)


def test_focal_lengths_that_differ_by_chance_become_one(room):
    camera = of_boards(room.camera)
    chance = replace(camera, vector=camera.vector * np.where(np.arange(12) == 1, 1.0008, 1.0))
    stretched = replace(camera, vector=camera.vector * np.where(np.arange(12) == 1, 1.05, 1.0))
    assert (chance.aspect, stretched.aspect) == (1.0, pytest.approx(1.05))
    f = chance.brown.values[0]
    assert room.camera.focal_px < f < 1.0008 * room.camera.focal_px
    assert KnownLenses(camera=chance).covariance()[0, 0] < chance.covariance[0, 0]


def test_slopes_of_the_residuals_are_right_where_pixels_are_not_square(room):
    camera = of_boards(room.camera)
    stretched = replace(camera, vector=camera.vector * np.where(np.arange(12) == 1, 1.05, 1.0))
    nominal = sheets_of(room, 100.0).with_lenses(KnownLenses(camera=stretched, projector=stretched))
    x1, x2 = (xy[::400] for xy in room.correspondences(10))
    axes = Axes(np.eye(3), np.array([-1]))
    error = LandingError(x1=x1, x2=x2, label=np.zeros(len(x1), dtype=np.int64), axes=axes, nominal=nominal)
    z = np.concatenate([expected_lenses(nominal)[0], [0.1, 0.2, 0.02, 0.3, 0.1, 0.9], np.zeros(3), [0.1, 0.1, 0.4]])
    slopes = error.jacobian(z)
    for k in range(len(z)):
        step = np.where(np.arange(len(z)) == k, 1e-6, 0.0)
        assert slopes[k] == pytest.approx((error(z + step) - error(z - step)) / 2e-6, rel=1e-3, abs=0.05)
