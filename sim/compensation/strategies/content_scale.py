"""One scale for the whole picture, as large as clipping stays unseen (Wang et al. 2005)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sim.arrays import FloatArray, IntArray
from sim.compensation.adjusted_target import AdjustedTarget
from sim.compensation.inverse import Inverse
from sim.compensation.result import Compensation, Problem, prepare
from sim.compensation.split_transport import Transport

WEBER = 0.02
"""Just visible difference of luminance, as a share of what the eye is adapted to."""
DARKEST = 0.02
"""Adaptation does not go below this share of the target's mean."""
MASKING = (0.0153, 392.0, 0.7, 4.0)
"""k1, k2, s, b of Daly's masking (1 + (k1 (k2 contrast)^s)^b)^(1/b)."""
BISECTIONS = 12
"""They leave 1/4096 of the scale open."""


def content_scale(
    transport: Transport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    *,
    visible_share: float = 0.01,
) -> Compensation:
    """Project T⁻¹ (s c), clamped, with the largest s <= 1 for which the clamping is hardly visible.

    A pixel's error is visible above its threshold: Weber's share of its patch's mean light, raised where the patch's
    own contrast masks it.

    Limits: no local change, so no halos, and one bright spot dims the whole picture. Spatial frequency is not
    weighed. Clamping at black scales with the picture, so no s removes it, and it is not counted.

    Parameters
    ----------
    transport, target, lower, upper
        As in :func:`sim.compensate`.
    visible_share : float
        Share of values for which clamping at white may be visible.

    Returns
    -------
    Compensation
        Its notes hold ``gain`` and the ``visible_share`` that is left.

    References
    ----------
    Wang, Sato, Okabe and Sato, Radiometric compensation in a projector-camera system based on properties of human
    vision, PROCAMS 2005.
    Daly, The visible differences predictor, in Digital Images and Human Vision, 1993.
    """
    problem = prepare(transport, target, lower, upper)
    adjusted = scaled_target(problem, visible_share)
    return problem.result(adjusted.wanted, adjusted.iterations, adjusted.notes)


def scaled_target(problem: Problem, visible_share: float = 0.01) -> AdjustedTarget:
    """Return the target at the largest scale at which clamping is hardly visible."""
    by_gain = Inverse(problem.transport).apply(problem.target)
    threshold = visibility_threshold(problem.target, problem.transport.bands[0].pixel_patch)

    def visible(gain: float) -> float:
        lost = np.maximum(gain * by_gain - problem.upper, 0.0)
        # Thresholds scale with the picture.
        return float((np.abs(problem.transport.forward(lost)) > gain * threshold).mean())

    low, high = 0.0, 1.0
    gain = high if visible(high) <= visible_share else 0.0
    for _ in range(BISECTIONS if gain == 0 else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if visible(middle) <= visible_share else (low, middle)
    gain = max(gain, low, 2.0**-BISECTIONS)
    notes: dict[str, float | str] = {"gain": gain, "visible_share": visible(gain)}
    return AdjustedTarget(gain * problem.target, gain * by_gain, BISECTIONS, notes)


def visibility_threshold(target: FloatArray, pixel_patch: IntArray) -> FloatArray:
    """Return the (n, C) error that is just visible at each pixel of a target (n, C)."""
    label = pixel_patch + 1
    count = np.maximum(np.bincount(label), 1)
    thresholds = []
    k1, k2, s, b = MASKING
    for c in target.T:
        mean = np.bincount(label, weights=c) / count
        spread = np.sqrt(np.maximum(np.bincount(label, weights=c**2) / count - mean**2, 0.0))
        adapted = np.maximum(mean, max(DARKEST * float(c.mean()), np.finfo(float).tiny))
        masking = (1 + (k1 * (k2 * spread / adapted) ** s) ** b) ** (1 / b)
        thresholds.append((WEBER * adapted * masking)[label])
    return np.stack(thresholds, axis=-1)
