"""Why a design was chosen, in words; which designs none beats; what changes when one parameter changes."""

from __future__ import annotations

from collections.abc import Mapping

from rig.plan.search.evaluate import LARGER_IS_BETTER
from rig.plan.search.records import Design, SearchResult, Sensitivity
from rig.plan.search.request import FreeParameter, SearchGoal
from rig.plan.search.run import FoundDesigns, ends_of, score_of, weighty

STEP = 0.05
"""Of a range: how far a parameter is moved to see what it does."""
NEAR_LIMIT = 0.02
"""Share by which a measure may keep away from its limit and still be called at it."""
UNITS = {
    "error": "grey levels",
    "brightness": "cd/m²",
    "contrast": ": 1",
    "density": "px/m",
}
"""Others are shares or have none."""


def result_of(found: FoundDesigns) -> SearchResult:
    """Return what is told of a search: best, front, sensitivity, words. Computes two designs a parameter more."""
    search = found.space.search
    sensitivity = tuple(_sensitivities(found))
    return SearchResult(
        goals=tuple(goal.measure for goal in search.goal),
        evaluations=len(found.tried),
        given=found.given,
        best=found.best,
        front=front_of(found.tried, weighty(search)),
        sensitivity=sensitivity,
        words=tuple(_words(found, sensitivity)),
        tried=found.tried,
    )


def front_of(tried: tuple[Design, ...], goals: list[SearchGoal]) -> tuple[Design, ...]:
    """Return the allowed designs that no other one beats in all goals, best in the first goal first."""
    allowed = [one for one in tried if one.allowed]
    front = [one for one in allowed if not any(_beats(other, one, goals) for other in allowed)]
    return tuple(sorted(front, key=lambda one: _signed(one.measures, goals[0])))


def _beats(one: Design, other: Design, goals: list[SearchGoal]) -> bool:
    differences = [_signed(one.measures, goal) - _signed(other.measures, goal) for goal in goals]
    return all(value <= 0 for value in differences) and any(value < 0 for value in differences)


def _signed(measures: Mapping[str, float], goal: SearchGoal) -> float:
    return -measures[goal.measure] if goal.measure in LARGER_IS_BETTER else measures[goal.measure]


def _sensitivities(found: FoundDesigns) -> list[Sensitivity]:
    raw = [(one, _changes(found.best, one)) for one in found.space.search.free]
    designs = [[found.space.design(values) for values in changes] for _, changes in raw]
    best = score_of(found.space, found.best)
    rises = [max((score_of(found.space, d) - best for d in row if d.allowed), default=0.0) for row in designs]
    most = max([*(abs(rise) for rise in rises), 1e-12])
    return [
        Sensitivity(
            key=one.key,
            changed_to=tuple(values[one.key] for values in changes),
            measures=tuple(design.measures for design in row),
            share=max(rise, 0.0) / most,
        )
        for (one, changes), row, rise in zip(raw, designs, rises, strict=True)
    ]


def _changes(best: Design, one: FreeParameter) -> list[Mapping[str, float | str]]:
    now = best.values[one.key]
    if one.choices or isinstance(now, str):
        return [{**best.values, one.key: other} for other in one.choices if other != now]
    low, high = ends_of(one)
    step = STEP * (high - low)
    moved = [value for value in (now - step, now + step) if low - 1e-12 <= value <= high + 1e-12]
    return [{**best.values, one.key: value} for value in moved]


def _words(found: FoundDesigns, sensitivity: tuple[Sensitivity, ...]) -> list[str]:
    search, best = found.space.search, found.best
    if not best.allowed:
        return [
            f"None of {len(found.tried)} designs keeps all limits and stands in the room's air; the nearest is shown. "
            "Widen a range, loosen a limit, or look at more designs (search.evaluations)."
        ]
    chosen = ", ".join(f"{key} = {said(value)}" for key, value in best.values.items())
    words = [f"Best of {len(found.tried)} designs: {chosen}.", _gains(found)]
    words += [_limit_words(goal, best.measures[goal.measure]) for goal in search.goal]
    words.append(_matters(sensitivity))
    at_end = [one.key for one in search.free if _is_at_end(one, best.values[one.key])]
    if at_end:
        words.append(f"At the end of its range: {', '.join(at_end)}; a wider range may give more.")
    return [text for text in words if text]


def _gains(found: FoundDesigns) -> str:
    """The best beside the room as it was given."""
    given, best = found.given, found.best
    if not given.measures:
        return "The room as the file has it cannot be: the projector is not in the air, or in a keep-out box."
    told = [
        f"{goal.measure} {_number(goal.measure, best.measures)} instead of {_number(goal.measure, given.measures)}"
        for goal in found.space.search.goal
    ]
    return f"Beside the room as the file has it: {'; '.join(told)}.{_missed(found)}"


def _missed(found: FoundDesigns) -> str:
    """Why the room as it was given is no answer, though its figures may look better."""
    missed = [text for goal in found.space.search.goal if (text := _miss(goal, found.given.measures[goal.measure]))]
    return f" As it is, it misses a limit: {'; '.join(missed)}." if missed else ""


def _miss(goal: SearchGoal, value: float) -> str:
    if goal.at_least is not None and value < goal.at_least:
        return f"{goal.measure} {value:.3g}, at least {goal.at_least:g}"
    if goal.at_most is not None and value > goal.at_most:
        return f"{goal.measure} {value:.3g}, at most {goal.at_most:g}"
    return ""


def _number(measure: str, measures: Mapping[str, float]) -> str:
    return f"{measures[measure]:.3g} {UNITS.get(measure, '')}".strip()


def _limit_words(goal: SearchGoal, value: float) -> str:
    for limit, word in ((goal.at_least, "least"), (goal.at_most, "most")):
        if limit is not None and abs(value - limit) <= NEAR_LIMIT * max(abs(limit), 1e-9):
            return f"Its {goal.measure} of {value:.3g} is at its limit (at {word} {limit:g}): loosen that to gain more."
    return ""


def _matters(sensitivity: tuple[Sensitivity, ...]) -> str:
    ordered = sorted(sensitivity, key=lambda one: -one.share)
    if not ordered or ordered[0].share <= 0:
        return "No small change of a single parameter makes it worse: the best is flat."
    calm = [one.key for one in ordered if one.share < 0.1]
    rest = f"; {', '.join(calm)} may be moved a little without harm" if calm else ""
    return f"What matters most is {ordered[0].key}{rest}."


def _is_at_end(one: FreeParameter, value: float | str) -> bool:
    if one.choices or isinstance(value, str):
        return False
    low, high = ends_of(one)
    return min(value - low, high - value) < 0.01 * (high - low)


def said(value: float | str) -> str:
    """Return a parameter's value in words."""
    return value if isinstance(value, str) else f"{value:.3g}"
