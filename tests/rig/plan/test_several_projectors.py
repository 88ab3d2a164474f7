"""Several projectors in one planned room, beside one projector and beside what a hand can calculate."""

from typing import Any

import numpy as np
import pytest

from rig.errors import ProfileError, UsageError
from rig.plan.compute import plan_room
from rig.plan.light import lit_room
from rig.plan.measures import black_of_patches, white_of_patches
from rig.plan.search.evaluate import with_values
from rig.plan.search.run import search_designs
from rig.plan.search.words import result_of
from rig.plan.shown import solve
from sim.geometry.interpolation import bilinear
from sim.geometry.optics import project
from sim.light.transport_of_scene import irradiance_at
from tests.rig.plan.rooms import projector, room

PICTURES = {"white_cdm2": 20, "pictures": ["outdoor"], "strategies": ["direct", "exact", "bounded"], "width_px": 64}
EAST = projector(name="east", throw_ratio=1.5, position_m=[1.8, 2.4, 1.2], look_at_m=[4.8, 2.4, 1.2])
WEST = projector(name="west", throw_ratio=1.5, position_m=[3.0, 2.4, 1.2], look_at_m=[0.0, 2.4, 1.2])
ASIDE = {**EAST, "name": "aside", "position_m": [1.8, 3.4, 1.2], "look_at_m": [4.8, 3.4, 1.2]}
"""A metre to the side of ``east``: half of their pictures overlap."""
AREA_M2 = 2 * (4.8 * 4.8 + 2 * 4.8 * 2.4)


def several(*projectors: dict[str, Any], **changes: Any) -> Any:
    return room(projector=list(projectors), show=PICTURES, **changes)


def test_two_projectors_of_half_the_lumens_at_one_place_are_one_projector() -> None:
    half = projector(lumens=1500)
    one = plan_room(room(show=PICTURES)).as_json()
    two = plan_room(several({**half, "name": "a"}, {**half, "name": "b"})).as_json()
    assert two["totals"] == pytest.approx(one["totals"], rel=1e-9)
    assert two["contrast"] == pytest.approx(one["contrast"], rel=1e-9)
    for first, second in zip(one["surfaces"], two["surfaces"], strict=True):
        for key in set(first) - {"name", "paint"}:
            assert second[key] == pytest.approx(first[key], rel=1e-9), (first["name"], key)
    for first, second in zip(one["pictures"][0]["strategies"], two["pictures"][0]["strategies"], strict=True):
        # The optimum is certified to a share of its error, not to the last digit.
        assert second["error"] == pytest.approx(first["error"], rel=5e-3), first["strategy"]


def test_light_between_walls_adds_up_to_that_of_an_integrating_cavity() -> None:
    rho = 0.6
    result = plan_room(several(EAST, {**WEST, "lumens": 1000}, paint={"all": rho}))
    assert result.totals.indirect_lux == pytest.approx(rho / (1 - rho) * (3000 + 1000) / AREA_M2, rel=0.02)
    assert sum(one.direct_lux * one.area_m2 for one in result.surfaces) == pytest.approx(4000, rel=1e-3)


def test_pictures_side_by_side_cover_what_both_cover_and_the_overlap_counts_once_and_is_twice_as_bright() -> None:
    request = several(EAST, ASIDE, paint={"all": 0.001, "x1": 0.5})
    result, lit = plan_room(request), lit_room(request)
    assert result.totals.lit_m2 == pytest.approx(3.0 * 1.5, rel=0.01)
    white = lit.luminance(np.ones(lit.n_pixels))
    by_hand = 0.5 / np.pi * 3000 / 3.0
    once, twice = (white[lit.joined.times_lit == times] for times in (1, 2))
    assert len(twice) == pytest.approx(lit.n_pixels / 2, rel=0.05)
    assert np.allclose(once, by_hand, rtol=2e-3)
    assert np.allclose(twice, 2 * by_hand, rtol=2e-3)


def test_in_the_overlap_the_projector_named_first_says_what_is_wanted() -> None:
    lit = lit_room(several(EAST, ASIDE))
    shown = iter([lambda x: x, lambda x: -1 - x])

    def ramp(shape: tuple[int, int]) -> np.ndarray:
        return next(shown)(np.tile(np.arange(shape[1], dtype=float), (shape[0], 1)))

    wanted = lit.pictures(ramp)
    second = lit.joined.parts[1]
    place = lit.joined.points_m[second]
    overlapped = lit.joined.times_lit[second] == 2
    column = 63 / 2 - (place[:, 1] - 2.4) / 2.0 * 64
    assert np.allclose(wanted[second][~overlapped], np.tile(-1 - np.arange(64.0), 48)[~overlapped])
    assert np.allclose(wanted[second][overlapped], np.clip(column, 0, 63)[overlapped], atol=1e-6)


