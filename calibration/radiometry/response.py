"""Response curves, noise, and the way between codes and linear light."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from calibration.records import CalibrationError, Float32Array, FloatArray, Response

_TERMS = 3
_LEAST_PAIRS = 100
_CURVE_POINTS = 257


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Photon transfer: variance = level / gain + read noise²."""

    gain_e_per_dn: float
    read_noise_dn: float


def fit_camera_response(levels: FloatArray, exposures: ArrayLike, full_scale: float) -> Response:
    """Find the curve that makes levels proportional to exposure time.

    Inverse response g(y) = y + y² (a_0 + a_1 y + …), y = level / full scale: the unit of light is set by
    weak light, where g rises with slope 1, because ratios of exposures say nothing about it. For two
    exposures of one sample g(y_2) t_1 = g(y_1) t_2 whatever its brightness: linear in a (after T. Mitsunaga
    and S. K. Nayar, Radiometric self calibration, CVPR 1999). Beyond 97 % of full scale the curve is
    extrapolated.

    Parameters
    ----------
    levels : (K, N)
        Digital numbers above black of N samples at K exposures; averages of repeats are fine.
    exposures : (K,)
        In any unit.
    full_scale : float
        Digital number above black where the sensor clips.

    Raises
    ------
    CalibrationError
        If too few samples lie between noise and clipping, or the curve found does not rise.
    """
    times = np.asarray(exposures, dtype=np.float64)
    order = np.argsort(times)
    y, times = np.asarray(levels, dtype=np.float64)[order] / full_scale, times[order]
    usable = (y > 0.01) & (y < 0.97)
    rows, right = zip(*_exposure_pairs(y, times, usable), strict=True)
    matrix, target = np.concatenate(rows), np.concatenate(right)
    if len(target) < _LEAST_PAIRS:
        raise CalibrationError(
            f"camera response: {len(target)} pairs of usable samples, at least {_LEAST_PAIRS} are needed: "
            "the exposures must overlap between 1 % and 97 % of full scale; check exposure range and lamp"
        )
    ridge = 1e-4 * np.sqrt(len(target)) * np.abs(matrix).mean() * np.eye(_TERMS)
    a = np.linalg.lstsq(np.vstack([matrix, ridge]), np.append(target, np.zeros(_TERMS)), rcond=None)[0]
    dense = np.linspace(0, 1, _CURVE_POINTS)
    linear = dense + _shape_terms(dense) @ a
    if (np.diff(linear) <= 0).any():
        raise CalibrationError(
            "camera response: the curve found does not rise everywhere; the exposures that the camera tells "
            "are wrong, or the light changed during the sweep"
        )
    rate = np.where(usable, y + _shape_terms(y) @ a, np.nan) / times[:, None]
    counted = np.isfinite(rate).sum(axis=0) >= 2
    residual = (rate[:, counted] - np.nanmean(rate[:, counted], axis=0)) * times[:, None]
    return Response(dense * full_scale, linear, float(np.sqrt(np.nanmean(residual**2))))


def _shape_terms(y: FloatArray) -> FloatArray:
    """(..., terms) y^(k + 2)."""
    return np.stack([y ** (k + 2) for k in range(_TERMS)], axis=-1)


