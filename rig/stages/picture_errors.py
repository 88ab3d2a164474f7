"""How far a picture is from the one that was wanted: figures that no single number can stand for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skimage.color import deltaE_ciede2000
from skimage.metrics import structural_similarity

from rig.records import Record
from sim.compensation.strategies.perceptual import XYZ_FROM_LINEAR_SRGB
from sim.light.criteria import difference, weighted_median

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

WHITE = 255.0
"""Grey level of a target's white; the light of L* = 100."""


@dataclass(frozen=True, kw_only=True)
class PictureErrors(Record):
    """How far a picture is from the one that was wanted, in grey levels of 255."""

    mean: float
    """Of |shown - wanted|, as sd and max."""
    sd: float
    max: float
    rms: float
    """Of shown - wanted, as bias."""
    bias: float
    ssim: float
    """Structural similarity; 1 is equal."""


@dataclass(frozen=True, kw_only=True)
class PerceivedErrors(PictureErrors):
    """The same, and what an eye that adapts to the brightness sees of it."""

    delta_e_2000: float
    """Mean CIEDE2000 difference."""
    best_gain: float
    """The single gain of the shown picture with the smallest mean absolute error."""
    mean_at_best_gain: float
    """That error."""


def picture_errors(shown: FloatArray, wanted: FloatArray, mask: BoolArray) -> PictureErrors:
    """Return errors in grey levels over the mask and all bands, and structural similarity.

    Parameters
    ----------
    shown, wanted : (H, W) or (H, W, B)
        Grey levels of 255, linear light; outside the mask anything, NaN included.
    mask : (H, W)
        Pixels that count.
    """
    return PictureErrors(**_figures(shown, wanted, mask))


def perceived_errors(shown: FloatArray, wanted: FloatArray, mask: BoolArray) -> PerceivedErrors:
    """Return the errors of :func:`picture_errors`, and those that an eye sees that adapts to the brightness.

    Parameters
    ----------
    shown, wanted : (H, W) or (H, W, B)
        Grey levels of 255, linear light; outside the mask anything, NaN included.
    mask : (H, W)
        Pixels that count.
    """
    seen, target = _in_bands(shown, mask)[mask], _in_bands(wanted, mask)[mask]
    gain = best_gain(seen, target)
    return PerceivedErrors(
        **_figures(shown, wanted, mask),
        delta_e_2000=float(colour_difference(seen, target).mean()),
        best_gain=gain,
        mean_at_best_gain=float(np.abs(gain * seen - target).mean()),
    )


def _figures(shown: FloatArray, wanted: FloatArray, mask: BoolArray) -> dict[str, float]:
    shown, wanted = _in_bands(shown, mask), _in_bands(wanted, mask)
    errors = difference(shown[mask], wanted[mask])
    return {
        "mean": errors.mean,
        "sd": errors.sd,
        "max": errors.max,
        "rms": errors.rms,
        "bias": float((shown - wanted)[mask].mean()),
        "ssim": float(np.mean([_similarity(shown[..., b], wanted[..., b], mask) for b in range(shown.shape[-1])])),
    }


def _in_bands(image: FloatArray, mask: BoolArray) -> FloatArray:
    return image.reshape(*mask.shape, -1)


def _similarity(shown: FloatArray, wanted: FloatArray, mask: BoolArray) -> float:
    """Mean structural similarity of one band over the mask."""
    clean = [np.where(mask, image, 0.0) for image in (shown, wanted)]
    _, similarity = structural_similarity(*clean, data_range=WHITE, full=True)  # type: ignore[no-untyped-call]
    return float(similarity[mask].mean())


def colour_difference(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the (N,) CIEDE2000 difference of colours (N, B) in linear light, grey levels of 255.

    One band is neutral; three are the red, green and blue of linear sRGB, whose white is the pictures' white.
    """
    if first.shape[-1] == 1:
        return grey_difference(first[..., 0], second[..., 0])
    lab = [_lab(np.clip(image, 0.0, None) / WHITE) for image in (first, second)]
    return np.asarray(deltaE_ciede2000(*lab))  # type: ignore[no-untyped-call]


def _lab(rgb: FloatArray) -> FloatArray:
    """(N, 3) CIE 1976 L*a*b* of linear sRGB over its white."""
    relative = XYZ_FROM_LINEAR_SRGB / XYZ_FROM_LINEAR_SRGB.sum(axis=1, keepdims=True)
    x, y, z = (_lightness(share) for share in np.moveaxis(rgb @ relative.T, -1, 0))
    # L* = 116 f(Y) - 16, a* = 500 (f(X) - f(Y)), b* = 200 (f(Y) - f(Z)).
    return np.stack([y, 500 / 116 * (x - y), 200 / 116 * (y - z)], axis=-1)


def grey_difference(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the CIEDE2000 difference of neutral colours in linear light, grey levels of 255; any one shape.

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
    """Return the gain of shown light with the smallest mean absolute error.

    It is the median of wanted / shown, weighted by shown; 1 where nothing is shown.
    """
    lit = shown > 0
    if not lit.any():
        return 1.0
    return weighted_median(wanted[lit] / shown[lit], shown[lit])


def contrast(shown: FloatArray, wanted: FloatArray, mask: BoolArray) -> float | None:
    """Return mean light where white is wanted over mean light where black is; None for a picture that has not both."""
    shown, wanted = _in_bands(shown, mask), _in_bands(wanted, mask)
    parts = ((wanted > 0.9 * WHITE).all(axis=-1), (wanted < 0.1 * WHITE).all(axis=-1))
    white, black = (shown[mask & part] for part in parts)
    if not (white.size and black.size and black.mean() > 0):
        return None
    return float(white.mean() / black.mean())
