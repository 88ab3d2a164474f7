"""What self-calibration refuses, and why; and planes that stand for no points of their own."""

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.geometry.bundle_residual import LandingError, rays_of
from calibration.geometry.bundle_unknowns import PLANES, TRANSLATION, PlanarScene
from calibration.geometry.contradictions import (
    check_determined,
    check_flat,
    check_no_facets,
    is_flat,
)
from calibration.geometry.flat import left_out, rivals
from calibration.geometry.flat.left_out import check_none_left_out
from calibration.geometry.known.data_sheets import check_data_sheets
from calibration.geometry.known.explained import ExplainedPixels
from calibration.geometry.known.scale import _along, scale_from_spots
from calibration.geometry.noise import covariance, observation_variance
from calibration.geometry.pinhole import PinholeModel
from calibration.geometry.plane_bundle import refit, transfer_of
from calibration.geometry.planes import Axes
from calibration.geometry.robust_fit import Priors, robust_fit
from calibration.geometry.stereo import StereoCalibration
from calibration.geometry.support import bends_of, exclusive_points, mixed_share, plane_errors_px, standing_planes

WALLS = {"x0": 0, "x1": 0, "y0": 1, "y1": 1, "floor": 2, "ceiling": 2}
FACES = ("x1", "y1", "floor")


def model(device, rotation, translation):
    height, width = device.shape
    return PinholeModel(
        width_px=width,
        height_px=height,
        focal_px=(device.focal_px, device.focal_px),
        principal_point_px=device.principal_point_px,
        distortion=tuple(device.distortion),
        rotation=rotation,
        translation_m=translation,
    )


def true_scene(room):
    """The room's devices and three of its walls, in the camera's frame; the baseline is 1."""
    turn, at = room.camera.rotation, np.array(room.camera.position_m)
    away = room.projector.rotation @ (at - room.projector.position_m)
    baseline = np.linalg.norm(away)
    planes = []
    for face in FACES:
        normal = np.eye(3)[WALLS[face]]
        position = 0.0 if face in ("x0", "y0", "floor") else room.size_m[WALLS[face]]
        planes.append(baseline * (turn @ normal) / (position - normal @ at))
    return PlanarScene(
        camera=model(room.camera, np.eye(3), np.zeros(3)),
        projector=model(room.projector, room.projector.rotation @ turn.T, away / baseline),
        planes=np.array(planes),
        axes=Axes(np.eye(3), np.full(len(planes), -1)),
    )


@pytest.fixture(scope="module")
def corner(room):
    """A room's corner as it is, with correspondences of it."""
    x1, x2 = room.changed(faces=FACES).correspondences(28)
    return true_scene(room), x1, x2


def fitted(room, corner, bend_px):
    """A fit of free planes to the corner, on whose first wall points leave a plane by up to so much."""
    scene, x1, x2 = corner
    label = plane_errors_px(scene, x1, x2).argmin(axis=0)
    near = plane_errors_px(scene, x1, x2).min(axis=0) < 1
    bent = x2 + bend_px * np.where(label == 0, np.sin(x1[:, 0] / 60) * np.sin(x1[:, 1] / 50), 0.0)[:, None]
    error = LandingError(x1=x1[near], x2=bent[near], label=label[near], axes=scene.axes, nominal=room.nominal)
    return refit(error, scene, 0.02), x1[near]


def test_a_wall_that_bends_is_refused_with_its_place_and_by_how_much(room, corner):
    solution, x1 = fitted(room, corner, bend_px=0.6)
    with pytest.raises(CalibrationError, match=r"camera pixel \(\d+, \d+\) is not flat: .* px rms, the limit is"):
        check_flat(solution, x1)


def test_flat_walls_with_the_noise_of_codes_are_not_refused(room, corner):
    solution, x1 = fitted(room, corner, bend_px=0.0)
    check_flat(solution, x1)


