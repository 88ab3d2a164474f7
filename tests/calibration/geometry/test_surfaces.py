"""Planes found in points, and the room made of them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.geometry.flat.misfit import MOST_MISFIT_M, check_walls_fit, misfit_at_walls_m
from calibration.geometry.known.explained import ExplainedPixels
from calibration.geometry.known.tape import check_against_tape
from calibration.geometry.pinhole import PinholeModel, project
from calibration.geometry.planes import (
    ViewedPoints,
    assign_planes,
    axis_hypotheses,
    orthogonal_axes,
    segment_planes,
)
from calibration.geometry.room import lit_points, room_from_stereo
from calibration.geometry.stereo import StereoCalibration
from calibration.geometry.support import LEAST_BEHIND, explained_within_px, shares_behind

SIZE_M = (4.8, 4.8, 2.4)
WALLS = {"x0": 0, "x1": 0, "y0": 1, "y1": 1, "floor": 2, "ceiling": 2}


def model(device, rotation, translation_m):
    height, width = device.shape
    focal = (device.focal_px, device.focal_px)
    distortion = tuple(device.distortion)
    return PinholeModel(
        width_px=width,
        height_px=height,
        focal_px=focal,
        principal_point_px=device.principal_point_px,
        distortion=distortion,
        rotation=rotation,
        translation_m=translation_m,
    )


def true_pair(room, faces):
    """What a perfect calibration of the room would give, in metres, in the camera's frame."""
    turn, at = room.camera.rotation, np.array(room.camera.position_m)
    camera = model(room.camera, np.eye(3), np.zeros(3))
    relative = room.projector.rotation @ turn.T
    projector = model(room.projector, relative, room.projector.rotation @ (at - room.projector.position_m))
    planes = []
    for face in faces:
        normal = np.eye(3)[WALLS[face]]
        position = 0.0 if face in ("x0", "y0", "floor") else room.size_m[WALLS[face]]
        planes.append(turn @ normal / (position - normal @ at))
    axes = tuple(WALLS[face] for face in faces)
    return StereoCalibration(
        camera=camera,
        projector=projector,
        planes=np.array(planes),
        axes=axes,
        room_axes=turn.T,
        rms_px=0.1,
        camera_rms_px=0.1,
        projector_rms_px=0.1,
        sigmas={},
        inlier_share=1.0,
        explained=ExplainedPixels(projector_xy_px=np.zeros((0, 2)), plane=np.zeros(0, dtype=np.int64)),
    )


def test_the_room_of_the_bench_comes_out_in_the_frame_of_the_simulated_world(room):
    box = room_from_stereo(true_pair(room, ("x1", "y1", "floor", "ceiling")), SIZE_M)
    assert box.size_m == pytest.approx(SIZE_M)
    assert box.seen == ("x1", "y1", "floor", "ceiling")
    assert np.allclose(box.camera.position_m, room.camera.position_m)
    assert np.allclose(box.projector.position_m, room.projector.position_m)
    assert np.allclose(box.camera.rotation, room.camera.rotation)
    assert np.allclose(box.projector.rotation, room.projector.rotation)


def test_a_seen_wall_stands_where_it_was_measured_whatever_the_tape_says(room):
    box = room_from_stereo(true_pair(room, ("x1", "y1", "floor", "ceiling")), (5.0, 4.8, 9.9))
    assert box.size_m == pytest.approx((5.0, 4.8, 2.4))
    assert box.camera.position_m[0] == pytest.approx(room.camera.position_m[0] + 0.2)


def test_without_a_tape_measure_unseen_walls_stand_half_a_metre_behind(room):
    box = room_from_stereo(true_pair(room, ("x1", "y1", "floor", "ceiling")), None)
    behind = min(room.camera.position_m[0], room.projector.position_m[0]) - 0.5
    assert box.size_m[0] == pytest.approx(4.8 - behind)
    assert "0.5 m behind" in box.notes
    assert "x0" in box.notes


