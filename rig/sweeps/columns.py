"""Points as columns: a row each of inputs and figures, and how the figures are distributed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.records import Json
from rig.sweeps.records import FigureSpread, PointLine

Cells = Sequence[Json]


@dataclass(frozen=True, kw_only=True, eq=False)
class Columns:
    """All points of a study that are known."""

    ids: tuple[str, ...]
    inputs: Mapping[str, Cells]
    figures: Mapping[str, Cells]
    outcome: Mapping[str, Cells]
    """Status, error, tries, seconds of processor time, file of arrays."""

    @property
    def values(self) -> Mapping[str, Cells]:
        """All columns by name; a figure that is called like an input is told apart."""
        clashing = self.inputs.keys() & self.figures.keys()
        renamed = {f"figure.{name}" if name in clashing else name: cells for name, cells in self.figures.items()}
        return {**self.inputs, **renamed, **self.outcome}

    def varied(self) -> tuple[str, ...]:
        """Names of the inputs that are not the same at all points."""
        return tuple(name for name, cells in self.inputs.items() if any(cell != cells[0] for cell in cells))


def columns_of(lines: Sequence[PointLine]) -> Columns:
    """Return the columns of points, in their order; None where a point has no such figure."""
    inputs = _names([line.inputs for line in lines])
    figures = _names([line.figures for line in lines])
    return Columns(
        ids=tuple(line.id for line in lines),
        inputs={name: [line.inputs.get(name) for line in lines] for name in inputs},
        figures={name: [line.figures.get(name) for line in lines] for name in figures},
        outcome={
            "status": [line.status for line in lines],
            "error": [line.error for line in lines],
            "tries": [line.tries for line in lines],
            "seconds": [line.seconds for line in lines],
            "arrays": [line.arrays for line in lines],
        },
    )


def _names(tables: Sequence[Mapping[str, object]]) -> tuple[str, ...]:
    """All keys, in the order in which they are met; few sets of keys are met often."""
    return tuple(dict.fromkeys(name for keys in dict.fromkeys(map(tuple, tables)) for name in keys))


def numbers_of(cells: Cells) -> NDArray[np.float64] | None:
    """Return a column's numbers, NaN for none; None for a column of words."""
    kinds = set(map(type, cells))
    if kinds & {str, list, dict}:
        return None
    known = [np.nan if cell is None else cell for cell in cells] if type(None) in kinds else cells
    return np.asarray(known, dtype=np.float64)


def spreads_of(columns: Columns, first: Sequence[str] = ()) -> tuple[FigureSpread, ...]:
    """Return how each figure that is a number is distributed, those that are asked for first."""
    spreads = []
    for name in dict.fromkeys((*(name for name in first if name in columns.figures), *columns.figures)):
        numbers = numbers_of(columns.figures[name])
        known = None if numbers is None else numbers[np.isfinite(numbers)]
        if known is None or not known.size:
            continue
        low, tenth, median, ninetieth, high = (float(q) for q in np.quantile(known, (0, 0.1, 0.5, 0.9, 1)))
        spreads.append(
            FigureSpread(
                figure=name, points=known.size, min=low, tenth=tenth, median=median, ninetieth=ninetieth, max=high
            )
        )
    return tuple(spreads)
