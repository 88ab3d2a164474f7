"""Response curves of camera and projector, and the way between levels, codes and linear light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from calibration.arrays import Codes, Float32Array, FloatArray
from calibration.errors import CalibrationError

_MOST_FALL = 0.02
"""Of white: root mean square by which a projector's measured light may fall as codes rise."""
_USUAL_GAMMA = 2.2
"""A power near it makes a projector's curve almost straight, so interpolation between few codes is accurate."""
_OF_HALVED = 1 / 8
"""Of what every second code alone would have made of the others: a cubic's error goes with the third power of the steps
at least, where its slopes are estimated."""
_NEAR_BLACK = 1 / 64
"""Of full scale: below black a camera's curve goes on as steeply as it rises up to here on average."""


@dataclass(frozen=True, slots=True)
class Response:
    """A monotone response curve: what a device makes of a linear input."""

    levels: FloatArray
    """(K,) increasing device levels (camera: digital numbers above black; projector: codes)."""
    linear: FloatArray
    """(K,) increasing linear light at those levels, from 0 to 1. [1]"""
    rms: float
    """Residual of the fit over the used samples, share of full scale. [1]"""
    sigma: FloatArray | None = None
    """(K,) standard errors of `linear`; None where they are not known. [1]"""


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
    near = int(np.searchsorted(table, table[0] + _NEAR_BLACK * (table[-1] - table[0])))
    slope = (linear[near] - linear[0]) / (table[near] - table[0])
    inside = np.interp(levels, table, linear)
    return np.where(levels < table[0], linear[0] + (levels - table[0]) * slope, inside)


def light_sigma(response: Response, light: FloatArray) -> FloatArray:
    """Return the standard error of the linear light that a response curve gives.

    Parameters
    ----------
    response : Response
        Of a camera or of a projector's channel.
    light : any shape
        Linear light in the response's unit. [1]

    Returns
    -------
    same shape
        Where the curve does not know its own: the fit's residual. [1]
    """
    sigma = np.full_like(response.linear, response.rms) if response.sigma is None else response.sigma
    return np.asarray(np.interp(light, response.linear, sigma))


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
        One level a code; `rms` is what was made monotone, `sigma` what interpolation between the codes may be off by:
        it is known of a curve through every second one. [1]

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
    curve = _through(codes_, rising, dense)
    return Response(dense, curve, rms, _interpolation_sigma(codes_, rising, dense, curve))


def _through(codes: FloatArray, linear: FloatArray, dense: FloatArray) -> FloatArray:
    """(N,) rising curve through measured light, at other codes."""
    curve = PchipInterpolator(codes, linear ** (1 / _USUAL_GAMMA))(dense) ** _USUAL_GAMMA
    return np.asarray(np.clip(np.maximum.accumulate(curve), 0, 1))


def _interpolation_sigma(codes: FloatArray, linear: FloatArray, dense: FloatArray, curve: FloatArray) -> FloatArray:
    """(N,) by the codes left out of a curve through every second one: the larger of the two on either side."""
    half = np.unique(np.append(np.arange(0, len(codes), 2), len(codes) - 1))
    off = _OF_HALVED * np.abs(_through(codes[half], linear[half], dense) - curve)
    between = np.searchsorted(codes[half], dense, side="right")
    largest = np.array([off[between == k].max(initial=0.0) for k in range(between.max() + 1)])
    return np.asarray(np.maximum(largest[between], off))


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
