"""One design: the room file with some values put in, and the numbers that the goals ask for."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from rig.errors import UsageError
from rig.plan.light import LitRoom, lit_room
from rig.plan.measures import contrast_steps, totals
from rig.plan.paints import chosen_paint
from rig.plan.request import PlanRequest, request_of
from rig.plan.room import ImpossiblePlace
from rig.plan.search.records import Design
from rig.plan.search.request import FreeParameter, KeepOut, SearchGoal, SearchTable
from rig.plan.shown import VISIBLE, WHITE, checked_strategies, picture_levels, solve
from rig.records import Json, JsonObject

LARGER_IS_BETTER = ("brightness", "coverage", "contrast", "density")
AXES = {"x": 0, "y": 1, "z": 2}


@dataclass(frozen=True, eq=False, kw_only=True)
class DesignSpace:
    """What may change, and what is wanted."""

    request: PlanRequest
    search: SearchTable
    spreads: Mapping[str, float] = field(default_factory=dict)
    """Of each goal's measure over some designs; 1 where it is missing."""

    def design(self, values: Mapping[str, float | str]) -> Design:
        """Return a design computed."""
        request = with_values(self.request, values)
        kept_out = keep_out_depth(request, self.search.keep_out) > 0
        try:
            measures = {} if kept_out else measures_of(request, self.search)
        except ImpossiblePlace:
            measures = {}
        allowed = bool(measures) and self.broken(measures) == 0
        return Design(values=values, measures=measures, score=0.0, allowed=allowed)

    def depth_m(self, values: Mapping[str, float | str]) -> float:
        """Return how far a projector stands within keep-out boxes or outside of a box-shaped room. [m]."""
        request = with_values(self.request, values)
        at = np.array([one.position_m for one in request.projectors])
        size = np.array(request.room.size_m or (np.inf,) * 3)
        outside = float(np.maximum(np.maximum(-at, at - size), 0.0).max()) if request.room.size_m else 0.0
        return max(outside, keep_out_depth(request, self.search.keep_out))

    def broken(self, measures: Mapping[str, float]) -> float:
        """Return by which share of their values limits are broken, all together."""
        return sum(_broken(goal, measures[goal.measure]) for goal in self.search.goal)

    def badness(self, goal: SearchGoal, measures: Mapping[str, float]) -> float:
        """Return a goal's measure, smaller better, over its spread."""
        sign = -1.0 if goal.measure in LARGER_IS_BETTER else 1.0
        return sign * measures[goal.measure] / self.spreads.get(goal.measure, 1.0)


def _broken(goal: SearchGoal, value: float) -> float:
    """By which share a limit is broken; 0 where it is kept."""
    low, high = goal.at_least, goal.at_most
    under = 0.0 if low is None else max(0.0, low - value) / max(abs(low), 1e-9)
    over = 0.0 if high is None else max(0.0, value - high) / max(abs(high), 1e-9)
    return under + over


def with_values(request: PlanRequest, values: Mapping[str, float | str]) -> PlanRequest:
    """Return a request with other values in the places of some keys."""
    data: JsonObject = copy.deepcopy(request.as_json())
    for key, value in values.items():
        _put(data, key, value)
    return request_of(data)


def _put(data: JsonObject, key: str, value: float | str) -> None:
    *way, last = _way(data, key)
    place: Json = data
    for part in way:
        place = _inside(place, part, key)
    if isinstance(place, dict):
        place[last] = value
    elif isinstance(place, list):
        place[_index(place, last, key)] = value
    else:
        raise UsageError(f"search.free: {key!r} leads nowhere in the room file; write table and key, e.g. paint.all")


def _way(data: JsonObject, key: str) -> list[str]:
    """The words of a key; of the only projector, its number may be left out."""
    words = key.split(".")
    tables = data.get(words[0])
    alone = isinstance(tables, list) and len(tables) == 1 and isinstance(tables[0], dict)
    return [words[0], "1", *words[1:]] if alone and words[1:2] != ["1"] else words


def _entry(place: list[Json], part: str, key: str) -> Json:
    """An entry of a list: a table by its name or its number from 1 on, as messages have it; else as an index."""
    tables = [one for one in place if isinstance(one, dict)]
    named = [one for one in tables if one.get("name") == part]
    if named or not tables:
        return named[0] if named else place[_index(place, part, key)]
    if not part.isdigit() or not 1 <= int(part) <= len(tables):
        there = ", ".join(str(one.get("name", k)) for k, one in enumerate(tables, 1))
        raise UsageError(f"search.free: {key!r}: {part!r} is none of {there}; name one of these")
    return tables[int(part) - 1]


def _inside(place: Json, part: str, key: str) -> Json:
    if isinstance(place, dict) and part in place:
        return place[part]
    if isinstance(place, list):
        return _entry(place, part, key)
    there = ", ".join(place) if isinstance(place, dict) else "nothing below"
    raise UsageError(f"search.free: {key!r}: there is no {part!r} in the room file; there are {there}")


def _index(place: list[Json], part: str, key: str) -> int:
    index = AXES.get(part, int(part) if part.isdigit() else -1)
    if not 0 <= index < len(place):
        raise UsageError(
            f"search.free: {key!r}: {part!r} is none of 0 ... {len(place) - 1} (or x, y, z); name one of these"
        )
    return index


