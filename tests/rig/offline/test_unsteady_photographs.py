"""A scan of photographs between which something changed: right, or refused with what changed, never a wrong cloud."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

Change = Callable[[int, list[np.ndarray]], np.ndarray]


def changed(frames: dict[str, np.ndarray], change: Change) -> dict[str, np.ndarray]:
    """Each photograph, by its number in time and all of them."""
    shown = [frame.astype(float) for frame in frames.values()]
    full = np.iinfo(next(iter(frames.values())).dtype).max
    return {name: change(k, shown).clip(0, full).astype(frame.dtype) for k, (name, frame) in enumerate(frames.items())}


def half_mixed(k: int, shown: list[np.ndarray]) -> np.ndarray:
    return np.asarray(0.5 * shown[k] + 0.5 * shown[max(k - 1, 0)])


def torn(k: int, shown: list[np.ndarray]) -> np.ndarray:
    line = len(shown[k]) // 4  # the lower half is not lit
    return np.vstack([shown[k][:line], shown[min(k + 1, len(shown) - 1)][line:]])


@pytest.mark.parametrize(
    ("change", "sign"),
    [(half_mixed, "also show the pattern before"), (torn, "the projector changed while the camera read its lines")],
    ids=["exposed too early", "torn"],
)
def test_photographs_that_show_two_patterns_are_refused_with_that(
    bench: SimpleNamespace, relief: Any, change: Change, sign: str
) -> None:
    outcome = bench.outcome_of(relief, "unsteady", "", changed(relief.frames, change))
    assert outcome.verdict == "refused"
    assert sign in outcome.message
    assert "wait longer after each pattern; by that or not, " in outcome.message


@pytest.mark.parametrize(
    "change",
    [
        lambda k, shown: shown[k] * (1 - 0.15 * k / len(shown)),
        lambda k, shown: shown[k] + 4.0 * np.sin(k),
    ],
    ids=["lamp fades", "daylight"],
)
def test_light_that_changes_by_little_does_no_harm(bench: SimpleNamespace, relief: Any, change: Change) -> None:
    outcome = bench.outcome_of(relief, "unsteady", "", changed(relief.frames, change))
    assert outcome.verdict == "passed"
    assert outcome.off < 0.01