def _exposure_pairs(
    y: FloatArray, times: FloatArray, usable: NDArray[np.bool_]
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Equations of neighbouring exposures and of the next but one, weighted by shot noise."""
    for k in range(len(times)):
        for m in (k + 1, k + 2):
            if m < len(times):
                both = np.flatnonzero(usable[k] & usable[m])[:2000]
                low, high = y[k, both], y[m, both]
                weight = 1 / (np.sqrt(times[k] * times[m]) * np.sqrt(high))
                shape = _shape_terms(high) * times[k] - _shape_terms(low) * times[m]
                yield weight[:, None] * shape, weight * (low * times[m] - high * times[k])


def fit_noise_model(first: FloatArray, second: FloatArray, clip: float) -> NoiseModel:
    """Photon transfer from two frames of the same light at several exposures.

    Parameters
    ----------
    first, second : (K, N)
        Digital numbers above black.
    clip : float
        Levels from here on are left out.
    """
    mean = (first + second).ravel() / 2
    variance = (first - second).ravel() ** 2 / 2
    inside = (mean > 0) & (mean < clip)
    bins = np.quantile(mean[inside], np.linspace(0, 1, 25))
    group = np.clip(np.searchsorted(bins, mean[inside]) - 1, 0, 23)
    counts = np.bincount(group, minlength=24)
    full = counts > 20
    levels = np.bincount(group, mean[inside], 24)[full] / counts[full]
    variances = np.bincount(group, variance[inside], 24)[full] / counts[full]
    weight = 1 / np.maximum(variances, 1e-9)
    matrix = np.column_stack([levels, np.ones_like(levels)])
    slope, offset = np.linalg.lstsq(matrix * weight[:, None], variances * weight, rcond=None)[0]
    if slope <= 0:
        raise CalibrationError(
            f"noise does not grow with light (slope {slope:.3g} dn): frames are processed or averaged in the "
            "camera; switch its noise reduction off"
        )
    return NoiseModel(float(1 / slope), float(np.sqrt(max(offset, 0.0))))


def fit_projector_response(codes: ArrayLike, linear: ArrayLike) -> Response:
    """Monotone curve through the measured light of flat pictures.

    Parameters
    ----------
    codes : (K,)
        From 0 to the largest code.
    linear : (K,)
        Light above black, relative to the largest code's.

    Raises
    ------
    CalibrationError
        If the light does not rise with the code.
    """
    codes_, light = np.asarray(codes, dtype=np.float64), np.asarray(linear, dtype=np.float64)
    order = np.argsort(codes_)
    codes_, light = codes_[order], light[order]
    rising = np.maximum.accumulate(light)
    rms = float(np.sqrt(np.mean((rising - light) ** 2)))
    if light[-1] - light[0] <= 0 or rms > 0.02:
        raise CalibrationError(
            f"projector response: light falls by {rms:.3f} of white (rms) as codes rise, the limit is 0.02: "
            "picture mode or room light changes during the measurement; switch dynamic contrast off"
        )
    rising = (rising - rising[0]) / (rising[-1] - rising[0])
    dense = np.arange(codes_[0], codes_[-1] + 1)
    # A power near 2.2 makes the curve almost straight, so interpolation between few codes is accurate.
    curve = PchipInterpolator(codes_, rising ** (1 / 2.2))(dense) ** 2.2
    return Response(dense, np.clip(np.maximum.accumulate(curve), 0, 1), rms)


def fit_channel_responses(codes: ArrayLike, bands: FloatArray, mixing: FloatArray) -> tuple[Response, ...]:
    """Responses of a projector's channels from flat grey pictures, which show all channels at once.

    Parameters
    ----------
    codes : (K,)
        As for :func:`fit_projector_response`.
    bands : (K, B)
        Light above black in each band of the camera, relative to the largest code's.
    mixing : (B, B)
        Share of white in each band (row) that each channel (column) makes.

    Raises
    ------
    CalibrationError
        If a channel's light does not rise with the code.
    """
    channels = bands @ np.linalg.inv(mixing).T
    return tuple(fit_projector_response(codes, channels[:, q]) for q in range(channels.shape[1]))


def linear_from_codes(response: Response, codes: NDArray[np.uint8]) -> Float32Array:
    """Linear light, 0 … 1, of projector codes."""
    table = np.interp(np.arange(256), response.levels, response.linear).astype(np.float32)
    return np.asarray(table[codes])


def codes_from_linear(response: Response, linear: FloatArray, dither_seed: int | None = None) -> NDArray[np.uint8]:
    """Projector codes of linear light 0 … 1.

    With a seed, a value between two codes is rounded at random so that its mean is right; without, to the
    nearest.
    """
    table = np.interp(np.arange(256), response.levels, response.linear)
    light = np.clip(linear, table[0], table[-1])
    lower = np.clip(np.searchsorted(table, light, side="right") - 1, 0, 254)
    share = (light - table[lower]) / np.maximum(table[lower + 1] - table[lower], 1e-12)
    if dither_seed is None:
        threshold: FloatArray | float = 0.5
    else:
        threshold = np.random.default_rng(dither_seed).uniform(size=light.shape)
    return np.asarray(lower + (share > threshold), dtype=np.uint8)
