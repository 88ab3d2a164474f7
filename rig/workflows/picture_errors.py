"""How far a picture is from the one that was wanted: figures that no single number can stand for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

from sim.compensation.none import weighted_median

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

WHITE = 255.0
"""Grey level of a target's white; the light of L* = 100."""


def picture_errors(shown: FloatArray, wanted: FloatArray, mask: BoolArray) -> dict[str, float]:
    """Errors in grey levels over the mask, and structural similarity.

    Parameters
    ----------
    shown, wanted : (H, W)
        Grey levels of 255, linear light; outside the mask anything, NaN included.
    mask : (H, W)
        Pixels that count.

    Returns
    -------
    dict
        ``mean``, ``sd``, ``max`` of |shown - wanted|; ``rms`` and ``bias`` of shown - wanted; ``ssim``.
    """
    signed = (shown - wanted)[mask]
    absolute = np.abs(signed)
    clean = [np.where(mask, image, 0.0) for image in (shown, wanted)]
    _, similarity = structural_similarity(*clean, data_range=WHITE, full=True)  # type: ignore[no-untyped-call]
    return {
        "mean": float(absolute.mean()),
        "sd": float(absolute.std()),
        "max": float(absolute.max()),
        "rms": float(np.sqrt((signed**2).mean())),
        "bias": float(signed.mean()),
        "ssim": float(similarity[mask].mean()),
    }


def perceived_errors(shown: FloatArray, wanted: FloatArray, mask: BoolArray) -> dict[str, float]:
    """What an eye that adapts to the brightness sees of it.

    Returns
    -------
    dict
        ``delta_e_2000``: mean CIEDE2000 difference. ``best_gain``: the single gain of the shown picture with the
        smallest mean absolute error, and ``mean_at_best_gain``, that error in grey levels.
    """
    seen, target = shown[mask], wanted[mask]
    gain = best_gain(seen, target)
    return {
        "delta_e_2000": float(grey_difference(seen, target).mean()),
        "best_gain": gain,
        "mean_at_best_gain": float(np.abs(gain * seen - target).mean()),
    }


def grey_difference(first: FloatArray, second: FloatArray) -> FloatArray:
    """CIEDE2000 difference of neutral colours in linear light, grey levels of 255; any one shape.

    For a* = b* = 0 it is |ΔL*| / S_L (Sharma, Wu and Dalal, Color Res. Appl. 30, 2005, eqs. 8, 15, 22).
    """
    lightness = [_lightness(np.clip(image, 0.0, None) / WHITE) for image in (first, second)]
    middle = (lightness[0] + lightness[1]) / 2 - 50
    return np.asarray(np.abs(lightness[0] - lightness[1]) / (1 + 0.015 * middle**2 / np.sqrt(20 + middle**2)))


def _lightness(relative: FloatArray) -> FloatArray:
    """CIE 1976 L* of light relative to white."""
    cube = np.cbrt(relative)
    return np.asarray(116 * np.where(relative > (6 / 29) ** 3, cube, relative * (29 / 6) ** 2 / 3 + 4 / 29) - 16)


def best_gain(shown: FloatArray, wanted: FloatArray) -> float:
    """Gain of (N,) shown light with the smallest mean absolute error: the median of wanted / shown, weighted by shown.

    1 where nothing is shown.
    """
    lit = shown > 0
    if not lit.any():
        return 1.0
    return weighted_median(wanted[lit] / shown[lit], shown[lit])


def contrast(shown: FloatArray, wanted: FloatArray, mask: BoolArray) -> float | None:
    """Mean light where white is wanted over mean light where black is; None for a picture that has not both."""
    white, black = (shown[mask & part] for part in (wanted > 0.9 * WHITE, wanted < 0.1 * WHITE))
    if not (white.size and black.size and black.mean() > 0):
        return None
    return float(white.mean() / black.mean())
