"""What is expected of surfaces that nobody saw: by what they are to those that were seen."""

import numpy as np
import pytest

from calibration.light.alike import Alike, expected_reflectance

WALLS, THINGS = 3, 2
ROOM = Alike.with_things(WALLS, THINGS, backs=True)
"""Surfaces 0 to 2 are walls, 3 and 4 fronts of things, 5 and 6 their backs."""
SURFACE = np.arange(WALLS + 2 * THINGS)
REFLECTANCE = np.array([0.7, 0.8, 0.1, 0.2, 0.4, 0.1, 0.1])


def expected(*seen: int) -> tuple[np.ndarray, np.ndarray]:
    return expected_reflectance(REFLECTANCE, np.isin(SURFACE, seen), surface=SURFACE, alike=ROOM)


def test_a_wall_that_nobody_saw_is_expected_to_be_like_the_other_walls_not_like_dark_things_before_them() -> None:
    values, _ = expected(0, 1, 3, 4)
    assert values[2] == pytest.approx(0.75)


def test_a_thing_of_which_nothing_is_seen_is_expected_to_be_like_the_other_things_and_may_be_of_any_colour() -> None:
    values, spread = expected(0, 1, 3)
    assert values[4] == pytest.approx(0.2)
    assert spread[4] > 2 * spread[2]


def test_a_back_is_expected_to_be_like_its_own_front() -> None:
    values, spread = expected(0, 1, 3, 4)
    assert values[[5, 6]] == pytest.approx([0.2, 0.4])
    assert (spread[[5, 6]] > spread[[3, 4]]).all()


def test_a_back_whose_front_nobody_saw_is_expected_to_be_like_the_other_things() -> None:
    values, spread = expected(0, 1, 4)
    assert values[5] == pytest.approx(0.4)
    assert spread[5] == spread[3]


def test_the_unseen_part_of_a_surface_is_expected_to_be_like_its_seen_part() -> None:
    values, spread = expected_reflectance(
        np.array([0.3, 0.9, 0.7]), np.array([1, 0, 1], bool), surface=np.array([0, 0, 1]), alike=ROOM
    )
    assert values[0] == pytest.approx(0.3)
    assert spread[0] < spread[2]


def test_walls_of_which_none_is_seen_are_expected_to_be_like_what_is() -> None:
    values, _ = expected(3)
    assert values[:WALLS] == pytest.approx(0.2)


def test_a_body_whose_back_is_its_own_has_no_other() -> None:
    assert Alike.with_things(WALLS, THINGS, backs=False).front.tolist() == [0, 1, 2, 3, 4]
