"""Triangulation of points that were projected by OpenCV, not by our own camera model."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.geometry.pinhole import PinholeModel, fold_squared, image_of, project, undistort
from calibration.geometry.triangulation import average_by_projector_pixel, stands_alone, triangulate, triangulate_lines
from calibration.structured_light.correspondence import Correspondence, PixelReason


def device(
    turn_rad: tuple[float, float, float], translation_m: tuple[float, float, float], **lens: object
) -> PinholeModel:
    numbers: dict[str, object] = {
        "width_px": 1280,
        "height_px": 800,
        "focal_px": (1650.0, 1710.0),
        "principal_point_px": (620.0, 830.0),
        "distortion": (-0.05, 0.4, -0.007, -0.002, -1.0),
    }
    rotation = np.asarray(cv2.Rodrigues(np.array(turn_rad, dtype=np.float64))[0])
    return PinholeModel(**{**numbers, **lens}, rotation=rotation, translation_m=np.array(translation_m, dtype=float))  # type: ignore[arg-type]


CAMERA = device(
    (0.02, 0.1, -0.01),
    (0.3, 0.2, 0.1),
    focal_px=(2800.0, 2790.0),
    principal_point_px=(1500.0, 1090.0),
    distortion=(-0.23, 0.15, -0.001, 0.001, -0.03),
)
PROJECTOR = device((0.05, 0.45, 0.08), (-0.1, 0.15, 0.05))


def seen_by(model: PinholeModel, points_m: np.ndarray) -> np.ndarray:
    fx, fy = model.focal_px
    cx, cy = model.principal_point_px
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    vector = cv2.Rodrigues(model.rotation)[0]
    image = cv2.projectPoints(points_m, vector, model.translation_m, matrix, distCoeffs=np.array(model.distortion))[0]
    return np.asarray(image).reshape(-1, 2)


@pytest.fixture
def points_m() -> np.ndarray:
    rng = np.random.default_rng(7)
    return rng.uniform((-0.2, -0.15, 0.9), (0.2, 0.15, 1.3), (300, 3))


def test_points_come_back_from_what_both_devices_see_of_them(points_m: np.ndarray) -> None:
    found = triangulate(seen_by(CAMERA, points_m), seen_by(PROJECTOR, points_m), CAMERA, PROJECTOR)
    assert np.abs(found.points_m - points_m).max() < 1e-7
    assert found.epipolar_px.max() < 1e-4


def test_a_shift_across_the_epipolar_line_is_measured_in_projector_pixels(points_m: np.ndarray) -> None:
    straight = device((0, 0, 0), (-0.2, 0, 0), distortion=(0, 0, 0, 0, 0), focal_px=(1000.0, 1000.0))
    camera = device((0, 0, 0), (0, 0, 0), distortion=(0, 0, 0, 0, 0))
    shown = seen_by(straight, points_m) + np.array([0, 1.5])
    found = triangulate(seen_by(camera, points_m), shown, camera, straight)
    assert found.epipolar_px == pytest.approx(1.5)
    assert np.abs(found.points_m - points_m)[:, 2].max() < 0.002


def test_noise_moves_points_as_the_geometry_says(points_m: np.ndarray) -> None:
    """Depth error = z² / (f b) × pixel error, here some 0.15 mm for 0.1 px in the projector alone."""
    rng = np.random.default_rng(8)
    camera, projector = device((0, 0, 0), (0, 0, 0)), device((0, 0, 0), (-0.4, 0, 0))
    noisy = seen_by(projector, points_m) + rng.normal(0, 0.1, (len(points_m), 2)) * (1, 0)
    error = triangulate(seen_by(camera, points_m), noisy, camera, projector).points_m - points_m
    expected = 0.1 * points_m[:, 2] ** 2 / (1650 * 0.4)
    assert np.sqrt(np.mean((error[:, 2] / expected) ** 2)) == pytest.approx(1, abs=0.15)


def test_devices_in_the_same_place_are_refused(points_m: np.ndarray) -> None:
    xy = seen_by(CAMERA, points_m)
    with pytest.raises(CalibrationError, match=r"0 m apart, at least 1e-06 m"):
        triangulate(xy, xy, CAMERA, CAMERA)


def test_rays_that_meet_behind_the_devices_give_no_point() -> None:
    camera, projector = device((0, 0, 0), (0, 0, 0)), device((0, 0, 0), (-0.4, 0, 0))
    apart = triangulate(np.array([[500.0, 800.0]]), np.array([[700.0, 800.0]]), camera, projector)
    assert np.isnan(apart.points_m).all()
    parallel = triangulate(np.array([[620.0, 830.0]]), np.array([[620.0, 830.0]]), camera, projector)
    assert np.isnan(parallel.points_m).all()


def test_on_the_cameras_rays_a_point_keeps_its_camera_pixel(points_m: np.ndarray) -> None:
    noise = np.random.default_rng(9).normal(0, 0.5, (len(points_m), 2))
    pixels, shown = seen_by(CAMERA, points_m), seen_by(PROJECTOR, points_m) + noise
    kept = triangulate(pixels, shown, CAMERA, PROJECTOR, on_camera_rays=True).points_m
    middle = triangulate(pixels, shown, CAMERA, PROJECTOR).points_m
    assert np.abs(seen_by(CAMERA, kept) - pixels).max() < 1e-4
    assert np.abs(seen_by(CAMERA, middle) - pixels).max() > 0.05


def test_camera_pixels_of_one_projector_pixel_are_averaged() -> None:
    codes = np.full((4, 5, 2), np.nan, dtype=np.float32)
    codes[1, 1:4] = (7, 2)
    codes[2, 4] = (6, 3)
    codes[0, 0] = (6.5, 3)  # on a border: belongs to neither
    reason = np.where(np.isnan(codes[..., 0]), PixelReason.DARK, PixelReason.VALID).astype(np.uint8)
    pairs = average_by_projector_pixel(Correspondence(codes, reason, (4, 8)))
    assert pairs.projector_xy_px.tolist() == [[7, 2], [6, 3]]
    assert pairs.camera_xy_px.tolist() == [[2, 1], [4, 2]]
    assert pairs.n_pixels.tolist() == [3, 1]


def test_a_projector_pixel_that_the_end_of_a_surface_tears_has_no_place() -> None:
    row, column = np.mgrid[:24, :40]
    codes = np.stack([column // 2, row // 2], axis=-1).astype(np.float32)
    codes[:, 20:30] = np.nan  # hidden
    codes[:, 30:, 0] -= 5  # the rest of the same stripe, six pixels further
    codes[:, 19:20, 0] = 10
    pairs = average_by_projector_pixel(Correspondence(codes, np.isnan(codes[..., 0]).astype(np.uint8), (12, 20)))
    assert 10 not in pairs.projector_xy_px[:, 0], "column 10 is seen at 19, and at 30 and 31"
    assert {8, 11, 12} <= set(pairs.projector_xy_px[:, 0])


def test_a_projector_pixel_of_which_a_part_is_hidden_has_no_place() -> None:
    row, column = np.mgrid[:24, :60]
    codes = np.stack([column // 6, row // 6], axis=-1).astype(np.float32)
    codes[:, 26:37] = np.nan  # hidden: four of six camera pixels of column 4, one of column 6
    pairs = average_by_projector_pixel(Correspondence(codes, np.isnan(codes[..., 0]).astype(np.uint8), (4, 10)))
    assert set(pairs.projector_xy_px[:, 0]) == {0, 1, 2, 3, 6, 7, 8, 9}
    inner = pairs.camera_xy_px - (6 * pairs.projector_xy_px + 2.5)
    assert np.abs(inner).max() <= 1.0, "middle of the projector's pixel, but for what one hidden column moves it"


def test_a_point_far_from_its_neighbours_stands_alone() -> None:
    column, row = np.meshgrid(np.arange(10.0), np.arange(6.0))
    xy = np.column_stack([column.ravel(), row.ravel()])
    distance_m = np.full(len(xy), 2.0)
    distance_m[23] = 2.1
    alone = stands_alone(xy, distance_m, (6, 10))
    assert np.flatnonzero(alone).tolist() == [23]
    assert stands_alone(np.array([[0.0, 0.0], [8.0, 5.0]]), np.array([2.0, 2.0]), (6, 10)).all()


@pytest.mark.parametrize(("axis", "k"), [("column", 0), ("row", 1)])
def test_columns_or_rows_alone_give_the_points_behind_strong_lenses(axis: str, k: int, points_m: np.ndarray) -> None:
    high = replace(PROJECTOR, translation_m=np.array([-0.1, 0.45, 0.05]), principal_point_px=(620.0, 100.0))
    pixels, shown = seen_by(CAMERA, points_m), seen_by(high, points_m)
    inside = ((shown > 0) & (shown < (high.width_px - 1, high.height_px - 1))).all(axis=1)
    found = triangulate_lines(pixels, shown[:, k], CAMERA, high, axis=axis)  # type: ignore[arg-type]
    assert inside.sum() > 30
    assert np.abs(found.points_m - points_m)[inside].max() < 1e-6


def test_a_line_says_how_far_a_pixel_moves_its_point(points_m: np.ndarray) -> None:
    camera, projector = (device((0, 0, 0), (x, 0, 0), principal_point_px=(620.0, 400.0)) for x in (0, -0.1))
    pixels, column = seen_by(camera, points_m), seen_by(projector, points_m)[:, 0]
    found, moved = (triangulate_lines(pixels, column + shift, camera, projector) for shift in (0.0, 0.1))
    apart = np.linalg.norm(moved.points_m - found.points_m, axis=1)
    seen = np.isfinite(apart)
    assert seen.mean() > 0.5
    assert apart[seen] / 0.1 == pytest.approx(found.metres_per_px[seen], rel=0.02)


def test_a_column_that_a_ray_runs_along_gives_no_point() -> None:
    plain = {"distortion": (0.0,) * 5, "principal_point_px": (620.0, 400.0)}
    camera, projector = (device((0.0, 0.0, 0.0), (x, 0.0, 0.0), **plain) for x in (0.0, -0.2))
    above = device((0.0, 0.0, 0.0), (0.0, -0.2, 0.0), **plain)
    point = np.array([[0.05, 0.1, 2.0]])
    pixel = seen_by(camera, point)
    assert np.isnan(triangulate_lines(pixel, seen_by(above, point)[:, 0], camera, above).points_m).all()
    assert triangulate_lines(pixel, seen_by(projector, point)[:, 0], camera, projector).points_m == pytest.approx(point)


def test_a_column_behind_the_devices_gives_no_point() -> None:
    pixels = np.array([[600.0, 400.0]])
    shown = seen_by(PROJECTOR, np.array([[0.0, 0.0, 3.0]]))[:, 0]
    near = triangulate_lines(pixels, shown + np.array([-4000.0]), CAMERA, PROJECTOR)
    assert np.isnan(near.points_m).all()


def test_columns_need_a_baseline_too() -> None:
    with pytest.raises(CalibrationError, match="no depth"):
        triangulate_lines(np.zeros((1, 2)), np.zeros(1), CAMERA, CAMERA)


@pytest.mark.parametrize(
    "distortion",
    [
        (-0.041, -0.033, 0.0, 0.0, 0.0),
        (-0.4, 0.0, 0.001, -0.002, 0.0),
        (-0.05, 0.4, -0.007, -0.002, -1.0),
        (0.1, -0.02, 0.0, 0.001, 0.0, 0.4, 0.1, 0.02),
        (0.1, 0.1, 0.0, 0.0, 0.0, 0.5, -0.1, 0.0),
    ],
)
def test_no_point_beyond_the_edge_of_a_lens_comes_to_lie_in_its_picture(distortion: tuple[float, ...]) -> None:
    """The polynomial of a distortion turns back at some angle, and would have what lies further out in the picture."""
    random = np.random.default_rng(7)
    points = np.column_stack([random.normal(size=(100_000, 2)), np.abs(random.normal(size=100_000)) + 1e-3])
    xy = image_of(points, 1.0, 0.0, distortion)
    assert np.isfinite(xy).all()
    inside = (np.abs(xy) < (0.45, 0.35)).all(axis=1)
    assert inside.sum() > 5000
    seen = undistort(xy[inside], distortion, iterations=50)
    np.testing.assert_allclose(points[inside, :2] / points[inside, 2:], seen, atol=1e-6)


@pytest.mark.parametrize(
    ("distortion", "fold"),
    [
        ((-0.4, 0.0, 0.0, 0.0, 1e-17), 1 / 1.2),
        ((-0.4, 1e-310, 0.0, 0.0, 0.0, 1e-18, 0.0, 1e-30), 1 / 1.2),
        ((0.4, 0.0, 0.0, 0.0, 0.1), np.inf),
        ((0.0, 0.0, 0.0, 0.0, 0.0, -0.25, 0.0, 0.0), 4.0),
        ((float("nan"),) * 5, np.inf),
    ],
)
def test_terms_that_are_nearly_nothing_or_no_numbers_do_not_move_the_fold(
    distortion: tuple[float, ...], fold: float
) -> None:
    assert fold_squared(distortion) == pytest.approx(fold, rel=1e-9)


def test_a_point_that_goes_outwards_never_comes_back() -> None:
    along = np.linspace(0, 1.4, 2000)
    points = CAMERA.rotation.T @ (np.stack([np.sin(along), 0 * along, np.cos(along)]) - CAMERA.translation_m[:, None])
    column = project(CAMERA, points.T)[:, 0]
    assert (np.diff(column) > 0).all()
