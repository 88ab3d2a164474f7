"""Response curves of camera and projector, and the way between levels, codes and linear light."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from calibration.arrays import BoolArray, Codes, Float32Array, FloatArray
from calibration.errors import CalibrationError

_TERMS = 3
"""Powers 2 to 4: sensors' curves are smooth, and a fourth term follows noise."""
_LEAST_PAIRS = 100
"""Of samples at two exposures: some thirty for each unknown."""
_MOST_SAMPLES = 2000
"""Of a pair of exposures: more change the curve by less than its noise."""
_USABLE = (0.01, 0.97)
"""Shares of full scale between which a sample counts: below is noise, above it may clip in one of the repeats."""
_RIDGE = 1e-4
"""Of an equation's size: holds terms at 0 that the samples say nothing about."""
_CURVE_POINTS = 257
"""Of a camera's curve: straight between them to 1e-5 of full scale."""
_MOST_FALL = 0.02
"""Of white: root mean square by which a projector's measured light may fall as codes rise."""
_USUAL_GAMMA = 2.2
"""A power near it makes a projector's curve almost straight, so interpolation between few codes is accurate."""


@dataclass(frozen=True, slots=True)
class Response:
    """A monotone response curve: what a device makes of a linear input."""

    levels: FloatArray
    """(K,) increasing device levels (camera: digital numbers above black; projector: codes)."""
    linear: FloatArray
    """(K,) increasing linear light at those levels, from 0 to 1 (a camera's end may differ from 1). [1]"""
    rms: float
    """Residual of the fit over the used samples, share of full scale. [1]"""


def fit_camera_response(levels: FloatArray, exposures: ArrayLike, full_scale_dn: float) -> Response:
    """Find the camera's curve: the one that makes levels proportional to exposure time.

    Inverse response g(y) = y + y² (a_0 + a_1 y + …), y = level / full scale: the unit of light is set by
    weak light, where g rises with slope 1, because ratios of exposures say nothing about it. For two
    exposures of one sample g(y_2) t_1 = g(y_1) t_2 whatever its brightness: linear in a. Beyond 97 % of full scale
    the curve is extrapolated.

    Parameters
    ----------
    levels : (K, N)
        Digital numbers above black of N samples at K exposures; averages of repeats are fine.
    exposures : (K,)
        In any unit.
    full_scale_dn : float
        Digital number above black where the sensor clips.

    Returns
    -------
    Response
        257 levels from 0 to full scale.

    Raises
    ------
    CalibrationError
        If too few samples lie between noise and clipping, or the curve found does not rise.

    References
    ----------
    After T. Mitsunaga and S. K. Nayar, Radiometric self calibration, CVPR 1999.
    """
    times = np.asarray(exposures, dtype=np.float64)
    order = np.argsort(times)
    y, times = np.asarray(levels, dtype=np.float64)[order] / full_scale_dn, times[order]
    usable = (y > _USABLE[0]) & (y < _USABLE[1])
    rows, right = zip(*_exposure_pairs(y, times, usable), strict=True)
    matrix, target = np.concatenate(rows), np.concatenate(right)
    if len(target) < _LEAST_PAIRS:
        raise CalibrationError(
            f"camera response: {len(target)} pairs of usable samples, at least {_LEAST_PAIRS} are needed: "
            "the exposures must overlap between 1 % and 97 % of full scale; check exposure range and lamp"
        )
    ridge = _RIDGE * np.sqrt(len(target)) * np.abs(matrix).mean() * np.eye(_TERMS)
    a = np.linalg.lstsq(np.vstack([matrix, ridge]), np.append(target, np.zeros(_TERMS)), rcond=None)[0]
    dense = np.linspace(0, 1, _CURVE_POINTS)
    linear = dense + _shape_terms(dense) @ a
    if (np.diff(linear) <= 0).any():
        raise CalibrationError(
            "camera response: the curve found does not rise everywhere; the exposures that the camera tells "
            "are wrong, the light changed during the sweep, or the camera's gamma is on: switch it off"
        )
    rate = np.where(usable, y + _shape_terms(y) @ a, np.nan) / times[:, None]
    counted = np.isfinite(rate).sum(axis=0) >= 2
    residual = (rate[:, counted] - np.nanmean(rate[:, counted], axis=0)) * times[:, None]
    return Response(dense * full_scale_dn, linear, float(np.sqrt(np.nanmean(residual**2))))


def _shape_terms(y: FloatArray) -> FloatArray:
    """(..., terms) y^(k + 2)."""
    return np.stack([y ** (k + 2) for k in range(_TERMS)], axis=-1)