def bowed(solution, x1, rms_px):
    """The same fit, had it left a parabola along the first wall, as the facets do that stand for a cylinder."""
    on = solution.fit_label == 0
    along = x1[on, 0] - x1[on, 0].mean()
    parabola = along**2 - np.polyval(np.polyfit(along, along**2, 1), along)
    residual = solution.fit.residual.copy()
    residual[on, 0] += rms_px * parabola / np.sqrt((parabola**2).mean())
    return replace(solution, fit=replace(solution.fit, residual=residual))


def test_a_wall_that_bows_by_less_than_its_noise_is_refused(room, corner):
    solution, x1 = fitted(room, corner, bend_px=0.0)
    bow = bends_of(bowed(solution, x1, 0.12), x1)
    assert bow.bow_px[0] == pytest.approx(0.12, rel=0.05)
    assert bow.bow_px[0] < bow.noise_px[0]
    assert bow.bow_px[1:].max() < 0.02
    with pytest.raises(CalibrationError, match=r"is not flat: .* by 0\.1\d+ px rms"):
        check_flat(bowed(solution, x1, 0.12), x1)
    assert is_flat(bowed(solution, x1, 0.04), x1)


def test_a_plane_whose_points_bend_away_towards_its_edges_is_refused_as_a_facet(room):
    """A fit leaves out what is near edges; of facets that stand for a cylinder that is most of what bends."""
    bare = room.changed(faces=FACES, noise_px=0.03, edge_bias_px=0.0, outlier_share=0.0)
    scene, (x1, x2) = true_scene(room), bare.correspondences(12)
    label = plane_errors_px(scene, x1, x2).argmin(axis=0)
    along = np.abs(x1[:, 0] - np.median(x1[label == 0, 0]))
    middle, end = np.quantile(along[label == 0], [0.4, 1.0])
    at_edges = (label == 0) & (along > middle)
    bent = x2 + np.where(at_edges, 0.8 * ((along - middle) / (end - middle)) ** 2, 0.0)[:, None]
    inside = np.flatnonzero(~at_edges)
    error = LandingError(x1=x1[inside], x2=x2[inside], label=label[inside], axes=scene.axes, nominal=room.nominal)
    solution = replace(refit(error, scene, 0.02), label=label, used=inside)
    check_flat(solution, x1)
    check_no_facets(solution, x1, x2)
    with pytest.raises(CalibrationError, match=r"is not flat: towards its edges its points leave the plane .* by 0"):
        check_no_facets(solution, x1, bent)


def test_focal_lengths_that_the_data_sheets_contradict_are_refused_with_both(room, corner):
    solution, _ = fitted(room, corner, bend_px=0.0)
    sigma = np.sqrt(np.diag(covariance(solution.fit, 0.02)))
    check_data_sheets(solution, sigma)
    longer = solution.fit.z.copy()
    longer[[0, 8]] += 0.3
    with pytest.raises(CalibrationError, match=r"focal length comes out 1\.\d+ \+- .* what hfov_deg says"):
        check_data_sheets(replace(solution, fit=replace(solution.fit, z=longer)), sigma)


@pytest.mark.parametrize(
    ("on_planes", "cause"), [(0.95, "too little parallax"), (0.65, "35 % of all points lie on no")]
)
def test_distances_that_are_open_are_blamed_on_points_without_a_plane_where_these_are_many(
    room, corner, on_planes, cause
):
    """A bare dome was told that its parallax is too little."""
    solution, x1 = fitted(room, corner, bend_px=0.0)
    label = np.where(np.arange(len(x1)) < on_planes * len(x1), 0, -1)
    with pytest.raises(CalibrationError, match=cause):
        check_determined(replace(solution, label=label), covariance(solution.fit, 1e4))


def test_a_phantom_plane_before_a_wall_does_not_stand(corner):
    scene, x1, x2 = corner
    phantom = scene.with_planes(np.vstack([scene.planes, 1.3 * scene.planes[0]]))
    assert standing_planes(phantom, x1, x2).tolist() == [True, True, True, False]


def test_of_a_wall_that_is_found_twice_one_stays(corner):
    scene, x1, x2 = corner
    twice = scene.with_planes(np.vstack([scene.planes, 1.0002 * scene.planes[1]]))
    stands = standing_planes(twice, x1, x2)
    assert stands.sum() == 3
    assert stands[[0, 2]].all()


