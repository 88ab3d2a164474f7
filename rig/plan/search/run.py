"""The search for designs: scipy's DIRECT over the whole box, then its simplex from the best; the same every time.

One goal: DIRECT (locally biased, which cuts the box into ever smaller ones about what is good) with two thirds of the
designs that may be looked at, then a simplex (Nelder-Mead) from the best. Several goals: the same for their weighted
sum with most of them, and for each goal alone with the rest, so that the front has its ends. Both are scipy's; neither
draws a number, so that a search has no seed.

References: Jones, Perttunen and Stuckman, Journal of Optimization Theory and Applications 79, 1993; Gablonsky and
Kelley, Journal of Global Optimization 21, 2001; Nelder and Mead, The Computer Journal 7, 1965.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import direct, minimize

from rig.errors import UsageError
from rig.plan.request import PlanRequest
from rig.plan.search.evaluate import DesignSpace, check_search, value_at
from rig.plan.search.records import Design
from rig.plan.search.request import FreeParameter, SearchGoal, SearchTable
from rig.terminal import OnStep, silent

FloatArray = NDArray[np.float64]

GLOBAL = 0.65
"""Share of the designs that DIRECT may look at; the simplex has the rest. From the study's rooms."""
START = 0.25
"""Share of the first goal's designs after which the spread of goals is taken."""
ENDS = 0.15
"""Share for each goal alone, where there are several."""
SIMPLEX = 0.08
"""First steps of the simplex, of each range."""
PENALTY = 10.0
"""Of a limit that is broken by all of its value, in spreads of the score: soft, so that one can walk along it."""
IMPOSSIBLE = 1e9
"""What a place in a wall or a keep-out box counts."""
SLIGHT = 1e-3
"""Weight of the sum beside a goal alone."""
MOST_CALLS = 100_000
"""Of one optimiser; the allowance ends it before."""
LIMIT_ONLY = 1e-6
"""Of the largest weight: a goal below it stands for its limit only."""

Score = Callable[[Design], float]


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundDesigns:
    """All designs that were looked at, and by what goals are weighed."""

    space: DesignSpace
    given: Design
    tried: tuple[Design, ...]
    best: Design

    @property
    def spreads(self) -> Mapping[str, float]:
        """Of the goals' measures."""
        return self.space.spreads


class _Enough(Exception):
    """The designs that may be looked at are used up."""


class _DesignLooker:
    """Computes designs, each once, until the allowance is used up."""

    def __init__(self, space: DesignSpace, on_step: OnStep) -> None:
        self.space, self.on_step = space, on_step
        self.free = space.search.free
        self.tried: dict[tuple[float | str, ...], Design] = {}
        self.allowance = space.search.evaluations

    def __call__(self, x: FloatArray) -> Design:
        """Return the design at a point of the search's box."""
        values = tuple(value_of(one, float(coordinate)) for one, coordinate in zip(self.free, x, strict=True))
        if values not in self.tried:
            if len(self.tried) >= self.allowance:
                raise _Enough
            keys = (one.key for one in self.free)
            self.tried[values] = self.space.design(dict(zip(keys, values, strict=True)))
            self.on_step("search", len(self.tried), self.space.search.evaluations)
        return self.tried[values]

    def softly(self, score: Score) -> Callable[[FloatArray], float]:
        """Return what an optimiser makes small: the score, broken limits and impossible places added in its spreads."""

        def objective(x: FloatArray) -> float:
            design = self(x)
            known = [score(one) for one in self.tried.values() if one.measures]
            spread = max(float(np.std(known)), 1e-9) if known else 1.0
            if not design.measures:
                # Deeper in a wall is worse, so that the way out can be seen.
                return max(known, default=0.0) + PENALTY * spread * (1 + self.space.depth_m(design.values))
            return score(design) + PENALTY * spread * self.space.broken(design.measures)

        return objective

    def place_of(self, design: Design) -> FloatArray:
        """Return the point of the box that has a design."""
        values = (design.values[one.key] for one in self.free)
        return np.array([coordinate_of(one, value) for one, value in zip(self.free, values, strict=True)])


