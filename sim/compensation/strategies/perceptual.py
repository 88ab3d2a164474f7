"""The bounded optimum of the error that is seen: weights from the Jacobian of CIELAB (Sheng et al. 2010)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sim.arrays import FloatArray
from sim.compensation.box_least_squares import BoxProblem, optimum
from sim.compensation.inverse import Inverse
from sim.compensation.result import Compensation, prepare
from sim.compensation.sampled_start import initial_image
from sim.compensation.split_transport import Transport
from sim.errors import SimulationError

XYZ_FROM_LINEAR_SRGB = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
"""IEC 61966-2-1."""
LAB_FROM_ROOTS = np.array([[0.0, 116.0, 0.0], [500.0, -500.0, 0.0], [0.0, 200.0, -200.0]])
"""L*, a*, b* of the cube roots of X, Y, Z over the white's, but for a constant."""
LINEAR_BELOW = (6 / 29) ** 3
"""CIE 15:2004: below this share of white, L* is a straight line."""


def perceptual(
    transport: Transport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    *,
    white: float | None = None,
    xyz_from_bands: ArrayLike = XYZ_FROM_LINEAR_SRGB,
    tolerance: float | None = None,
    limit: int | None = None,
) -> Compensation:
    """Minimise the squared difference in CIELAB, linearised at the target, over the projector's range.

    Limits: the Jacobian at the target holds for small differences; far from the target it overrates dark pixels. The
    RMS error in linear light is larger than that of ``bounded``.

    Parameters
    ----------
    transport, target, lower, upper
        As in :func:`sim.compensate`.
    white : float, optional
        Target value that is white, in every band; default: the largest of the target.
    xyz_from_bands : (3, 3)
        Colour of the three bands; a grey transport uses lightness L* alone.
    tolerance, limit
        As in ``bounded``.

    Returns
    -------
    Compensation
        Notes as of ``bounded``, all of the weighted error, and ``delta_e_rms``, the linearised ΔE*ab.

    Raises
    ------
    SimulationError
        For other than one or three bands, or a white that is not above 0.

    References
    ----------
    Sheng, Yapo and Cutler, Global illumination compensation for spatially augmented reality, Eurographics 2010.
    CIE 15:2004, Colorimetry, for L*a*b*.
    """
    problem = prepare(transport, target, lower, upper)
    peak = float(problem.target.max(initial=0.0)) if white is None else white
    if white is not None and not (np.isfinite(white) and white > 0):
        raise SimulationError(f"perceptual: white {white:g}; give the target value that is white, above 0")
    # A black target has no white of its own; any will do.
    metric = (
        lab_metric(problem.target / (peak or 1.0), np.asarray(xyz_from_bands, dtype=np.float64)) / (peak or 1.0) ** 2
    )
    box = BoxProblem(transport=problem.shown, target=problem.target, lower=lower, upper=upper, metric=metric)
    best = optimum(box, initial_image(box, Inverse(problem.transport).apply(problem.target)), tolerance, limit)
    notes = best.notes | {"delta_e_rms": (2 * best.objective / len(best.p)) ** 0.5}
    return problem.result(best.p, best.steps, notes, best.at_bounds)


def lab_metric(c: FloatArray, xyz_from_bands: FloatArray) -> FloatArray:
    """Return the (n, C, C) metric JᵀJ of CIELAB differences at the colours c (n, C), 1 = white.

    Raises
    ------
    SimulationError
        For other than one or three bands.
    """
    bands = c.shape[1]
    if bands == 1:
        return np.asarray((116 * _root_slope(c)) ** 2)[:, :, None]
    if bands != 3 or xyz_from_bands.shape != (3, 3):
        raise SimulationError(
            f"perceptual: {bands} bands and a colour matrix of shape {xyz_from_bands.shape}; it takes one band, or "
            "three and a (3, 3) matrix"
        )
    relative = xyz_from_bands / xyz_from_bands.sum(axis=1, keepdims=True)
    slopes = _root_slope(c @ relative.T)
    jacobian = LAB_FROM_ROOTS @ (slopes[:, :, None] * relative)
    return np.asarray(jacobian.transpose(0, 2, 1) @ jacobian)


def _root_slope(share: FloatArray) -> FloatArray:
    """Slope of CIELAB's f: of the cube root, and straight below (6/29)³."""
    return np.asarray(np.maximum(share, LINEAR_BELOW) ** (-2 / 3) / 3)
