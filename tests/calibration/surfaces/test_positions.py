"""One surface from two positions of the camera: placed, compared, merged, and refused where something moved."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.geometry.pinhole import PinholeModel, project, rotation_of
from calibration.surfaces.before_walls import opened
from calibration.surfaces.point_map import PointMap, point_map
from calibration.surfaces.positions.lit_map import covered, lit_map, read_at
from calibration.surfaces.positions.merged import (
    MOST_APART,
    agreement_of,
    looked_at,
    looked_through,
    merged,
    seen_along,
)
from calibration.surfaces.positions.placed import PlacedCamera, place_camera, placement_sigma_m, relative_to
from tests.calibration.surfaces.made import correspondence_of, device, distances, plane, rectangle

PROJECTOR = device((1.1, 0.6, 1.2), (1.5, 4.0, 1.1), width_px=400, height_px=300, focal_px=280.0)
MAIN = device((2.5, 0.7, 1.4), (1.5, 4.0, 1.1))
OTHER = device((0.4, 0.6, 1.3), (1.7, 4.0, 1.1))
ROOM = [
    plane((0, 0, 0), (1, 0, 0)),
    plane((3, 0, 0), (1, 0, 0)),
    plane((0, 4, 0), (0, 1, 0)),
    plane((0, 0, 0), (0, 0, 1)),
    plane((0, 0, 2.5), (0, 0, 1)),
]


def block(x_m=2.0, y_m=2.6):
    """Front and left side of a block that stands on the floor; the main camera does not see the left one."""
    return [rectangle((x_m, y_m, 0), (0.5, 0, 0), (0, 0, 1.3)), rectangle((x_m, y_m, 0), (0, 0.6, 0), (0, 0, 1.3))]


@cache
def seen_by_main() -> PointMap:
    decoded = correspondence_of([*ROOM, *block()], camera=MAIN, projector=PROJECTOR, seed=1)
    return point_map(decoded, MAIN, PROJECTOR)


def start_of(camera: PinholeModel) -> PinholeModel:
    """A lens half a per cent too long, 3 cm and 1.5 degrees away from where it stands."""
    turn = rotation_of([0.02, -0.015, 0.01])
    return replace(
        camera,
        rotation=turn @ camera.rotation,
        translation_m=turn @ camera.translation_m + np.array([0.02, -0.02, 0.01]),
        focal_px=(1.005 * camera.focal_px[0], 1.005 * camera.focal_px[1]),
    )


@cache
def placed_in(x_m=2.0, shift_m=0.0, projector_m=0.0) -> tuple[PlacedCamera, PointMap]:
    """The other camera, placed by the main one's points, and its own; block and projector may have moved."""
    moved = replace(PROJECTOR, translation_m=PROJECTOR.translation_m + np.array([projector_m, 0, 0]))
    shapes = [*ROOM, *block(x_m, 2.6 + shift_m)]
    decoded = correspondence_of(shapes, camera=OTHER, projector=moved, seed=2)
    placed = place_camera(lit_map(seen_by_main(), PROJECTOR), PROJECTOR, decoded, start_of(OTHER))
    return placed, point_map(decoded, placed.camera, PROJECTOR)


def along_main(points: PointMap):
    return seen_along(seen_by_main(), lit_map(points, PROJECTOR), PROJECTOR)


def test_a_projectors_pixels_are_as_far_as_what_they_light():
    lit = lit_map(seen_by_main(), PROJECTOR)
    off = (lit.distance_m - distances([*ROOM, *block()], PROJECTOR))[lit.known]
    assert lit.known.sum() > 0.8 * covered(seen_by_main(), seen_by_main().known, PROJECTOR).sum()
    assert np.median(np.abs(off)) < 0.3 * np.median(seen_by_main().sigma_m[seen_by_main().known])
    assert 0.7 < np.sqrt(np.mean(np.clip(off / lit.sigma_m[lit.known], -5, 5) ** 2)) < 1.3


