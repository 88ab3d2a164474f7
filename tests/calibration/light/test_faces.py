"""Which pixels of a room's picture lie beside the edges of walls, and which beside those of things."""

import numpy as np

from calibration.light.faces import EDGE_PX, away_from_edges, beside_things

FACES = np.zeros((60, 90), np.intp)
FACES[:, 45:] = 1
FACES[20:40, 60:80] = 6
FACES[:10, :12] = -1
"""Two walls that meet at column 45, a thing before the second, and a corner in which there is nothing."""


def test_beside_things_is_what_is_near_their_edges_on_either_side() -> None:
    found = beside_things(FACES, 6)
    assert found[30, 60 - EDGE_PX : 60 + EDGE_PX].all()
    assert not found[30, 60 - EDGE_PX - 1]
    assert not found[30, 60 + EDGE_PX]


def test_the_edge_between_two_walls_is_none_of_a_thing() -> None:
    found, edges = beside_things(FACES, 6), ~away_from_edges(FACES)
    assert edges[30, 44:46].all()
    assert not found[30, 40:50].any()
    assert not (found & ~edges).any()


def test_where_there_is_nothing_another_surface_ends() -> None:
    found = beside_things(FACES, 6)
    assert found[5, 12 - EDGE_PX : 12 + EDGE_PX].all()
