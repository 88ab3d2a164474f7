"""What callers hand in, held to what it has to be: numbers, arrays, surfaces; else SimulationError, never another."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from sim.arrays import FloatArray
from sim.errors import SimulationError


def number_of(what: str, value: object) -> float:
    """Return a number. Raises SimulationError for what is none, NaN, or infinite."""
    is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool | np.complexfloating)
    if not is_number or not math.isfinite(value):  # type: ignore[arg-type]
        raise SimulationError(f"{what}: {_shown(value)}; give a finite number")
    return float(value)  # type: ignore[arg-type]


def numbers_of(what: str, value: object, count: int) -> tuple[float, ...]:
    """Return so many numbers. Raises SimulationError."""
    values = tuple(value) if isinstance(value, Iterable) and not isinstance(value, str | bytes) else ()
    if len(values) != count:
        raise SimulationError(f"{what}: {_shown(value)}; give {count} numbers")
    return tuple(number_of(what, each) for each in values)


def array_of(what: str, value: object) -> FloatArray:
    """Return numbers as an array, whatever their shape. Raises SimulationError for what is no array of numbers."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SimulationError(f"{what}: {_shown(value)}; give numbers") from error


def vector_of(what: str, value: object) -> FloatArray:
    """Return (3,) finite numbers. Raises SimulationError."""
    vector = array_of(what, value)
    if vector.shape != (3,) or not (np.abs(vector) < _FARTHEST).all():
        raise SimulationError(f"{what}: {_shown(value)}; give three finite numbers")
    return vector


def word_of(what: str, value: object, known: Iterable[str]) -> str:
    """Return one of the known words. Raises SimulationError."""
    choices = list(known)
    if not isinstance(value, str) or value not in choices:
        raise SimulationError(f"unknown {what} {_shown(value)}; there are {', '.join(choices)}")
    return value


def check_kind(what: str, value: object, needed: str, wanted: str) -> None:
    """Raise SimulationError unless a value has the attribute by which its kind is known."""
    if not hasattr(value, needed):
        raise SimulationError(f"{what}: {_shown(value)} of type {type(value).__name__}; give {wanted}")


_FARTHEST = 1e60
_LONGEST_SHOWN = 60


def _shown(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]} ..."
