"""Which points a study has: every combination of lists and grids, with each sample of a Latin hypercube."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np

from rig.sweeps.study import LatinHypercube, Steps, StudyTable, flattened

Settings = dict[str, object]
"""Values by the parameter's name."""


def settings_of(study: StudyTable) -> Iterator[Settings]:
    """Yield the settings of each point: fixed ones, one sample, one row of the list, one place of the grid."""
    fixed = flattened(study.fixed)
    axes = {name: values_of(values) for name, values in flattened(study.grid).items()}
    rows = [flattened(row) for row in study.list_] or [{}]
    samples = [{}] if study.latin_hypercube is None else samples_of(study.latin_hypercube)
    for sample, row, place in product(samples, rows, product(*axes.values())):
        yield {**fixed, **sample, **row, **dict(zip(axes, place, strict=True))}


def count_of(study: StudyTable) -> int:
    """Return how many points a study has, without making them."""
    places = int(np.prod([len(values_of(values)) for values in flattened(study.grid).values()], dtype=object))
    samples = 1 if study.latin_hypercube is None else study.latin_hypercube.points
    return places * samples * max(len(study.list_), 1)


def values_of(values: object) -> Sequence[object]:
    """Return a grid's values of one parameter: a list as it is, or steps from one number to another."""
    if isinstance(values, Mapping):
        steps = Steps.model_validate(values)
        return [_rounded(value, 12) for value in np.linspace(steps.from_, steps.to, steps.count)]
    return values if isinstance(values, list | tuple) else [values]


def samples_of(wanted: LatinHypercube) -> list[Settings]:
    """Return the samples of a Latin hypercube: in each range every n-th part is met once.

    References
    ----------
    M. D. McKay, R. J. Beckman, W. J. Conover, A comparison of three methods for selecting values of input variables
    in the analysis of output from a computer code, Technometrics 21, 1979.
    """
    ranges = flattened(wanted.ranges)
    # NumPy keeps a bit generator's stream for ever, a Generator's methods not: points would lose their names.
    bits = np.random.PCG64(wanted.seed)
    unit = bits.random_raw(2 * len(ranges) * wanted.points).reshape(2, len(ranges), wanted.points) / 2.0**64
    parts = np.argsort(unit[0], axis=1, kind="stable")
    share = (parts + unit[1]) / wanted.points
    ends = np.array(list(ranges.values()), dtype=np.float64)
    values = ends[:, :1] + share * (ends[:, 1:] - ends[:, :1])
    return [{name: _rounded(value, 6) for name, value in zip(ranges, column, strict=True)} for column in values.T]


def _rounded(value: float, digits: int) -> float:
    """Return a number that people can read and type."""
    return float(f"{value:.{digits}g}")