def test_points_of_several_boards_lie_among_each_other_and_those_of_a_room_do_not(corner):
    scene, x1, x2 = corner
    assert mixed_share(x1, exclusive_points(plane_errors_px(scene, x1, x2))) < 0.06
    # Every other point as if it were of a picture in which a board stood before the walls.
    board = 1.5 * scene.planes[:2].mean(axis=0)
    near = scene.with_planes(np.vstack([scene.planes, board]))
    both = x2.copy()
    both[::2] = transfer_of(near.projector)(rays_of(near.camera, x1[::2]), board)
    assert mixed_share(x1, exclusive_points(plane_errors_px(near, x1, both))) > 0.15


def test_the_derivative_of_landings_is_that_of_differences(room, corner):
    _, x1, x2 = corner
    axes = Axes(np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0], np.array([0, -1, 2]))
    error = LandingError(x1=x1[::9], x2=x2[::9], label=np.arange(len(x1[::9])) % 3, axes=axes, nominal=room.nominal)
    z = np.random.default_rng(2).normal(0, 0.01, PLANES + 5)
    z[[0, 8]] += 1
    z[[1, 2, 9, 10]] += 0.5
    z[TRANSLATION] += (-0.9, -0.3, 0.05)
    z[PLANES:] += (0.1, 0.02, 0.02, 0.15, 0.12)
    jacobian, step = error.jacobian(z), 1e-6
    inside = np.abs(error(z)).max(axis=1) < 3000
    for k in range(len(z)):
        low, high = z.copy(), z.copy()
        low[k], high[k] = low[k] - step, high[k] + step
        difference = (error(high) - error(low)) / (2 * step)
        assert np.allclose(jacobian[k][inside], difference[inside], rtol=1e-3, atol=1e-2), k


def slopes_over_sigma(x1: np.ndarray, x2: np.ndarray | None, shared_errors: Iterator[np.ndarray]) -> float:
    """Errors of planes through points with errors (N, 2), over their sigmas, root mean square: 1 if these are true."""
    random = np.random.default_rng(8)
    design = np.column_stack([x1[:, 0] / 480, x1[:, 1] / 360, np.ones(len(x1))])
    truth, ratios = np.array([1.0, 2.0, 3.0]), []
    for shared in shared_errors:
        noise = random.normal(0, 0.03, shared.shape) + shared

        def residual(z, noise=noise):
            return np.stack([design @ z[:3], design @ z[3:]], axis=1) - (design @ truth)[:, None] - noise

        nothing = Priors.independent(np.zeros(6), np.full(6, np.inf), 1.0)
        fit = robust_fit(residual, np.zeros(6), nothing, iterations=5, least_scale_px=1)
        variance = observation_variance(fit, x1, np.zeros(len(x1), dtype=np.int64), x2)
        ratios.append((fit.z - np.tile(truth, 2)) / np.sqrt(np.diag(covariance(fit, variance))))
    return float(np.sqrt(np.mean(np.square(ratios))))


CAMERA_PX = np.stack(np.meshgrid(np.arange(0, 480, 4.0), np.arange(0, 360, 4.0)), -1).reshape(-1, 2)