def value_at(request: PlanRequest, key: str) -> float | str | None:
    """Return what a request has in the place of a key; None where it says nothing."""
    *way, last = _way(request.as_json(), key)
    place: Json = request.as_json()
    for part in way:
        place = _inside(place, part, key)
    if isinstance(place, list):
        place = {last: place[_index(place, last, key)]}
    found = place.get(last) if isinstance(place, dict) else None
    return found if isinstance(found, float | int | str) else None


def keep_out_depth(request: PlanRequest, boxes: tuple[KeepOut, ...]) -> float:
    """Return how deep a projector stands in a keep-out box, 0 where none is in any. [m]."""
    at = np.array([one.position_m for one in request.projectors])
    depths = [float(np.minimum(at - box.low_m, np.array(box.high_m) - at).min(axis=1).max()) for box in boxes]
    return max([0.0, *depths])


def check_search(request: PlanRequest, search: SearchTable) -> None:
    """Raise UsageError for ranges that are none, unknown choices, goals that cannot be told."""
    for one in search.free:
        _check_free(request, one)
    keys = [one.key for one in search.free]
    for key in dict.fromkeys(keys):
        if keys.count(key) > 1:
            raise UsageError(f"search.free: {key} is there twice; give each key one range")
    for goal in search.goal:
        if goal.at_least is not None and goal.at_most is not None and goal.at_least > goal.at_most:
            raise UsageError(
                f"search.goal: {goal.measure} at least {goal.at_least:g} and at most {goal.at_most:g} exclude each "
                "other; change one"
            )
    names = [goal.measure for goal in search.goal]
    doubled = sorted({name for name in names if names.count(name) > 1})
    if doubled:
        raise UsageError(f"search.goal: {doubled[0]} is there twice; give each measure once")
    checked_strategies((search.strategy,))
    if "paint_cost" in names and not any(paint.cost for paint in request.named_paint):
        raise UsageError("search.goal: paint_cost, but no [[named_paint]] has a cost; give some of them one")
    priced = [paint.cost for paint in request.named_paint] + [one.cost for one in request.projector]
    if "cost" in names and not any(priced):
        raise UsageError("search.goal: cost, but no projector and no [[named_paint]] has one; give some of them one")
    for box in search.keep_out:
        if not all(low < high for low, high in zip(box.low_m, box.high_m, strict=True)):
            raise UsageError(
                f"search.keep_out {box.name}: low_m must be below high_m along x, y and z; exchange what is not"
            )


def _check_free(request: PlanRequest, one: FreeParameter) -> None:
    ranged = one.low is not None and one.high is not None
    if ranged == bool(one.choices) or (ranged and not (one.low or 0.0) < (one.high or 0.0)):
        raise UsageError(f"search.free {one.key}: give low and high, low below high, or choices")
    if one.choices and len(one.choices) < 2:
        raise UsageError(f"search.free {one.key}: one choice is none; give two or more")
    if one.key.startswith("paint."):
        for paint in one.choices:
            chosen_paint(paint, request.named_paint, f"search.free {one.key}")
    for value in (one.low, one.high) if ranged else one.choices:
        if value is not None:
            with_values(request, {one.key: value})


def measures_of(request: PlanRequest, search: SearchTable) -> dict[str, float]:
    """Return the goals' measures of a request, each computed only if a goal asks for it."""
    lit = lit_room(request, search.width_px)
    found: dict[str, float] = {}
    for goal in search.goal:
        if goal.measure not in found:
            found |= _MEASURES[goal.measure](lit, request, search)
    return {goal.measure: found[goal.measure] for goal in search.goal}


def _totals(lit: LitRoom, request: PlanRequest, _search: SearchTable) -> dict[str, float]:
    all_ = totals(lit, request.show.white_cdm2)
    return {
        "brightness": all_.white_cdm2,
        "coverage": all_.coverage,
        "global_share": all_.global_share,
        "density": all_.px_per_m,
        "paint_cost": all_.paint_cost,
        "cost": all_.paint_cost + all_.projector_cost,
    }


def _contrast(lit: LitRoom, _request: PlanRequest, _search: SearchTable) -> dict[str, float]:
    return {"contrast": contrast_steps(lit).checker_in_room}


def _errors(lit: LitRoom, request: PlanRequest, search: SearchTable) -> dict[str, float]:
    """Mean error over the pictures, and the mean share of the picture's area that the strategy misses."""
    white, area = request.show.white_cdm2, lit.footprints_m2
    errors, missed = [], []
    for name in request.show.pictures:
        wanted = np.where(lit.lit, lit.pictures(partial(picture_levels, name)) * white / WHITE, 0.0)
        found = solve(lit, search.strategy, np.where(lit.lit, lit.to_units(wanted), 0.0))
        off = np.abs(lit.from_units(found.predicted) + lit.unstoppable_cdm2 - wanted)
        errors.append(float(off[lit.lit].mean()) * WHITE / white)
        missed.append(float(area[off > VISIBLE * white].sum() / area.sum()))
    return {"error": float(np.mean(errors)), "unreached": float(np.mean(missed))}


_MEASURES: Mapping[str, Callable[[LitRoom, PlanRequest, SearchTable], dict[str, float]]] = {
    **dict.fromkeys(("brightness", "coverage", "global_share", "density", "paint_cost", "cost"), _totals),
    "contrast": _contrast,
    "error": _errors,
    "unreached": _errors,
}