def test_a_floor_that_nobody_sees_lies_the_lens_height_below_the_projector(room):
    pair = true_pair(room, ("x1", "y1"))
    box = room_from_stereo(pair, SIZE_M, lens_height_m=room.projector.position_m[2])
    assert box.camera.position_m == pytest.approx(room.camera.position_m)
    assert "below the projector's lens" in box.notes
    guessed = room_from_stereo(pair, SIZE_M)
    assert abs(guessed.camera.position_m[2] - room.camera.position_m[2]) > 0.3


def test_a_floor_that_is_seen_stands_where_it_was_measured_whatever_the_lens_height_says(room):
    box = room_from_stereo(true_pair(room, ("x1", "y1", "floor")), SIZE_M, lens_height_m=9.0)
    assert box.camera.position_m[2] == pytest.approx(room.camera.position_m[2])
    assert "lens" not in box.notes


def test_an_open_room_has_only_the_faces_that_were_seen(room):
    box = room_from_stereo(true_pair(room, ("x1", "y1", "floor")), SIZE_M, closed=False)
    assert box.faces == box.seen == ("x1", "y1", "floor")


@pytest.mark.parametrize("corner", [(4.8, 4.8), (0.0, 4.8), (0.0, 0.0), (4.8, 0.0)])
def test_any_corner_gives_a_room_that_is_turned_by_quarters_and_not_mirrored(room, corner):
    x, y = corner
    seen = ("x1" if x else "x0", "y1" if y else "y0", "floor", "ceiling")
    # From the middle of the room, a little to the corner's right and left.
    other = room.changed(
        camera={"position_m": (2.2, 2.6, 1.4), "look_at_m": (x, y, 1.1)},
        projector={"position_m": (2.5, 2.3, 1.2), "look_at_m": (x, y, 1.2)},
    )
    box = room_from_stereo(true_pair(other, seen), SIZE_M)
    turn = box.camera.rotation.T @ other.camera.rotation
    assert np.allclose(np.abs(turn).max(axis=1), 1)
    assert np.linalg.det(turn) == pytest.approx(1)
    assert turn[2, 2] == pytest.approx(1)
    assert (np.array(box.size_m) > box.camera.position_m).all()
    assert (box.camera.position_m > 0).all()
    assert box.seen == ("x1", "y1", "floor", "ceiling")


def test_two_walls_on_one_axis_make_no_room(room):
    with pytest.raises(CalibrationError, match="aim at a corner"):
        room_from_stereo(true_pair(room, ("floor", "ceiling")), SIZE_M)


def test_free_planes_at_right_angles_make_a_room(room):
    pair = true_pair(room, ("x1", "y1", "floor", "ceiling"))
    box = room_from_stereo(replace(pair, axes=(-1, -1, -1, -1)), SIZE_M)
    assert box.size_m == pytest.approx(SIZE_M)
    assert box.seen == ("x1", "y1", "floor", "ceiling")


def test_free_planes_at_other_angles_make_no_room_and_their_angles_are_told(room):
    pair = true_pair(room, ("x1", "y1"))
    slanted = pair.planes[0] * np.cos(np.radians(20)) + pair.planes[1] * np.sin(np.radians(20))
    with pytest.raises(CalibrationError, match=r"walls 1 and 2 at \d+\.\d .* degrees.*right angles"):
        room_from_stereo(replace(pair, axes=(-1, -1), planes=np.stack([slanted, pair.planes[1]])), SIZE_M)


