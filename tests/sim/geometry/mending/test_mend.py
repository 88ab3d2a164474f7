"""Rooms as files have them: turned the right way, closed where they nearly are, and told what is left."""

import numpy as np
import pytest

from sim.errors import SimulationError
from sim.geometry.mending.mend import cleaned_facets, facets_of, mended
from sim.geometry.mending.remarks import DamagedMesh
from tests.sim.geometry.mending.damaged_meshes import ball, box, soup_of

ROOM = (4.0, 3.0, 2.5)


def answer(triangles, *, merge_m=None, **options):
    points, corners = soup_of(np.asarray(triangles, dtype=float))
    facets, cleaned = cleaned_facets("room", facets_of(points, corners, np.array(0.7)), merge_m)
    made = mended("room", facets, **options)
    return made, {remark.kind: remark for remark in (*cleaned, *made.remarks)}


def test_a_sound_room_is_left_as_it_is_and_nothing_is_said():
    made, said = answer(box(ROOM))
    assert said == {}
    assert made.mesh.n_patches == 6
    assert made.mesh.closed
    assert made.mesh.convex
    assert not made.by_rays


def test_a_room_with_its_walls_outwards_is_turned_in_words():
    made, said = answer(box(ROOM)[:, ::-1])
    assert "12 facets looked into nothing" in said["inside out"].message
    assert said["inside out"].outcome == "mended"
    assert made.mesh.closed


def test_as_the_file_has_it_means_as_the_file_has_it():
    made, said = answer(box(ROOM)[:, ::-1], sides="file")
    assert not made.mesh.closed
    assert "no facet's lit side sees another's" in said["no exchange"].message


def test_one_wall_the_wrong_way_is_turned_to_its_neighbours():
    room = box(ROOM)
    room[4] = room[4, ::-1]
    made, said = answer(room)
    assert said["inverted"].facets.tolist() == [4]
    assert made.mesh.closed


def test_a_thing_that_is_lit_on_its_inside_only_is_turned_and_the_room_is_not():
    thing = box((1, 1, 1), (1.5, 1, 0.5))
    made, said = answer(np.concatenate([box(ROOM), thing]))
    assert said["inside out"].facets.tolist() == list(range(12, 24))
    lit_outside, nothing_said = answer(np.concatenate([box(ROOM), thing[:, ::-1]]))
    assert nothing_said == {}
    assert np.allclose(np.sort(made.mesh.normals, axis=0), np.sort(lit_outside.mesh.normals, axis=0))


def test_room_and_thing_both_lit_outside_are_a_room_with_a_thing():
    made, said = answer(np.concatenate([box(ROOM), box((1, 1, 1), (1.5, 1, 0.5))])[:, ::-1])
    assert said["inside out"].facets.tolist() == list(range(12))
    assert "leaves" not in said
    assert made.mesh.n_patches == 12


def test_a_missing_wall_is_told_with_the_light_that_leaves():
    room = box(ROOM)
    made, said = answer(np.delete(room, [0, 1], axis=0))
    assert not made.mesh.closed
    assert "m of open border" in said["open"].message
    assert "leaves the scene" in said["leaves"].message


def test_a_screen_within_the_room_loses_light_at_its_back_unless_it_is_given_a_second_side():
    screen = np.array([[(1, 1, 1), (2, 1, 1), (2, 2, 1)], [(1, 1, 1), (2, 2, 1), (1, 2, 1)]], dtype=float)
    _, said = answer(np.concatenate([box(ROOM), screen]))
    assert "meets backs" in said["backs"].message
    made, said = answer(np.concatenate([box(ROOM), screen]), sides="both")
    assert "backs" not in said
    assert made.mesh.areas.sum() == pytest.approx(2 * (12 + 10 + 7.5) + 2)


def test_borders_that_nearly_meet_are_merged_within_the_stated_distance_only():
    rng = np.random.default_rng(1)
    room = box(ROOM)
    made, said = answer(room + rng.uniform(-1e-5, 1e-5, room.shape))
    assert made.mesh.closed
    assert "limit 0.04 mm" in said["near miss"].message
    made, said = answer(room + rng.uniform(-1e-5, 1e-5, room.shape), merge_m=1e-6)
    assert not made.mesh.closed
    assert "open" in said


def test_detail_below_the_distance_is_not_merged_away():
    angle = np.linspace(0, 2 * np.pi, 301)
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    disc = np.stack([np.zeros_like(rim[:-1]), rim[:-1], rim[1:]], axis=1)
    made, said = answer(disc, merge_m=0.05)
    assert made.mesh.areas.sum() == pytest.approx(np.pi, rel=1e-3)
    assert "near miss" not in said


def test_needles_of_one_to_a_thousand_stay_and_what_has_no_area_goes():
    needle = [[(1, 1, 1), (2, 1, 1), (1.5, 1.001, 1)]]
    line = [[(1, 1, 2), (2, 1, 2), (1.5, 1, 2)]]
    made, said = answer(np.concatenate([box(ROOM), needle, line]))
    assert made.mesh.n_patches == 7
    assert said["degenerate"].facets.tolist() == [13]


def test_things_that_cut_through_each_other_go_by_rays():
    rng = np.random.default_rng(0)
    made, said = answer(np.concatenate([box(ROOM), ball(rng), ball(rng)]))
    assert said["intersecting"].outcome == "note"
    assert made.by_rays


def test_area_that_counts_twice_is_refused_with_its_share():
    twice = [[(1, 1, 0), (3, 1, 0), (1, 2.5, 0)]]
    with pytest.raises(DamagedMesh, match=r"overlapping: .* up to 2\.5 % of the surface counts twice") as refusal:
        answer(np.concatenate([box(ROOM), twice]))
    assert {remark.kind for remark in refusal.value.remarks if remark.outcome == "refused"} == {"overlapping"}


def test_a_facet_far_away_is_named_instead_of_a_wrong_unit():
    room = np.concatenate([box(ROOM, cuts=3), [[(1, 1, 1), (2, 1, 1), (2e9, 2, 1)]]])
    with pytest.raises(DamagedMesh, match=r"astray: 1 facet reach 2e\+09 m out of a scene of .*: 108 at \(1, 1, 1\) m"):
        answer(room)


@pytest.mark.parametrize(("scale", "guess"), [(100, r"--unit cm \(4 m\)"), (0.05, "0.2 m large")])
def test_a_size_that_no_room_has_is_asked_about_unless_the_unit_was_given(scale, guess):
    import re

    _, said = answer(box(ROOM) * scale, unit_given=False)
    assert re.search(guess, said["unit"].message)
    assert answer(box(ROOM) * scale)[1] == {}


def test_a_room_on_its_side_is_asked_about():
    _, said = answer(box((4.0, 2.5, 3.5)))
    assert "give another --up" in said["up axis"].message


def test_triangles_of_corners_that_do_not_exist_are_refused():
    with pytest.raises(SimulationError, match=r"1 triangles have corners that do not exist, first 0: \[0, 1, 7\]"):
        facets_of(np.zeros((3, 3)), np.array([[0, 1, 7]]), np.array(0.5))


def test_nothing_but_lines_is_no_mesh():
    with pytest.raises(DamagedMesh, match="no facet has an area"):
        answer([[(0, 0, 0), (1, 0, 0), (2, 0, 0)]])
