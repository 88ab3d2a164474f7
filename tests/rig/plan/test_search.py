"""The search for designs."""

from typing import Any

import pytest

from rig.errors import UsageError
from rig.plan.request import PlanRequest
from rig.plan.run import run_plan
from rig.plan.search.evaluate import with_values
from rig.plan.search.run import search_designs
from rig.plan.search.words import result_of
from tests.rig.plan.rooms import projector, room

FREE = [
    {"key": "projector.position_m.x", "low": 0.4, "high": 2.4},
    {"key": "projector.throw_ratio", "low": 0.3, "high": 1.0},
]
GOALS = [{"measure": "brightness"}, {"measure": "coverage", "weight": 1e-9, "at_least": 0.3}]
BRIGHT = {"white_cdm2": 60, "pictures": ["outdoor"]}
PAINTS = [{"name": name, "reflectance": rho, "cost": cost} for name, rho, cost in (("a", 0.8, 9.0), ("b", 0.4, 4.0))]


def searching(**changes: Any) -> PlanRequest:
    search = {"free": FREE, "goal": GOALS, "evaluations": 40, "width_px": 32, **changes}
    return room(search=search, room={"size_m": [4.8, 4.8, 2.4], "patch_m": 1.2}, named_paint=PAINTS, show=BRIGHT)


def test_the_brightest_picture_that_is_large_enough_is_found_within_the_allowance() -> None:
    found = search_designs(searching())
    assert len(found.tried) == 40
    assert found.best.allowed
    assert found.best.measures["coverage"] >= 0.3
    # The picture shrinks, and brightens, until the limit: a twentieth more light is not to be had.
    limit = min(one.measures["coverage"] for one in found.tried if one.allowed)
    assert found.best.measures["coverage"] < 0.33
    assert limit >= 0.3
    assert found.best.measures["brightness"] > 1.05 * found.given.measures["brightness"]


def test_the_same_search_finds_the_same() -> None:
    assert result_of(search_designs(searching())) == result_of(search_designs(searching()))


def test_no_design_stands_in_a_keep_out_box_or_in_a_wall() -> None:
    box = {"low_m": [0.0, 0.0, 0.0], "high_m": [2.0, 2.0, 2.4], "name": "stage"}
    wide = [{"key": "projector.position_m.x", "low": -1.0, "high": 2.4}, FREE[1]]
    found = search_designs(searching(keep_out=[box], free=wide))
    assert not found.given.allowed
    assert all(one.values["projector.position_m.x"] >= 2.0 for one in found.tried if one.allowed)
    assert found.best.allowed
    assert any("cannot be" in text for text in result_of(found).words)


def test_of_two_goals_the_front_has_only_designs_that_none_beats() -> None:
    goals = [{"measure": "error"}, {"measure": "paint_cost", "weight": 0.5}]
    free = [FREE[0], {"key": "paint.walls", "choices": ["a", "b"]}]
    result = result_of(search_designs(searching(goal=goals, free=free)))
    front = [(one.measures["error"], one.measures["paint_cost"]) for one in result.front]
    assert front == sorted(front)
    assert [cost for _, cost in front] == sorted((cost for _, cost in front), reverse=True)
    assert len({cost for _, cost in front}) == len(front) >= 2
    by_key = {one.key: one for one in result.sensitivity}
    assert by_key["paint.walls"].changed_to in {("a",), ("b",)}
    assert max(one.share for one in result.sensitivity) == pytest.approx(1.0)
    assert result.given.values["paint.walls"] == 0.7


def test_a_limit_that_nothing_keeps_is_said() -> None:
    goals = [{"measure": "brightness", "at_least": 1e5}]
    result = result_of(search_designs(searching(goal=goals, evaluations=10)))
    assert not result.best.allowed
    assert "None of 10 designs keeps all limits" in result.words[0]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"free": [{"key": "projector.lens", "low": 0.0, "high": 1.0}]}, "unknown key"),
        ({"free": [{"key": "beamer.x", "low": 0.0, "high": 1.0}]}, "there is no 'beamer' in the room file"),
        ({"free": [{"key": "projector.position_m.9", "low": 0.0, "high": 1.0}]}, "none of 0 ... 2"),
        ({"free": [{"key": "projector.throw_ratio", "low": 1.0, "high": 0.5}]}, "low below high"),
        ({"free": [{"key": "projector.throw_ratio", "low": 0.5}]}, "give low and high"),
        ({"free": [{"key": "paint.walls", "choices": ["a", "c"]}]}, "no paint is called 'c'"),
        ({"free": [{"key": "paint.walls", "choices": ["a"]}]}, "one choice is none"),
        ({"goal": [GOALS[0], GOALS[0]]}, "brightness is there twice"),
        ({"strategy": "magic"}, "unknown strategy"),
        ({"keep_out": [{"low_m": [1, 1, 1], "high_m": [0, 2, 2]}]}, "low_m must be below high_m"),
    ],
)
def test_a_search_that_cannot_be_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(Exception, match=words) as caught:
        search_designs(searching(**changes))
    assert getattr(caught.value, "exit_code", None) == 2


def test_paint_without_prices_has_no_cost_to_make_small() -> None:
    request = room(search={"free": FREE, "goal": [{"measure": "paint_cost"}]})
    with pytest.raises(UsageError, match=r"no \[\[named_paint\]\] has a cost"):
        search_designs(request)


def test_values_are_put_in_by_their_place_in_the_file() -> None:
    changed = with_values(room(), {"projector.position_m.y": 2.0, "paint.floor": 0.2, "projector.lens_shift.1": 0.1})
    assert changed.projector[0].position_m == (1.2, 2.0, 1.2)
    assert changed.paint == {"all": 0.7, "floor": 0.2}
    assert changed.projector[0].lens_shift == (0.0, 0.1)


def test_a_plan_without_a_search_says_nothing_of_one() -> None:
    assert run_plan(searching(evaluations=8), search=False).search is None
    found = run_plan(room(search=searching(evaluations=8).as_json()["search"], projector=projector())).search
    assert found is not None
    assert found.evaluations == 8


def test_a_room_that_misses_a_limit_is_not_held_up_against_the_best_without_a_word() -> None:
    wide = [*GOALS[:1], {"measure": "coverage", "weight": 1e-9, "at_least": 0.5}]
    (told,) = (
        text for text in result_of(search_designs(searching(goal=wide, evaluations=20))).words if "Beside" in text
    )
    assert told.endswith("As it is, it misses a limit: coverage 0.476, at least 0.5.")
    kept = result_of(search_designs(searching(evaluations=8))).words
    assert not any("misses" in text for text in kept)