def test_no_projector_pixel_lies_between_a_thing_and_the_wall_behind():
    lit = lit_map(seen_by_main(), PROJECTOR)
    off_m = np.abs(lit.distance_m - distances([*ROOM, *block()], PROJECTOR))
    bridged = (off_m > 0.1) & (np.abs(lit.distance_m - distances(ROOM, PROJECTOR)) > 0.1)
    assert bridged.sum() < 1e-3 * lit.known.sum()


def test_what_is_read_between_pixels_needs_all_four():
    image = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, np.nan]])
    found = read_at(image, np.array([(0.5, 0.5), (1.5, 0.5), (-0.1, 0.0), (np.nan, 0.0), (0.0, 1.0)]))
    np.testing.assert_array_equal(found, [2.0, np.nan, np.nan, np.nan, 3.0])


def test_a_camera_is_placed_by_what_both_positions_saw():
    placed, _ = placed_in()
    assert np.linalg.norm(placed.camera.position_m - OTHER.position_m) < 2e-3
    assert placed.camera.focal_px[0] == pytest.approx(OTHER.focal_px[0], rel=1e-3)
    assert placed.residual_px < 0.1


def test_its_places_are_as_uncertain_as_is_stated():
    placed, points = placed_in()
    decoded = correspondence_of([*ROOM, *block()], camera=OTHER, projector=PROJECTOR, sigma_px=0.0)
    exact, found = (point_map(decoded, camera, PROJECTOR) for camera in (OTHER, placed.camera))
    stated = placement_sigma_m(placed, PROJECTOR, decoded, found)
    off_m = np.linalg.norm(
        found.distance_m[..., None] * found.rays
        + found.origin_m
        - exact.distance_m[..., None] * exact.rays
        - OTHER.position_m,
        axis=-1,
    )
    assert np.nanmedian(off_m) < 2.5 * np.nanmedian(stated)
    assert np.nanmedian(stated) < 1e-3
    assert points.known.sum() > 20_000


def test_a_camera_is_carried_over_by_the_projector_that_both_worlds_know():
    turn, shift_m = rotation_of([0.3, -0.2, 0.5]), np.array([1.0, 2.0, -0.5])
    there = [
        replace(each, rotation=each.rotation @ turn, translation_m=each.translation_m + each.rotation @ shift_m)
        for each in (OTHER, PROJECTOR)
    ]
    found = relative_to(PROJECTOR, *there)
    np.testing.assert_allclose(found.rotation, OTHER.rotation, atol=1e-12)
    np.testing.assert_allclose(found.position_m, OTHER.position_m, atol=1e-12)


def test_a_camera_that_sees_next_to_nothing_of_it_is_refused():
    away = device((2.9, 0.6, 1.3), (3.0, 1.6, 0.2))
    decoded = correspondence_of([*ROOM, *block()], camera=away, projector=PROJECTOR)
    none = replace(decoded, reason=np.ones_like(decoded.reason))
    with pytest.raises(CalibrationError, match="at least 1000 are needed"):
        place_camera(lit_map(seen_by_main(), PROJECTOR), PROJECTOR, none, away)


def test_positions_that_saw_the_same_agree_within_their_sigmas():
    found = agreement_of(seen_by_main(), *along_main(placed_in()[1]))
    assert found.share_of_seen > 0.45
    assert found.median < MOST_APART
    assert 0.7 < found.sigmas < 1.3
    assert not found.elsewhere.any()


def test_merged_points_are_nearer_to_the_truth_and_say_so():
    points, true_m = seen_by_main(), distances([*ROOM, *block()], MAIN)
    along_m, sigma_m = along_main(placed_in()[1])
    both = points.known & np.isfinite(along_m)
    better = merged(points, along_m, sigma_m)
    before, after = (one.distance_m[both] - true_m[both] for one in (points, better))
    assert np.sqrt(np.mean(after**2)) < 0.8 * np.sqrt(np.mean(before**2))
    np.testing.assert_array_equal(better.sigma_m, points.sigma_m, "neighbours share the mean's noise")
    np.testing.assert_array_equal(better.distance_m[~both], points.distance_m[~both])


