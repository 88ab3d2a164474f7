"""Which strategy suits a room, and why, in sentences that rest on what was measured there."""

from __future__ import annotations

from collections.abc import Sequence

from rig.strategies.records import ComparisonResult, StrategyRow
from rig.terminal.line import counted

_AS_GOOD = 1.03
"""Of the least mean error: closer strategies are told apart by their speed, no eye sees the difference."""
_SIGMAS = 3.0
"""Of the measured means: below that a difference is noise."""
_LITTLE_GAIN = 0.9
"""Of the uncompensated error: above it compensation is hardly worth its trouble."""
_LOOP_GAIN = 0.95
"""Of the strategy's own error: a closed loop that gains less costs more photographs than it is worth."""
_MUCH_CLIPPED = 0.1
"""Of the driven pixels: from here on the projector's range is what is left to improve."""
_FASTER = 3.0
"""Times: below that a difference in computing time is no reason to choose."""


def recommendation(result: ComparisonResult) -> tuple[str, ...]:
    """Return sentences: what to use for this session's target, what it is worth, and what holds it back.

    Parameters
    ----------
    result
        Of a comparison; its first picture is the target.

    Returns
    -------
    tuple of str
        The first names the strategy.
    """
    rows = result.pictures[0].rows
    none, chosen = result.pictures[0].row("none"), _chosen(rows)
    if chosen.strategy == "none" or chosen.shown.mean > _LITTLE_GAIN * none.shown.mean:
        return (
            f"Compensation hardly helps here: the target at its best single gain leaves {_grey(none)}, and "
            f"{chosen.strategy}, the best, {chosen.shown.mean:.1f}. The walls send little light to each other, or "
            "noise hides it.",
        )
    sentences = (_first(chosen, none), _others(chosen, rows), _limits(chosen), _loops(result, chosen))
    return tuple(sentence for sentence in sentences if sentence)


def _chosen(rows: Sequence[StrategyRow]) -> StrategyRow:
    """The one of the least error, or one that cannot be told from it and is much faster."""
    best = min(rows, key=lambda row: row.shown.mean)
    mean = best.shown.mean
    alike = [row for row in rows if row.shown.mean <= max(_AS_GOOD * mean, mean + _noise(best, row))]
    fastest = min(alike, key=lambda row: row.seconds or 0.0)
    return fastest if (fastest.seconds or 0.0) < (best.seconds or 0.0) / _FASTER else best


def _noise(one: StrategyRow, other: StrategyRow) -> float:
    sigmas = [row.shown.mean_sigma or 0.0 for row in (one, other)]
    return float(_SIGMAS * (sigmas[0] ** 2 + sigmas[1] ** 2) ** 0.5)


def _grey(row: StrategyRow) -> str:
    return f"a mean error of {row.shown.mean:.1f} grey levels"


def _first(chosen: StrategyRow, none: StrategyRow) -> str:
    ratio = none.shown.mean / max(chosen.shown.mean, 1e-9)
    how = "photographed" if chosen.measured is not None else "as the model predicts it"
    return (
        f"Use {chosen.strategy}: {how}, it leaves {_grey(chosen)}, {ratio:.1f} times less than the uncompensated "
        f"picture ({none.shown.mean:.1f})."
    )


def _others(chosen: StrategyRow, rows: Sequence[StrategyRow]) -> str:
    """The next one, one that is much faster, and the one that keeps the picture truer where it may be darker."""
    others = sorted((row for row in rows if row.strategy != chosen.strategy), key=lambda row: row.shown.mean)
    said = [f"Next is {others[0].strategy} with {others[0].shown.mean:.1f}."] if others else []
    mine = chosen.seconds or 0.0
    quick = [row for row in others if (row.seconds or 0.0) < mine / _FASTER and row.strategy != "none"]
    if quick and quick[0] is not others[0]:
        said.append(f"{quick[0].strategy} takes {quick[0].seconds or 0:.2g} s instead of {mine:.2g} s to compute, and")
        said.append(f"leaves {quick[0].shown.mean:.1f}.")
    truest = min(rows, key=lambda row: row.shown.mean_at_best_gain)
    if truest.shown.mean_at_best_gain < chosen.shown.mean_at_best_gain / _AS_GOOD:
        said.append(
            f"If the picture may be darker or brighter as a whole, {truest.strategy} keeps it truer: after the gain "
            f"that suits each best it leaves {truest.shown.mean_at_best_gain:.1f}, {chosen.strategy} "
            f"{chosen.shown.mean_at_best_gain:.1f}."
        )
    return " ".join(said)


def _limits(chosen: StrategyRow) -> str:
    """What holds it back."""
    if (chosen.clipped_share or 0.0) < _MUCH_CLIPPED:
        return ""
    return (
        f"{100 * (chosen.clipped_share or 0.0):.0f} % of the projector's pixels are at black or at white already: "
        "darker walls, or a lower brightness.target_white_share in the profile, would help more than another strategy."
    )


def _loops(result: ComparisonResult, chosen: StrategyRow) -> str:
    """Whether closing the loop is worth its photographs."""
    if not result.loops:
        return ""
    best = min(result.loops, key=lambda loop: loop.kept.mean)
    if best.kept.mean >= _LOOP_GAIN * chosen.shown.mean:
        return "Closing the loop over the camera gains little here: the model explains the room."
    return (
        f"For a picture that stays, close the loop over the camera: {best.strategy} corrected by "
        f"{counted(best.best, 'photograph')} leaves {best.kept.mean:.1f}."
    )