def search_designs(request: PlanRequest, on_step: OnStep = silent) -> FoundDesigns:
    """Look for the best designs of a room.

    Parameters
    ----------
    request
        With a ``[search]``.
    on_step
        Told how far it is.

    Raises
    ------
    UsageError
        For a search that cannot be, or a room that cannot.
    """
    search = request.search
    if search is None:
        raise UsageError("the room file has no [search]; say what is free and what is wanted")
    check_search(request, search)
    space = DesignSpace(request=request, search=search)
    given = replace(space.design({}), values={one.key: _given(request, one.key) for one in search.free})
    looker = _DesignLooker(space, on_step)
    goals = weighty(search) if len(weighty(search)) > 1 else []
    whole = looker.allowance
    if goals:
        looker.allowance = round(START * whole)
        _look_everywhere(looker, partial(score_of, space))
        space = replace(space, spreads=_spreads(search, list(looker.tried.values())))
    looker.allowance = round(whole * (1 - ENDS * len(goals)))
    _improve(looker, partial(score_of, space))
    for k, goal in enumerate(goals, 1):
        looker.allowance = round(whole * (1 - ENDS * (len(goals) - k)))
        _improve(looker, _alone(space, goal))
    tried = tuple(replace(one, score=score_of(space, one)) for one in looker.tried.values())
    on_step("search", len(tried), len(tried))  # neighbours that were tried before end it with fewer than were allowed
    best = min(tried, key=lambda one: (not one.allowed, not one.measures, one.score))
    return FoundDesigns(space=space, given=replace(given, score=score_of(space, given)), tried=tried, best=best)


def _improve(looker: _DesignLooker, score: Score) -> None:
    """DIRECT, then a simplex about the best design so far, within the allowance."""
    whole = looker.allowance
    looker.allowance = len(looker.tried) + round(GLOBAL * (whole - len(looker.tried)))
    _look_everywhere(looker, score)
    looker.allowance = whole
    x = looker.place_of(min(looker.tried.values(), key=lambda one: (not one.allowed, score(one))))
    with contextlib.suppress(_Enough):
        minimize(
            looker.softly(score), x, method="Nelder-Mead", bounds=_box(looker), options={"initial_simplex": _simplex(x)}
        )


def _look_everywhere(looker: _DesignLooker, score: Score) -> None:
    with contextlib.suppress(_Enough):
        direct(looker.softly(score), _box(looker), locally_biased=True, maxfun=MOST_CALLS, maxiter=MOST_CALLS)


def _box(looker: _DesignLooker) -> list[tuple[float, float]]:
    return [(0.0, 1.0)] * len(looker.free)


def _simplex(x: FloatArray) -> FloatArray:
    """(K + 1, K) a point and its neighbours along each axis, inside the box."""
    steps = np.where(x > 0.5, -SIMPLEX, SIMPLEX)
    return np.asarray(np.clip(np.vstack([x, x + np.diag(steps)]), 0.0, 1.0))


def coordinate_of(one: FreeParameter, value: float | str) -> float:
    """Return where in the search's box a value lies, 0 ... 1."""
    if one.choices:
        return (one.choices.index(value) + 0.5) / len(one.choices) if value in one.choices else 0.0
    low, high = ends_of(one)
    return min(max((float(value) - low) / (high - low), 0.0), 1.0)


def _given(request: PlanRequest, key: str) -> float | str:
    """Return what the room file has for a parameter; of a surface without a paint of its own, that of all."""
    found = value_at(request, key)
    if found is None and key.startswith("paint."):
        found = value_at(request, "paint.all")
    return "-" if found is None else found


def ends_of(one: FreeParameter) -> tuple[float, float]:
    """Return the ends of a parameter's range; 0 ... 0 for choices."""
    return (0.0 if one.low is None else one.low), (0.0 if one.high is None else one.high)


def value_of(one: FreeParameter, coordinate: float) -> float | str:
    """Return a parameter's value at a coordinate of the search's box, 0 ... 1."""
    share = min(max(coordinate, 0.0), 1.0)
    if one.choices:
        return one.choices[min(int(share * len(one.choices)), len(one.choices) - 1)]
    low, high = ends_of(one)
    return float(low + share * (high - low))


def score_of(space: DesignSpace, design: Design) -> float:
    """Return the weighted sum of the goals with the search's spreads; of a place that cannot be, the worst."""
    if not design.measures:
        return IMPOSSIBLE
    return sum(goal.weight * space.badness(goal, design.measures) for goal in space.search.goal)


def _alone(space: DesignSpace, goal: SearchGoal) -> Score:
    """One goal, the others only to tell equals apart."""

    def score(design: Design) -> float:
        if not design.measures:
            return IMPOSSIBLE
        return space.badness(goal, design.measures) + SLIGHT * score_of(space, design)

    return score


def weighty(search: SearchTable) -> list[SearchGoal]:
    """Return goals that are more than limits."""
    most = max(goal.weight for goal in search.goal)
    return [goal for goal in search.goal if goal.weight > LIMIT_ONLY * most]


def _spreads(search: SearchTable, tried: Sequence[Design]) -> dict[str, float]:
    """Standard deviation of each goal's measure over designs; 1 with one goal, or where nothing varies."""
    if len(weighty(search)) == 1:
        return {}
    spreads: dict[str, float] = {}
    for goal in search.goal:
        values = [one.measures[goal.measure] for one in tried if one.measures]
        spread = float(np.std(values)) if len(values) > 1 else 0.0
        spreads[goal.measure] = spread if spread > 0 else 1.0
    return spreads