def _exposure_pairs(y: FloatArray, times: FloatArray, usable: BoolArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Equations of neighbouring exposures and of the next but one, weighted by shot noise."""
    for k in range(len(times)):
        for m in (k + 1, k + 2):
            if m < len(times):
                both = np.flatnonzero(usable[k] & usable[m])[:_MOST_SAMPLES]
                low, high = y[k, both], y[m, both]
                weight = 1 / (np.sqrt(times[k] * times[m]) * np.sqrt(high))
                shape = _shape_terms(high) * times[k] - _shape_terms(low) * times[m]
                yield weight[:, None] * shape, weight * (low * times[m] - high * times[k])


def light_of_levels(response: Response, levels: FloatArray) -> FloatArray:
    """Return the linear light of a camera's levels; below the first level the curve goes on straight.

    Parameters
    ----------
    response : Response
        Of the camera.
    levels : any shape
        Digital numbers above black, negative ones included. [dn]

    Returns
    -------
    same shape
        Linear light in the response's unit. [1]
    """
    table, linear = response.levels, response.linear
    slope = (linear[1] - linear[0]) / (table[1] - table[0])
    inside = np.interp(levels, table, linear)
    return np.where(levels < table[0], linear[0] + (levels - table[0]) * slope, inside)


def ideal_levels(response: Response, levels: FloatArray) -> FloatArray:
    """Return the levels that a straight camera of the same full scale would give.

    Parameters
    ----------
    response : Response
        Of the camera.
    levels : any shape
        Digital numbers above black. [dn]

    Returns
    -------
    same shape
        Proportional to light, equal to `levels` at 0 and at full scale. [dn]
    """
    return np.asarray(light_of_levels(response, levels) * (response.levels[-1] / response.linear[-1]))


def ideal_slope(response: Response, levels: FloatArray) -> FloatArray:
    """Return how fast :func:`ideal_levels` changes with the level: 1 for a straight camera.

    Parameters
    ----------
    response : Response
        Of the camera.
    levels : any shape
        Digital numbers above black. [dn]

    Returns
    -------
    same shape
        Derivative. [1]
    """
    slope = np.gradient(response.linear, response.levels) * (response.levels[-1] / response.linear[-1])
    return np.asarray(np.interp(levels, response.levels, slope))


def fit_projector_response(codes: ArrayLike, linear: ArrayLike) -> Response:
    """Fit a projector's curve: a monotone one through the measured light of flat pictures.

    Parameters
    ----------
    codes : (K,)
        From 0 to the largest code.
    linear : (K,)
        Light above black, relative to the largest code's. [1]

    Returns
    -------
    Response
        One level a code; `rms` is what was made monotone. [1]

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
    if light[-1] - light[0] <= 0 or rms > _MOST_FALL:
        raise CalibrationError(
            f"projector response: light falls by {rms:.3f} of white (rms) as codes rise, the limit is {_MOST_FALL:g}: "
            "picture mode or room light changes during the measurement; switch dynamic contrast off"
        )
    rising = (rising - rising[0]) / (rising[-1] - rising[0])
    dense = np.arange(codes_[0], codes_[-1] + 1)
    curve = PchipInterpolator(codes_, rising ** (1 / _USUAL_GAMMA))(dense) ** _USUAL_GAMMA
    return Response(dense, np.clip(np.maximum.accumulate(curve), 0, 1), rms)


def fit_channel_responses(codes: ArrayLike, bands: FloatArray, mixing: FloatArray) -> tuple[Response, ...]:
    """Fit the curves of a projector's channels to flat grey pictures, which show all channels at once.

    Parameters
    ----------
    codes : (K,)
        As for :func:`fit_projector_response`.
    bands : (K, B)
        Light above black in each band of the camera, relative to the largest code's.
    mixing : (B, B)
        Share of white in each band (row) that each channel (column) makes. [1]

    Returns
    -------
    tuple of Response
        One a channel.

    Raises
    ------
    CalibrationError
        If a channel's light does not rise with the code.
    """
    channels = bands @ np.linalg.inv(mixing).T
    return tuple(fit_projector_response(codes, channels[:, q]) for q in range(channels.shape[1]))


def linear_from_codes(response: Response, codes: Codes) -> Float32Array:
    """Return the linear light of projector codes.

    Parameters
    ----------
    response : Response
        Of the projector's channel.
    codes : any shape, uint8
        Codes of that channel.

    Returns
    -------
    same shape, float32
        Linear light, 0 … 1 = projector white.
    """
    table = np.interp(np.arange(256), response.levels, response.linear).astype(np.float32)
    return np.asarray(table[codes])


def codes_from_linear(response: Response, linear: FloatArray, dither_seed: int | None = None) -> Codes:
    """Return the projector codes of linear light.

    Parameters
    ----------
    response : Response
        Of the projector's channel.
    linear : any shape
        Linear light; clipped to 0 … 1. [1]
    dither_seed : int, optional
        With a seed, a value between two codes is rounded at random so that its mean is right; without, to the
        nearest.

    Returns
    -------
    same shape, uint8
        Codes, 0 to 255.
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