@pytest.mark.parametrize(("sigma_deg", "said"), [(3.0, "is not known.*right_angles = true"), (0.1, "aim at a corner")])
def test_angles_that_are_known_badly_are_not_called_those_of_another_shape(room, sigma_deg, said):
    pair = replace(true_pair(room, ("x1", "y1")), axes=(-1, -1))

    def leaning(degrees):
        turned = pair.planes[0] * np.cos(np.radians(degrees)) + pair.planes[1] * np.sin(np.radians(degrees))
        return np.stack([turned, pair.planes[1]])

    def scene(unknowns):
        axes = SimpleNamespace(directions=pair.room_axes)
        return SimpleNamespace(camera=pair.camera, projector=pair.projector, planes=leaning(unknowns[0]), axes=axes)

    fitted = SimpleNamespace(scene=scene, unknowns=np.array([4.0]), covariance=np.array([[sigma_deg**2]]))
    with pytest.raises(CalibrationError, match=said):
        room_from_stereo(replace(pair, planes=leaning(4.0), uncertainty=fitted), SIZE_M)


def test_a_wall_that_leans_is_not_left_out_of_the_room_without_a_word(room):
    pair = true_pair(room, ("x1", "y1", "floor"))
    leaning = pair.planes[0] * np.cos(np.radians(20)) + pair.planes[2] * np.sin(np.radians(20))
    seen = ExplainedPixels(projector_xy_px=np.zeros((9, 2)), plane=np.arange(9) % 3)
    slanted = replace(pair, axes=(-1, 1, 2), planes=np.stack([leaning, *pair.planes[1:]]), explained=seen)
    with pytest.raises(CalibrationError, match="a session needs a box"):
        room_from_stereo(slanted, SIZE_M)


PANEL_AT_M, PANEL_TURN_DEG = (3.1, 3.1, 1.2), 30.0


def with_panel(room, pair, half_width_m):
    """The walls x1, y1 and floor, and a panel before them, each with a fourth of the pixels that light them."""
    turn, at = room.camera.rotation, np.array(room.camera.position_m)
    angle = np.radians(PANEL_TURN_DEG)
    normal, along = np.array([np.sin(angle), np.cos(angle), 0.0]), np.array([np.cos(angle), -np.sin(angle), 0.0])
    panel = turn @ normal / (normal @ (np.array(PANEL_AT_M) - at))
    s, t = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)))
    on_panel = np.array(PANEL_AT_M) + half_width_m * s[:, None] * along + 0.8 * t[:, None] * np.array([0.0, 0.0, 1.0])
    x1 = np.stack([np.full_like(s, 4.8), 3.6 + 1.1 * s, 1.2 + t], axis=1)
    points = [x1, x1[:, [1, 0, 2]], np.stack([3.6 + s, 3.6 + t, np.zeros_like(s)], axis=1), on_panel]
    pixels = np.concatenate([room.projector.image_of(where)[0] for where in points])
    seen = ExplainedPixels(projector_xy_px=pixels, plane=np.repeat(np.arange(4), len(s)))
    return replace(pair, axes=(*pair.axes, -1), planes=np.vstack([pair.planes, panel]), explained=seen)


def test_a_panel_behind_which_walls_are_seen_is_furniture_however_large(room):
    pair = with_panel(room, true_pair(room, ("x1", "y1", "floor")), half_width_m=0.7)
    behind = shares_behind(pair.planes, lit_points(pair), pair.explained.plane)
    assert (behind[:3] == 0).all(), "behind walls there is nothing"
    assert behind[3] > LEAST_BEHIND
    box = room_from_stereo(pair, SIZE_M, with_things=True)
    assert box.size_m == pytest.approx(SIZE_M)
    assert box.camera.position_m == pytest.approx(room.camera.position_m)


def with_parallel(room, depth_m, *, share, first):
    """The walls x1, y1 and floor, and a surface so far before x1 (negative: behind it) with a share of its points."""
    pair = true_pair(room, ("x1", "y1", "floor"))
    at = np.array(room.camera.position_m)
    surface = pair.planes[0] * (4.8 - at[0]) / (4.8 - depth_m - at[0])
    s, t = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)))
    x1 = np.stack([np.full_like(s, 4.8), 3.6 + 1.1 * s, 1.2 + t], axis=1)
    on_it = (x1 - (depth_m, 0, 0))[:: round(1 / share)]
    order = [3, 0, 1, 2] if first else [0, 1, 2, 3]
    points = [x1, x1[:, [1, 0, 2]], np.stack([3.6 + s, 3.6 + t, np.zeros_like(s)], axis=1), on_it]
    pixels = np.concatenate([room.projector.image_of(points[k])[0] for k in order])
    seen = ExplainedPixels(projector_xy_px=pixels, plane=np.repeat(np.arange(4), [len(points[k]) for k in order]))
    planes, axes = np.vstack([pair.planes, surface])[order], np.array([*pair.axes, pair.axes[0]])[order]
    return replace(pair, axes=tuple(axes.tolist()), planes=planes, explained=seen)