def test_what_a_strategy_is_told_of_the_overlap_holds_when_each_pixels_light_is_followed() -> None:
    lit = lit_room(several(EAST, ASIDE))
    target = np.where(lit.lit, lit.to_units(lit.pictures(lambda shape: np.full(shape, 8.0))), 0.0)
    found = solve(lit, "bounded", target)
    east, aside = lit.views
    lights = [found.projector_image[part].reshape(48, 64) for part in lit.joined.parts]
    inside = (lit.joined.times_lit[lit.joined.parts[1]] == 2) & (aside.hits.uv[:, 0] > 0)
    points, patch = aside.points_m[inside], aside.hits.patch[inside]
    there = irradiance_at(lit.room.surface, east.lens, east.pose, points_m=points, patch=patch)
    rows, columns, weights = bilinear(project(east.lens, east.pose, points), 64, 48)
    followed = there * (lights[0][rows, columns] * weights).sum(axis=1)
    followed += aside.own_irradiance[inside] * lights[1].ravel()[inside]
    rho = lit.room.surface.reflectance[patch]
    told = (lit.transport.direct @ found.projector_image)[lit.joined.parts[1]][inside]
    assert np.allclose(rho * followed, told, rtol=0.01, atol=0.002 * told.max())


def test_white_and_black_of_two_projectors_of_unlike_contrast_are_the_sums_of_each_alone() -> None:
    poor = {**WEST, "contrast": 100, "lumens": 1000}
    lights = [white_of_patches, black_of_patches]
    both, *alone = (lit_room(several(*those)) for those in ((EAST, poor), (EAST,), (poor,)))
    for light in lights:
        assert np.allclose(light(both), sum(light(one) for one in alone), rtol=1e-9)
    seen = both.luminance(np.full(both.n_pixels, both.black))
    own = [one.luminance(np.full(one.n_pixels, one.black)) for one in alone]
    assert (seen[both.joined.parts[1]] > own[1]).all()
    assert np.allclose(seen[both.joined.parts[1]], own[1], rtol=0.3)


def test_a_box_keeps_one_projectors_light_from_anothers_picture() -> None:
    front = projector(throw_ratio=0.8, position_m=[0.6, 2.4, 1.2], look_at_m=[4.8, 2.4, 1.2])
    scene = {"scene": "room-with-box", "patch_m": 0.5}
    lit = lit_room(several({**front, "name": "a"}, {**front, "name": "b", "position_m": [0.6, 0.6, 1.2]}, room=scene))
    assert set(np.unique(lit.joined.times_lit)) == {1, 2}


def test_a_person_stops_the_light_of_each_projector_whose_way_they_stand_in() -> None:
    result = plan_room(several(EAST, WEST, person=[{"name": "visitor", "at_m": [3.6, 2.4]}]))
    assert set(result.shadows[0].by_surface_m2) == {"x1"}


def test_fewer_projectors_can_be_used_than_are_described() -> None:
    both, first = several(EAST, WEST), several(EAST, WEST, projectors_used=1)
    assert plan_room(first).totals == plan_room(several(EAST)).totals
    assert plan_room(both).totals.coverage == pytest.approx(2 * plan_room(first).totals.coverage, rel=1e-3)


def test_a_search_says_how_many_projectors_are_worth_their_price() -> None:
    priced = [{**one, "cost": 1000} for one in (EAST, WEST)]
    search = {
        "free": [
            {"key": "projectors_used", "choices": [1, 2]},
            {"key": "projector.east.throw_ratio", "low": 1.2, "high": 1.8},
        ],
        "goal": [{"measure": "cost"}, {"measure": "coverage", "weight": 1e-9, "at_least": 0.05}],
        "evaluations": 16,
        "width_px": 32,
    }
    found = result_of(search_designs(several(*priced, search=search)))
    assert found.best.measures["cost"] == 2000
    assert found.best.values["projectors_used"] == 2
    search["goal"] = [{"measure": "cost"}]
    assert result_of(search_designs(several(*priced, search=search))).best.measures["cost"] == 1000


def test_a_key_names_a_projector_by_its_name_or_number() -> None:
    for key in ("projector.west.lumens", "projector.2.lumens"):
        assert [one.lumens for one in with_values(several(EAST, WEST), {key: 500.0}).projector] == [3000, 500]
    with pytest.raises(UsageError, match="'north' is none of east, west"):
        with_values(several(EAST, WEST), {"projector.north.lumens": 500.0})


@pytest.mark.parametrize(
    ("projectors", "changes", "words"),
    [
        (
            [EAST, {**WEST, "position_m": [9, 1, 1]}],
            {},
            r"projector\.west\.position_m: \(9, 1, 1\) m is not in the air",
        ),
        ([EAST, {**WEST, "throw_ratio": 0.01}], {}, r"projector\.west\.throw_ratio: 0.01 is a picture"),
        ([EAST, EAST], {}, r"projector\.east\.name: is there twice"),
        ([EAST, {k: v for k, v in WEST.items() if k != "lumens"}], {}, r"projector\.west\.lumens: missing"),
        ([EAST, WEST], {"projectors_used": 3}, r"projectors_used: 3, but there are 2"),
        ([], {}, r"projector"),
    ],
)
def test_of_several_projectors_a_message_names_the_one(
    projectors: list[dict[str, Any]], changes: dict[str, Any], words: str
) -> None:
    with pytest.raises((UsageError, ProfileError), match=words):
        plan_room(several(*projectors, **changes))
