"""The search for designs: scipy's differential evolution, then its simplex; deterministic for a seed.

One goal: differential evolution over all free parameters, choices as whole numbers, then a simplex (Nelder-Mead) from
the best design over those that have a range. Several goals: the same for their weighted sum with most of the designs
that may be looked at, and for each goal alone with the rest, so that the front has its ends.

References: Storn and Price, Journal of Global Optimization 11, 1997; Nelder and Mead, The Computer Journal 7, 1965.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, differential_evolution, minimize
from scipy.stats import qmc

from rig.plan.request import PlanRequest
from rig.plan.search.evaluate import DesignSpace, check_search, value_at
from rig.plan.search.records import Design
from rig.plan.search.request import FreeParameter, SearchGoal, SearchTable
from rig.terminal import OnStep, silent

FloatArray = NDArray[np.float64]
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


class _Looker:
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


def search_designs(request: PlanRequest, seed: int | None = None, on_step: OnStep = silent) -> FoundDesigns:
    """Look for the best designs of a room.

    Parameters
    ----------
    request
        With a ``[search]``.
    seed
        Instead of the search's own.
    on_step
        Told how far it is.

    Raises
    ------
    UsageError
        For a search that cannot be, or a room that cannot.
    """
    search = request.search
    if search is None:
        raise ValueError("no search is asked for")
    check_search(request, search)
    seed = search.seed if seed is None else seed
    looker = _Looker(DesignSpace(request=request, search=search), on_step)
    start = _start_points(search, seed)
    try:
        for x in start:
            looker(x)
    except _Enough:
        pass
    space = replace(looker.space, spreads=_spreads(search, list(looker.tried.values())))
    _evolve(looker, lambda design: _score(space, design), start, seed=seed, until=_share_of_main(search))
    for k, goal in enumerate(search.goal if len(_weighty(search)) > 1 else ()):
        if goal in _weighty(search):
            until = looker.allowance - (len(_weighty(search)) - 1 - _weighty(search).index(goal)) * _ends(search)
            _evolve(looker, _alone(space, goal), start, seed=seed + 1 + k, until=until)
    tried = tuple(replace(one, score=_score(space, one)) for one in looker.tried.values())
    given = space.design({one.key: _given(request, one) for one in search.free})
    return FoundDesigns(space=space, given=given, tried=tried, best=min(tried, key=lambda one: one.score))


def _given(request: PlanRequest, one: FreeParameter) -> float | str:
    """Return what the room file has for a parameter; the middle or first of what it may be where it has nothing."""
    found = value_at(request, one.key)
    if found is not None:
        return found
    return one.choices[0] if one.choices else 0.5 * (_low(one) + _high(one))


def _low(one: FreeParameter) -> float:
    return 0.0 if one.low is None else one.low


def _high(one: FreeParameter) -> float:
    return float(len(one.choices) - 1) if one.high is None else one.high


def value_of(one: FreeParameter, coordinate: float) -> float | str:
    """Return a parameter's value at a coordinate of the search's box, 0 ... 1."""
    share = min(max(coordinate, 0.0), 1.0)
    if one.choices:
        return one.choices[min(int(share * len(one.choices)), len(one.choices) - 1)]
    return float(_low(one) + share * (_high(one) - _low(one)))


def _score(space: DesignSpace, design: Design) -> float:
    """The weighted sum of the goals with the search's spreads; what is not allowed keeps its score."""
    if not design.allowed:
        return design.score
    return sum(goal.weight * space.badness(goal, design.measures) for goal in space.search.goal)


def _alone(space: DesignSpace, goal: SearchGoal) -> Score:
    """One goal, the others only to tell equals apart."""

    def score(design: Design) -> float:
        if not design.allowed:
            return design.score
        return space.badness(goal, design.measures) + SLIGHT * _score(space, design)

    return score


def _weighty(search: SearchTable) -> list[SearchGoal]:
    """Goals that are more than limits."""
    most = max(goal.weight for goal in search.goal)
    return [goal for goal in search.goal if goal.weight > LIMIT_ONLY * most]


def _spreads(search: SearchTable, tried: Sequence[Design]) -> dict[str, float]:
    """Standard deviation of each goal's measure over designs; 1 with one goal, or where nothing varies."""
    if len(_weighty(search)) == 1:
        return {}
    spreads = {}
    for goal in search.goal:
        values = [one.measures[goal.measure] for one in tried if one.measures]
        spread = float(np.std(values)) if len(values) > 1 else 0.0
        spreads[goal.measure] = spread if spread > 0 else 1.0
    return spreads