def test_what_no_plane_explains_is_judged_by_the_largest_limit():
    assert explained_within_px(np.zeros(0)) == explained_within_px(np.full(9, 1e3))


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("depth_m", [0.25, -0.25, 0.6])
def test_a_beam_before_a_wall_or_a_niche_in_it_does_not_move_the_room(room, depth_m, first):
    """Whichever of both was found first; in random world 806 a beam was the wall, and all walls 0.3 m off."""
    box = room_from_stereo(with_parallel(room, depth_m, share=1 / 5, first=first), SIZE_M, with_things=True)
    assert box.camera.position_m == pytest.approx(room.camera.position_m)


def test_a_large_panel_is_not_left_out_of_a_model_of_walls_alone(room):
    pair = with_panel(room, true_pair(room, ("x1", "y1", "floor")), half_width_m=0.7)
    with pytest.raises(CalibrationError, match=r'modelled with \[surface\] kind = "free"'):
        room_from_stereo(pair, SIZE_M)


def test_a_length_by_tape_that_contradicts_what_was_measured_is_refused_with_both(room):
    box = room_from_stereo(true_pair(room, ("x1", "y1", "floor", "ceiling")), SIZE_M)
    check_against_tape(box, (9.9, 4.8, 2.41), np.full(3, 0.01), [0.003] * 3)
    with pytest.raises(CalibrationError, match=r"2\.400 \+- 0\.010 m along z .* 2\.680 .* sigma apart, the limit is 4"):
        check_against_tape(box, (4.8, 4.8, 2.68), np.full(3, 0.01), [0.003] * 3)


@pytest.mark.parametrize("right_angles", [True, False])
def test_right_angles_are_named_as_a_cause_only_where_walls_were_held_at_them(room, right_angles):
    """A corner of 95 degrees that is held at 90 is 7 % too high, and its points do not tell."""
    box = room_from_stereo(true_pair(room, ("x1", "y1", "floor", "ceiling")), SIZE_M)
    with pytest.raises(CalibrationError) as refusal:
        check_against_tape(box, (4.8, 4.8, 2.24), np.full(3, 0.01), [0.003] * 3, right_angles=right_angles)
    assert ("right_angles = false" in str(refusal.value)) is right_angles


@pytest.mark.parametrize(
    ("seen", "may_be_a_corner"), [(("x0", "x1", "floor"), True), (("x0", "x1", "y1"), False), (("x1", "y1"), False)]
)
def test_two_walls_that_the_tape_contradicts_may_be_those_of_a_corner(room, seen, may_be_a_corner):
    box = replace(room_from_stereo(true_pair(room, ("x1", "y1", "floor")), SIZE_M), seen=(*seen, "floor", "ceiling"))
    with pytest.raises(CalibrationError) as refused:
        check_against_tape(box, (2.1, 4.8, 1.9), np.full(3, 0.01), [0.003] * 3, right_angles=True)
    assert ("meet at a corner" in str(refused.value)) == may_be_a_corner


def test_a_device_behind_a_wall_by_tape_is_refused(room):
    with pytest.raises(CalibrationError, match=r"the camera would stand 0\.60 m behind wall x0"):
        room_from_stereo(true_pair(room, ("x1", "y1", "floor", "ceiling")), (3.6, 4.8, 2.4))


