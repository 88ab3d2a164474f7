"""How far a long computation is: told to a function that takes the share done, from 0 to 1."""

from __future__ import annotations

from collections.abc import Callable

OnProgress = Callable[[float], None]
"""Is told the share that is done."""


def unheard(share: float) -> None:
    """Tell nobody."""


def part_of(on_progress: OnProgress, first: float, last: float) -> OnProgress:
    """Return the progress of a part, which goes from one share of the whole to another."""
    return lambda share: on_progress(first + (last - first) * share)
