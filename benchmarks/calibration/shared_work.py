"""Work that many sets of the same photographs share, done once.

A thousand ways to mix up 44 photographs are a thousand sets of the same 44 pictures. What a scan computes of single
pictures, of pairs, and of all of them whatever they are called, comes out the same each time; here it is looked up by
the pictures themselves. Nothing is left out: the functions are the scan's own, and so is what they return.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from calibration.structured_light.consistency import check, still
from calibration.structured_light.consistency.edges import LinePlaces
from rig.offline import photograph_order

Array = NDArray[Any]
_MOST_HELD = 4000
"""Results; the oldest go first. Small pictures and grids of a tenth of a megabyte each."""


class _Once:
    """Results by what went in, and what went in, so that no other array takes its place in memory."""

    def __init__(self) -> None:
        self._known: dict[Hashable, tuple[object, Any]] = {}

    def __call__(self, key: Hashable, held: object, work: Callable[[], Any]) -> Any:
        if key not in self._known:
            while len(self._known) >= _MOST_HELD:
                self._known.pop(next(iter(self._known)))
            self._known[key] = held, work()
        return self._known[key][1]


def content(array: Array) -> tuple[Hashable, ...]:
    """Digest of an array's values, and its shape."""
    return hash(array.tobytes()), array.shape


@contextmanager
def shared() -> Iterator[None]:
    """Within, scans of the same arrays share what they have in common."""
    once = _Once()
    of = {
        (check, "places_on_lines"): _places,
        (still, "_small"): _small,
        (still, "_shift"): _shift,
        (still, "_gains_of_pair"): _gains,
        (photograph_order, "_on_grid"): _on_grid,
        (photograph_order, "_read"): _read,
        (photograph_order, "view_of"): _view,
        (photograph_order, "rivals"): _rivals,
    }
    with ExitStack() as stack:
        for (module, name), quick in of.items():
            stack.enter_context(patch.object(module, name, partial(quick, once, getattr(module, name))))
        yield


def _places(once: _Once, work: Callable[..., LinePlaces], frames: Sequence[Array], limit: float) -> LinePlaces:
    """Rows are the photographs': computed in one order, handed out in the order asked for."""
    order = sorted(range(len(frames)), key=lambda k: id(frames[k]))
    few = [frames[k] for k in order]
    found = once(("places", *map(id, few), limit), few, lambda: work(few, limit))
    back = np.argsort(order)
    return LinePlaces(found.left[back], found.middle[back], found.right[back])


def _small(once: _Once, work: Callable[..., Array], frame: Array, scale: int) -> Array:
    return np.asarray(once(("small", id(frame), scale), frame, lambda: work(frame, scale)))


def _shift(once: _Once, work: Callable[..., still.LaidOver], a: Array, b: Array, window: Array) -> still.LaidOver:
    found: still.LaidOver = once(("shift", content(a), content(b)), None, lambda: work(a, b, window))
    return found


def _gains(once: _Once, work: Callable[..., Array], a: Array, b: Array, total: Array, contrast: float) -> Array:
    key = "gains", content(a), content(b), content(total), contrast
    return np.asarray(once(key, None, lambda: work(a, b, total, contrast)))


def _on_grid(
    once: _Once, work: Callable[..., tuple[dict[str, Array], int]], manifest: object, frames: Mapping[str, Array]
) -> tuple[dict[str, Array], int]:
    found = {
        name: once(("grid", id(frame)), frame, partial(work, manifest, {name: frame})) for name, frame in frames.items()
    }
    step_px = next(iter(found.values()))[1]
    return {name: next(iter(grid.values())) for name, (grid, _) in found.items()}, int(step_px)


def _read(
    once: _Once,
    work: Callable[..., object],
    manifest: object,
    frames: Mapping[str, Array],
    reading: Mapping[str, str],
    limit_dn: float,
) -> object:
    shown = {**frames, **{pattern: frames[name] for pattern, name in reading.items()}}
    key = "read", id(manifest), limit_dn, *sorted((name, id(frame)) for name, frame in shown.items())
    return once(key, (manifest, shown), lambda: work(manifest, frames, reading, limit_dn))


def _view(
    once: _Once, work: Callable[..., object], correspondence: object, lit: Array, step_px: int, **others: Any
) -> object:
    key = "view", id(correspondence), content(lit), step_px, id(others["devices"]), others["limit_px"]
    return once(key, (correspondence, others), lambda: work(correspondence, lit, step_px, **others))


def _rivals(once: _Once, work: Callable[..., object], views: Sequence[object]) -> object:
    return once(("rivals", *map(id, views)), list(views), lambda: work(views))