def test_a_device_that_may_well_stand_inside_is_refused_for_what_the_points_leave_open(room, monkeypatch):
    pair = true_pair(room, ("x1", "y1", "floor", "ceiling"))
    monkeypatch.setattr(type(pair), "sigmas_of", lambda self, figures: np.full_like(figures(self), 0.2 / self.baseline))
    with pytest.raises(CalibrationError, match=r"put the camera 0\.60 \+- 0\.20 m behind wall x0.*further aside"):
        room_from_stereo(pair, (3.6, 4.8, 2.4))


def straight(x1, plane):
    """A camera of focal length 500 px; the projector stands 1 to the right, looking the same way."""
    rays = np.column_stack([x1 / 500, np.ones(len(x1))])
    points = rays / (rays * plane).sum(axis=1)[:, None]
    return (points[:, :2] - [1.0, 0.0]) / points[:, 2:] * 500


def two_walls(random):
    """Points on planes z = 4 and x = 2 seen by that camera, each with its projector pixel and which wall it is."""
    x1 = random.uniform(-400, 400, (3000, 2))
    planes = np.array([[0, 0, 1 / 4], [1 / 2, 0, 0]])
    along = np.column_stack([x1 / 500, np.ones(len(x1))]) @ planes.T
    wall = along.argmax(axis=1)
    x2 = np.where(wall[:, None] == 0, straight(x1, planes[0]), straight(x1, np.array([0.5, 0, 1e-12])))
    points = np.column_stack([x1 / 500, np.ones(len(x1))]) / along.max(axis=1)[:, None]
    return x1, x2 + random.normal(0, 0.1, x2.shape), points, planes, wall


def test_two_walls_are_told_apart_and_strays_left_out():
    random = np.random.default_rng(2)
    x1, x2, points, planes, wall = two_walls(random)
    stray = random.random(len(x1)) < 0.05
    x2[stray] += random.uniform(20, 60, (stray.sum(), 2))
    points[stray] *= random.uniform(0.5, 0.9, (stray.sum(), 1))
    found = segment_planes(ViewedPoints(points, x1, x1, x2), straight, np.ones(len(x1), dtype=bool))
    assert len(found) == 2
    order = np.argsort(-found[:, 2])
    assert np.allclose(found[order], planes, atol=1e-3)
    label = assign_planes(straight, x1, x2, found[order], limit_px=2.0)
    assert (label[stray] == -1).mean() > 0.98
    assert (label[~stray] == wall[~stray]).mean() > 0.99


def test_points_near_an_edge_belong_to_no_wall_when_a_margin_is_asked_for():
    x1, x2, _, planes, wall = two_walls(np.random.default_rng(3))
    label = assign_planes(straight, x1, x2, planes, limit_px=2.0, margin_px=8.0)
    # The walls meet at x = 2, z = 4: column 250.
    near = np.abs(x1[:, 0] - 250) < 5
    far = np.abs(x1[:, 0] - 250) > 60
    assert (label[near] == -1).all()
    assert (label[far] == wall[far]).mean() > 0.99


def test_axes_are_exactly_orthogonal_and_nearest_to_the_normals():
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    normals = turn + np.random.default_rng(5).normal(0, 0.02, (3, 3))
    axes = orthogonal_axes(np.vstack([normals / 3, -normals[:1] / 2]))
    assert np.allclose(axes.directions @ axes.directions.T, np.eye(3))
    assert axes.of_plane[0] == axes.of_plane[3]
    assert sorted(axes.of_plane[:3]) == [0, 1, 2]
    assert np.degrees(np.arccos(np.abs(axes.directions @ turn.T).max(axis=1))).max() < 3


def test_a_sloping_ceiling_is_on_no_axis():
    slope = np.array([0, np.sin(np.radians(40)), np.cos(np.radians(40))])
    axes = orthogonal_axes(np.vstack([np.eye(3), slope]))
    assert axes.of_plane[3] == -1


