"""Linear light in the projector's few levels: rounding or seeded dither, and what it costs the residual."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sim.arrays import CodeArray, FloatArray
from sim.compensation.result import prepare
from sim.compensation.split_transport import Transport
from sim.errors import SimulationError

GAMMA_2_2 = np.linspace(0.0, 1.0, 256) ** 2.2
"""Light of 256 codes of a common projector."""


@dataclass(frozen=True, eq=False, kw_only=True)
class QuantisedImage:
    """A projector image in codes, and what it gives; images are shaped as the projector image was."""

    codes: CodeArray
    light: FloatArray
    """Light of the codes."""
    predicted: FloatArray
    """T of that light."""
    residual_rms: float
    """Root mean square of T light - target."""
    added_rms: float
    """Root mean square of T light - T p: what the levels add."""


def quantise(
    transport: Transport,
    target: ArrayLike,
    projector_image: ArrayLike,
    *,
    levels: ArrayLike = GAMMA_2_2,
    seed: int | None = None,
) -> QuantisedImage:
    """Put a projector image into codes and predict the camera image of these.

    Parameters
    ----------
    transport : LightTransport or ColourTransport
        Of the projector's view.
    target : (n,) or (n, C) array
        Camera image wanted.
    projector_image : (n,) or (n, C) array
        What a strategy gave for it.
    levels : (256,) array
        Light of each code, not falling.
    seed : int, optional
        As in :func:`to_codes`.

    Returns
    -------
    QuantisedImage

    Raises
    ------
    SimulationError
        For images or levels that do not fit.
    """
    table = _checked(levels)
    p = np.asarray(projector_image, dtype=np.float64)
    problem = prepare(transport, target, float(table[0]), float(table[-1]))
    if p.size != problem.target.size:
        raise SimulationError(
            f"projector image of shape {p.shape} for a target of {problem.target.size} values; one value each"
        )
    codes = to_codes(p, table, seed)
    light = table[codes]
    seen, ideal = (problem.transport.forward(image.reshape(problem.target.shape)) for image in (light, p))
    residual, added = (float(np.sqrt(np.mean((seen - other) ** 2))) for other in (problem.target, ideal))
    return QuantisedImage(
        codes=codes, light=light, predicted=seen.reshape(p.shape), residual_rms=residual, added_rms=added
    )


def to_codes(light: FloatArray, levels: ArrayLike = GAMMA_2_2, seed: int | None = None) -> CodeArray:
    """Return the codes of linear light.

    With a seed, a value between two levels is rounded at random so that its mean is right: patches, which add up many
    pixels, then get the light that was computed. Without, to the nearest level.

    Parameters
    ----------
    light : array of any shape
        Linear light in the unit of the levels; what lies beyond them is clamped.
    levels : (256,) array
        Light of each code, not falling.
    seed : int, optional
        Of the random rounding.

    Returns
    -------
    array of uint8
        Shaped as the light.

    Raises
    ------
    SimulationError
        For levels that are not 256 numbers that do not fall.
    """
    table = _checked(levels)
    within = np.clip(light, table[0], table[-1])
    below = np.clip(np.searchsorted(table, within, side="right") - 1, 0, 254)
    step = table[below + 1] - table[below]
    share = np.divide(within - table[below], step, out=np.zeros_like(within), where=step > 0)
    threshold = 0.5 if seed is None else np.random.default_rng(seed).uniform(size=within.shape)
    return np.asarray(below + (share > threshold), dtype=np.uint8)


def _checked(levels: ArrayLike) -> FloatArray:
    table = np.asarray(levels, dtype=np.float64)
    if table.shape != (256,) or not np.isfinite(table).all() or (np.diff(table) < 0).any() or table[0] == table[-1]:
        raise SimulationError(f"levels of shape {table.shape}; a projector's are 256 finite values that rise")
    return table