def test_sigmas_are_true_where_neighbours_share_their_error():
    random, block = np.random.default_rng(9), (CAMERA_PX // 8).astype(int)
    errors = (random.normal(0, 0.1, (90, 120, 2))[block[:, 1], block[:, 0]] for _ in range(25))
    assert 0.6 < slopes_over_sigma(CAMERA_PX, None, errors) < 1.15


@pytest.mark.parametrize("axis", [0, 1])
def test_sigmas_are_true_where_whole_lines_of_the_projector_share_their_error(axis):
    """Codes err by lines, seen from beside: squares of the camera's picture alone make too little of it."""
    projector_px = CAMERA_PX @ np.array([[0.5, 0.1], [-0.1, 0.4]]) + 40
    line = (projector_px[:, axis] // 8).astype(int)

    def errors() -> Iterator[np.ndarray]:
        random = np.random.default_rng(10)
        return (random.normal(0, 0.1, (60, 2))[line] for _ in range(25))

    assert 0.5 < slopes_over_sigma(CAMERA_PX, projector_px, errors()) < 1.2
    assert slopes_over_sigma(CAMERA_PX, None, errors()) > 1.5


def calibrated(scene, explained_px, plane):
    """A calibration whose points all lie on one plane."""
    return StereoCalibration(
        camera=scene.camera,
        projector=scene.projector,
        planes=scene.planes,
        axes=(0, 1, 2),
        room_axes=np.eye(3),
        rms_px=0.1,
        camera_rms_px=0.1,
        projector_rms_px=0.1,
        sigmas={},
        inlier_share=1.0,
        explained=ExplainedPixels(projector_xy_px=explained_px, plane=np.full(len(explained_px), plane)),
    )


def test_a_spot_that_nothing_was_measured_around_is_refused_by_name(corner):
    scene, _, _ = corner
    around = np.stack(np.meshgrid(np.arange(800.0, 900), np.arange(250.0, 350)), -1).reshape(-1, 2)
    stereo = calibrated(scene, around, plane=0)
    with pytest.raises(CalibrationError, match=r"spot \(150, 300\) px of .* no measured wall around it"):
        scale_from_spots(stereo, [[150, 300], [870, 300]], 1.0)


def test_a_spot_at_the_edge_of_two_walls_of_which_the_camera_sees_the_other_is_refused(corner):
    """Beyond the edge points were measured, on this side none: the tape would be laid on the wall beyond."""
    scene, _, _ = corner
    line = np.column_stack([np.arange(100.0, 900), np.full(800, 300.0)])
    first = _along(scene, line).argmin(axis=1)
    edge = int(np.flatnonzero(np.diff(first))[0])
    stereo = calibrated(scene, line[edge + 1 :], plane=int(first[edge + 1]))
    apart = line[edge + 30]
    with pytest.raises(CalibrationError, match=r"lies within 3 px of the edge between two walls: they are .* % of"):
        scale_from_spots(stereo, [line[edge - 2], apart], 1.0)
    with pytest.raises(CalibrationError, match="has no measured wall around it"):
        scale_from_spots(stereo, [line[edge - 80], apart], 1.0)


def test_a_spot_lies_on_the_plane_of_its_neighbourhood():
    xy = np.stack(np.meshgrid(np.arange(0.0, 100, 2), np.arange(0.0, 80, 2)), -1).reshape(-1, 2)
    explained = ExplainedPixels(projector_xy_px=xy, plane=(xy[:, 0] > 50).astype(np.int64))
    assert explained.plane_at(np.array([[20.0, 40.0], [80.0, 40.0], [300.0, 40.0]])).tolist() == [0, 1, -1]


def test_a_spot_among_points_that_no_plane_explains_lies_on_none():
    """Some points of the floor's plane carry on across a wall that was left out; a spot there is not on the floor."""
    xy = np.stack(np.meshgrid(np.arange(0.0, 100, 2), np.arange(0.0, 80, 2)), -1).reshape(-1, 2)
    left_out = (xy[:, 0] > 50) & (xy[:, 1] % 8 != 0)
    floor = xy[~left_out]
    explained = ExplainedPixels(
        projector_xy_px=floor, plane=np.zeros(len(floor), dtype=np.int64), others_xy_px=xy[left_out]
    )
    places = np.array([[20.0, 40.0], [80.0, 42.0], [106.0, 40.0]])
    assert explained.plane_at(places).tolist() == [0, -1, -1]
    assert explained.plane_beside(places).tolist() == [0, -1, -1], "beside what lies on none, too"


def test_a_spot_beyond_a_strip_that_lies_on_no_plane_lies_on_none():
    """The camera sees a few pixels of the wall on which the spot is, and from there on another one."""
    wall = np.stack(np.meshgrid(np.arange(60.0, 200, 2), np.arange(0.0, 80, 2)), -1).reshape(-1, 2)
    strip = np.stack(np.meshgrid(np.arange(56.0, 60, 2), np.arange(0.0, 80, 4)), -1).reshape(-1, 2)
    explained = ExplainedPixels(projector_xy_px=wall, plane=np.zeros(len(wall), dtype=np.int64))
    spot = np.array([[52.0, 40.0]])
    assert not explained.are_among(spot).any(), "points are on one side only"
    assert explained.are_among(np.array([[92.0, 40.0]])).all()
    assert explained.plane_beside(spot).tolist() == [0]
    assert explained.with_others(strip).plane_beside(spot).tolist() == [-1]
    assert explained.with_others(strip[:2]).plane_beside(spot).tolist() == [0], "two of twelve may be strays"


def of_two_walls(room, corner, bend_px):
    """A fit to the first two walls of the corner, with all its points; the third bends by so much."""
    scene, x1, x2 = corner
    errors = plane_errors_px(scene, x1, x2)
    third = errors.argmin(axis=0) == 2
    bent = x2 + bend_px * np.where(third, (x1[:, 0] / 320 - 2) ** 2, 0.0)[:, None]
    two = replace(scene, planes=scene.planes[:2], axes=Axes(np.eye(3), np.full(2, -1)))
    errors = plane_errors_px(two, x1, bent)
    near, label = errors.min(axis=0) < 1, errors.argmin(axis=0)
    error = LandingError(x1=x1[near], x2=bent[near], label=label[near], axes=two.axes, nominal=room.nominal)
    return replace(refit(error, two, 0.02), label=np.where(near, label, -1)), x1, bent


def test_a_fit_that_leaves_a_flat_wall_out_is_refused(room, corner):
    with pytest.raises(CalibrationError, match=r"% of the points, around camera pixel .* lie on a flat wall"):
        check_none_left_out(*of_two_walls(room, corner, 0.0))


def test_of_all_flat_pieces_that_were_left_out_none_is_passed_over(room, corner, monkeypatch):
    """The first of them alone was looked at; it may be a column's, with a wall behind it (random world 61017)."""
    solution, x1, x2 = of_two_walls(room, corner, 0.0)
    found = left_out.segment_planes

    def after_one_that_touches(*points):
        walls = found(*points)
        touching = walls[0] + 0.02 * np.linalg.norm(walls[0]) * np.array([0.0, 1.0, 0.0])
        return np.concatenate([touching[None], walls])

    monkeypatch.setattr(left_out, "segment_planes", after_one_that_touches)
    with pytest.raises(CalibrationError, match="lie on a flat wall"):
        check_none_left_out(solution, x1, x2)


def test_a_fit_may_leave_out_what_bends(room, corner):
    check_none_left_out(*of_two_walls(room, corner, 30.0))


SQUARE = Axes(np.eye(3), np.array([0, 1, 2]))
FIRST = SimpleNamespace(share=0.984, left_over=0.00625, axes=SQUARE)
"""Of small rig 9648, which was called curved; the true room left 0.00778 over and explained 0.9877."""


@pytest.fixture
def nothing_else(monkeypatch):
    """Neither tangents, a room inside out nor furniture, and nothing contradicts what is held."""
    monkeypatch.setattr(rivals, "unheld_reversal", lambda *_: None)
    monkeypatch.setattr(rivals, "without_tangents", lambda *_, **__: None)
    for name in ("planes_before_others", "small_planes"):
        monkeypatch.setattr(rivals, name, lambda *_: [])
    monkeypatch.setattr(rivals, "hold_against_all", lambda _a, _b, bundle, *_, **__: bundle)


def rival(share, left_over):
    other = SimpleNamespace(share=share, left_over=left_over, axes=SQUARE)
    points = np.zeros((1, 2))
    found = rivals.uncontradicted_rival(points, points, FIRST, [other], nominal=None, weight=points)
    return found is other


def test_a_fit_from_another_start_that_leaves_a_little_less_is_tried(nothing_else):
    assert rival(share=0.9877, left_over=0.00778)


def test_a_fit_from_another_start_that_leaves_more_is_not(nothing_else):
    assert not rival(share=0.9807, left_over=0.00651)