def test_a_wall_that_stands_far_off_every_axis_is_tried_on_each_that_it_may_belong_to() -> None:
    slanted = np.array([[np.cos(np.radians(50)), np.sin(np.radians(50)), 0.0]])
    planes = np.vstack([np.eye(3)[[0, 2]], slanted])
    axes = orthogonal_axes(planes)
    assert axes.of_plane[2] == -1
    tried = [hypothesis.of_plane for hypothesis in axis_hypotheses(planes, axes)]
    np.testing.assert_array_equal(tried[0], axes.of_plane, err_msg="as it is, first")
    assert all((of_plane[:2] == axes.of_plane[:2]).all() for of_plane in tried)
    perpendicular = int(np.argmax(np.abs(axes.directions @ [0.0, 0.0, 1.0])))
    assert {int(of_plane[2]) for of_plane in tried} == {-1, 0, 1, 2} - {perpendicular}


def test_the_third_wall_of_a_flattened_corner_is_tried_on_the_axis_that_is_left() -> None:
    # normals of floor and two walls as rough lenses showed them: the third stands 83 degrees off its axis
    cosines = np.array([[1.0, 0.279, -0.376], [0.279, 1.0, 0.778], [-0.376, 0.778, 1.0]])
    planes = np.linalg.cholesky(cosines)
    axes = orthogonal_axes(planes)
    assert axes.of_plane.tolist() == [0, 1, -1]
    off_deg = np.degrees(np.arccos(np.abs(axes.directions[2] @ planes[2])))
    assert off_deg > 80
    assert [0, 1, 2] in [hypothesis.of_plane.tolist() for hypothesis in axis_hypotheses(planes, axes)]


def test_walls_that_all_fit_leave_nothing_to_try() -> None:
    planes = np.eye(3)
    assert len(axis_hypotheses(planes, orthogonal_axes(planes))) == 1


def lit_wall(room, rms_px):
    """One wall, lit by a grid of the projector's pixels, from which the points are so far off."""
    pair = true_pair(room, ("x1", "floor"))
    height, width = room.projector.shape
    xy_px = np.stack(np.meshgrid(np.linspace(0.3, 0.7, 9) * width, np.linspace(0.3, 0.6, 9) * height), -1).reshape(
        -1, 2
    )
    explained = ExplainedPixels(projector_xy_px=xy_px, plane=np.zeros(len(xy_px), dtype=np.int64))
    return replace(pair, explained=explained, projector_rms_px=rms_px)


def test_a_residual_in_pixels_is_told_as_the_distance_by_which_the_wall_would_be_off(room):
    pair, by_m = lit_wall(room, 1.0), 0.02
    points, wall = lit_points(pair), pair.planes[0]
    moved = wall / (1 + by_m * np.linalg.norm(wall))
    there = points / (points @ moved)[:, None]
    off_px = np.median(np.linalg.norm(project(pair.projector, there) - project(pair.projector, points), axis=1))
    assert misfit_at_walls_m(replace(pair, projector_rms_px=float(off_px))) == pytest.approx(by_m, rel=0.1)


def test_points_that_leave_walls_by_more_than_noise_and_plaster_are_refused_with_both_figures(room):
    rms_px = 3 * MOST_MISFIT_M / misfit_at_walls_m(lit_wall(room, 1.0))
    with pytest.raises(
        CalibrationError, match=r"times what their noise explains \(limit 2.5\); .* 45 mm \(limit 15 mm\)"
    ):
        check_walls_fit(lit_wall(room, rms_px), rms_px / 4)


@pytest.mark.parametrize(("misfits", "noises"), [(0.9, 10.0), (3.0, 2.4), (3.0, np.nan)])
def test_rough_walls_and_noisy_maps_are_no_reason_to_refuse(room, misfits, noises):
    rms_px = misfits * MOST_MISFIT_M / misfit_at_walls_m(lit_wall(room, 1.0))
    check_walls_fit(lit_wall(room, rms_px), rms_px / noises)
