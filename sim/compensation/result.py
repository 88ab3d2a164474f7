"""What every compensation strategy returns, and what it checks first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from sim.errors import SimulationError
from sim.light_transport import LightTransport
from sim.scene import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Compensation:
    """A projector image, and the camera image that the model expects of it."""

    projector_image: FloatArray
    """(n,) p, within the range."""
    predicted: FloatArray
    """(n,) T p."""
    clipped: BoolArray
    """(n,) pixels that the range holds back."""
    residual_rms: float
    """Root mean square of T p - target."""
    iterations: int
    seconds: float
    notes: Mapping[str, float | str] = field(default_factory=dict)


def finished(
    transport: LightTransport,
    target: FloatArray,
    wanted: FloatArray,
    lower: float,
    upper: float,
    seconds: float,
    iterations: int = 1,
    notes: Mapping[str, float | str] | None = None,
) -> Compensation:
    """Clamp a wanted projector image to the range and predict what it gives."""
    p = np.clip(wanted, lower, upper)
    predicted = np.asarray(transport @ p)
    rms = float(np.sqrt(np.mean((predicted - target) ** 2)))
    clipped = (wanted < lower) | (wanted > upper)
    return Compensation(p, predicted, clipped, rms, iterations, seconds, notes or {})


def checked_target(transport: LightTransport, target: ArrayLike, lower: float, upper: float) -> FloatArray:
    """Return the target as (n,) float64.

    Raises
    ------
    SimulationError
        For a target of the wrong length or not finite, or an empty range.
    """
    values = np.asarray(target, dtype=np.float64)
    if values.shape != (transport.shape[0],):
        raise SimulationError(f"target of shape {values.shape}; the transport has {transport.shape[0]} camera pixels")
    if not np.isfinite(values).all():
        raise SimulationError(f"target: {int((~np.isfinite(values)).sum())} of {values.size} values not finite")
    if not lower < upper:
        raise SimulationError(f"projector range {lower:g} ... {upper:g} is empty; lower must be below upper")
    return values


def diagonal_of(transport: LightTransport) -> FloatArray:
    """(n,) diagonal of D.

    Raises
    ------
    SimulationError
        If the transport is not square with a diagonal D (the projector's view).
    """
    matrix: csr_array = transport.direct_matrix
    diagonal = np.asarray(matrix.diagonal())
    off_diagonal = matrix.shape[0] != matrix.shape[1] or matrix.count_nonzero() != np.count_nonzero(diagonal)
    if off_diagonal:
        raise SimulationError(
            f"compensation needs one camera value a projector pixel; this transport is {matrix.shape[0]} x "
            f"{matrix.shape[1]} with direct light off the diagonal: "
            "resample the camera to the projector's view first"
        )
    return diagonal


def divided(numerator: FloatArray, diagonal: FloatArray) -> FloatArray:
    """Numerator / diagonal; 0 where no direct light goes."""
    return np.divide(numerator, diagonal, out=np.zeros_like(numerator), where=diagonal > 0)
