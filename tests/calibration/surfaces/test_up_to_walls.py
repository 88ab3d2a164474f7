"""Things that touch a wall are measured up to it, though light misses the wall by next to nothing there."""

from dataclasses import replace

import numpy as np

from calibration.surfaces.before_walls import before_walls
from calibration.surfaces.flat_parts import parts_of
from calibration.surfaces.pieces import pieces_of
from calibration.surfaces.point_map import point_map
from calibration.surfaces.up_to_walls import up_to_walls
from tests.calibration.surfaces.made import Shape, correspondence_of, nearest, plane, rectangle
from tests.calibration.surfaces.test_free_surfaces import BLOCK, BOX, ROOM_CAMERA, ROOM_PROJECTOR, WALLS

NEAR_PROJECTOR = replace(ROOM_PROJECTOR, translation_m=-ROOM_PROJECTOR.rotation @ np.array((1.5, 0.6, 1.28)))
"""So near to the camera that light 0.2 m before the far wall misses it by half a pixel."""
ROOM = replace(BOX, projector=NEAR_PROJECTOR)
BOARD = rectangle((0.7, 3.5, 0.5), (1.2, 0, 0), (0, 0.5, 1.4))
"""It leans against the wall y1: its upper edge touches it, its lower is half a metre before it."""


def seen_in(shapes: list[Shape], thing: Shape | None = None):
    """Parts that surely are no wall, the same up to the walls, and the pixels that see a thing, or none."""
    seen = correspondence_of(shapes, camera=ROOM_CAMERA, projector=NEAR_PROJECTOR)
    points = point_map(seen, ROOM_CAMERA, NEAR_PROJECTOR)
    told = before_walls(seen, ROOM)
    surely = parts_of(points, pieces_of(points, told.stands, 40), 40)
    rays = points.rays.reshape(-1, 3)
    true_m = nearest(shapes, points.origin_m, rays)
    on = np.zeros(len(rays), bool) if thing is None else thing(points.origin_m, rays) <= true_m + 1e-9
    return surely, up_to_walls(points, surely, told.wall_distance_m), on.reshape(points.known.shape) & points.known


def test_a_board_that_leans_against_a_wall_is_a_thing_up_to_the_wall() -> None:
    surely, whole, on_board = seen_in([*WALLS, BOARD], BOARD)
    told, found = (float((parts.label[on_board] >= 0).mean()) for parts in (surely, whole))
    assert 1 - told > 0.3  # or the test asks for nothing
    assert 1 - found < 0.4 * (1 - told)
    assert (whole.label[~on_board] >= 0).sum() < 0.01 * on_board.sum()
    assert (whole.label[surely.label >= 0] == surely.label[surely.label >= 0]).all()


def test_the_slanting_back_of_a_shallow_niche_is_no_wall() -> None:
    """A window of 1 m in the wall y1, from nothing on one side to 0.4 m deep on the other."""
    sides = ((0, 4, 0), (1, 0, 0), (0, 0, 2.5)), ((2, 4, 0), (1, 0, 0), (0, 0, 2.5))
    rims = ((1, 4, 0), (1, 0, 0), (0, 0, 0.7)), ((1, 4, 1.7), (1, 0, 0), (0, 0, 0.8))
    wall = [rectangle(*one) for one in (*sides, *rims)]
    back = plane((1, 4, 0), (-0.4, 1, 0))
    surely, whole, on_back = seen_in([WALLS[0], WALLS[1], *WALLS[3:], *wall, back], back)
    told, found = (float((parts.label[on_back] >= 0).mean()) for parts in (surely, whole))
    assert 1 - told > 0.3
    assert 1 - found < 0.4 * (1 - told)


def test_what_stands_free_ends_where_it_ends() -> None:
    surely, whole, on_block = seen_in([*WALLS, BLOCK], BLOCK)
    assert (whole.label[~on_block] >= 0).sum() <= (surely.label[~on_block] >= 0).sum() + 3
    assert (surely.label[on_block] >= 0).mean() > 0.95


def test_a_bare_room_stays_bare() -> None:
    surely, whole, _ = seen_in(WALLS)
    assert whole is surely
    assert (whole.label < 0).all()