def test_only_the_other_position_sees_the_left_side():
    _, points = placed_in()
    known = covered(seen_by_main(), np.ones_like(seen_by_main().known), PROJECTOR)
    places = points.origin_m + points.distance_m[..., None] * points.rays
    left = points.known & (np.abs(places[..., 0] - 2.0) < 0.02) & (places[..., 1] > 2.65) & (places[..., 1] < 3.15)
    there = np.zeros_like(left)
    there[points.known] = read_at(known.astype(float), project(PROJECTOR, places[points.known])) > 0
    assert left.sum() > 500
    assert (left & there).sum() < 0.1 * left.sum()


@pytest.mark.parametrize("shift_m", [0.05, -0.08])
def test_a_thing_that_moved_is_found_where_it_stands_and_by_how_much(shift_m):
    found = agreement_of(seen_by_main(), *along_main(placed_in(shift_m=shift_m)[1]))
    places = seen_by_main().origin_m + seen_by_main().distance_m[..., None] * seen_by_main().rays
    front = seen_by_main().known & (np.abs(places[..., 1] - 2.6) < 0.03)
    assert (found.elsewhere & front).sum() > 0.8 * found.elsewhere.sum()
    assert found.elsewhere_m == pytest.approx(shift_m, rel=0.2)
    assert found.median < MOST_APART, "the walls are where they were"


@pytest.mark.parametrize("moved_m", [0.03, 0.1])
def test_a_projector_that_moved_leaves_points_that_do_not_fit(moved_m):
    found = agreement_of(seen_by_main(), *along_main(placed_in(projector_m=moved_m)[1]))
    assert found.median > MOST_APART or found.elsewhere.any()


def test_what_the_main_camera_looks_through_is_found():
    """A post that came after the main camera's photographs, where its light landed on the wall."""
    post = rectangle((0.9, 2.5, 0), (0.25, 0, 0), (0, 0, 1.6))
    decoded = correspondence_of([*ROOM, *block(), post], camera=OTHER, projector=PROJECTOR)
    points = point_map(decoded, OTHER, PROJECTOR)
    through = looked_through(seen_by_main(), MAIN, points)
    on_post = distances([post], OTHER) < np.inf
    assert (through & on_post).sum() > 200
    assert looked_through(seen_by_main(), MAIN, placed_in()[1]).mean() < 0.01, "but beside edges"


def test_a_strip_along_an_edge_is_not_looked_through():
    strip, whole = np.zeros((9, 20), dtype=bool), np.zeros((9, 20), dtype=bool)
    strip[3:5, 2:18] = whole[2:5, 4:7] = True
    assert not opened(strip, 3).any()
    np.testing.assert_array_equal(opened(strip | whole, 3), whole)


def test_of_what_a_camera_sees_or_looks_through_no_guess_is_needed():
    """Places on the block's front, before it, behind it, behind the camera, and beside its picture."""
    places_m = np.array([(2.25, 2.6, 0.9), (2.3, 2.0, 1.0), (2.25, 3.5, 0.7), (2.5, 0.0, 1.4), (-9.0, 1.0, 1.4)])
    np.testing.assert_array_equal(looked_at(seen_by_main(), MAIN, places_m), [True, True, False, False, False])


def test_rays_that_meet_no_surface_have_no_distance():
    empty = replace(seen_by_main(), distance_m=np.full_like(seen_by_main().distance_m, np.nan))
    distance_m, sigma_m = along_main(empty)
    assert not np.isfinite(distance_m).any()
    assert not np.isfinite(sigma_m).any()
    assert agreement_of(seen_by_main(), distance_m, sigma_m).median == np.inf
