"""A response from known patterns alone: no exposures, no lamp, photographs as somebody else has taken them.

Whatever the wall and the room do, each pixel's light is a sum of a few known terms: a constant and what was shown
there, or a constant, a cosine and a sine of the shift of a sinusoid whose phase is not known. The right curve is the
one after which the levels of every pixel are such a sum. A curve of steps that are not negative cannot fail to rise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh
from scipy.optimize import nnls

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.radiometry.response import Response

_STEPS = 32
"""Of the curve: a gamma of 3 is straight between them to 0.002 of full scale, but for the lowest."""
_SMOOTH = 3e-3
"""Weight of the steps' second differences against the misfit per sample; noise of 8 bits is not followed."""
_WHOLE = 1e3
"""Weight of the steps' sum being 1."""
_OF_NOISE = 0.98
"""Of the largest noise that the misfit can hold: what is left stays a sum of squares."""
_LEAST_SAMPLES = 50
_LEAST_SPAN = 0.1
"""Of full scale, between the darkest and the brightest level."""
_MOST_LEFT = 0.03
"""Of the curve's range, rms: with more the patterns are not what they are called."""
_BLOCK = 4096


def sinusoid_terms(shifts_rad: ArrayLike) -> FloatArray:
    """Return what the light of a shifted sinusoid is a sum of, wherever its phase is: 1, cos and sin of the shift.

    Parameters
    ----------
    shifts_rad : (K,)
        Of each picture.

    Returns
    -------
    (K, 3)
        For :func:`fit_pattern_response`.
    """
    shifts = np.asarray(shifts_rad, dtype=np.float64)
    return np.stack([np.ones_like(shifts), np.cos(shifts), np.sin(shifts)], axis=-1)


def fit_pattern_response(levels: ArrayLike, terms: ArrayLike, full_scale_dn: float) -> Response:
    """Find the curve after which each pixel's levels are a sum of known terms.

    Where the terms are in linear light the curve is the camera's; where they are codes it is that of projector and
    camera together.

    Parameters
    ----------
    levels : (K, N)
        Digital numbers of N pixels in K pictures; not clipped.
    terms : (K, T) or (K, N, T)
        The same for all pixels (:func:`sinusoid_terms`), or of each: for known patterns 1 and what was shown there.
    full_scale_dn : float
        Largest digital number.

    Returns
    -------
    Response
        From the darkest level seen, whose light counts as 0, to the brightest, 1: a constant and a factor cannot be
        told from what the room adds and the wall reflects.

    Raises
    ------
    CalibrationError
        If there are no more pictures than terms, too few pixels, hardly any contrast, or no curve fits.
    """
    seen, known = np.asarray(levels, dtype=np.float64), np.asarray(terms, dtype=np.float64)
    _refuse_little(seen, known, full_scale_dn)
    lowest, highest = float(seen.min()), float(seen.max())
    knots = np.linspace(lowest, highest, _STEPS + 1)
    misfit, noise = _misfit(seen, known, knots), _noise_form(seen, knots)
    # noise of levels favours curves that are flat where most levels are; as much of it as there can be is taken out
    least = float(eigh(misfit, noise, eigvals_only=True, subset_by_index=(0, 0))[0])
    steps = _rising_steps(misfit - _OF_NOISE * least * noise)
    left = float(
        np.sqrt(max(float(steps @ misfit @ steps), 0.0))
    )  # of a fit without error rounding may leave less than 0
    if left > _MOST_LEFT:
        raise CalibrationError(
            f"response from patterns: {left:.3f} of the range is left (rms) after the best curve, the limit is "
            f"{_MOST_LEFT:g}: pictures are not the patterns they are called, clip, or the light changed between them"
        )
    return Response(knots, np.concatenate([[0.0], np.cumsum(steps)]), left)


def _refuse_little(levels: FloatArray, terms: FloatArray, full_scale_dn: float) -> None:
    count, pixels = levels.shape
    if terms.shape[0] != count or count <= terms.shape[-1]:
        raise CalibrationError(
            f"response from patterns: {count} pictures and {terms.shape[-1]} terms of light for {terms.shape[0]} "
            "pictures; there have to be more pictures than terms, e.g. at least 4 shifts of a sinusoid"
        )
    if pixels < _LEAST_SAMPLES:
        raise CalibrationError(
            f"response from patterns: {pixels} pixels, at least {_LEAST_SAMPLES} are needed; give more of the picture"
        )
    span = float(np.ptp(levels)) / full_scale_dn
    if span < _LEAST_SPAN:
        raise CalibrationError(
            f"response from patterns: levels span {span:.3f} of full scale, at least {_LEAST_SPAN:g} are needed: "
            "expose longer, darken the room"
        )


def _misfit(levels: FloatArray, terms: FloatArray, knots: FloatArray) -> FloatArray:
    """(J, J) mean square, over samples, of what no sum of the terms explains, as a form of the curve's steps."""
    count, pixels = levels.shape
    total = np.zeros((len(knots) - 1,) * 2)
    width = np.diff(knots)
    for first in range(0, pixels, _BLOCK):
        block = slice(first, first + _BLOCK)
        ramps = np.clip((levels[:, block, None] - knots[:-1]) / width, 0, 1).transpose(1, 0, 2)
        own = terms[None] if terms.ndim == 2 else terms[:, block].transpose(1, 0, 2)
        basis = np.linalg.svd(own, full_matrices=False)[0]
        rest = ramps - basis @ (basis.transpose(0, 2, 1) @ ramps)
        total += np.einsum("nkj,nki->ji", rest, rest, optimize=True)
    return np.asarray(total / (pixels * (count - terms.shape[-1])))


def _noise_form(levels: FloatArray, knots: FloatArray) -> FloatArray:
    """(J, J) mean square that noise of one digital number adds to the misfit, as a form of the curve's steps."""
    count = np.histogram(levels, knots)[0] + 1.0
    return np.diag(count / levels.size / np.diff(knots) ** 2)


def _rising_steps(misfit: FloatArray) -> FloatArray:
    """(J,) steps, none negative, that sum to 1."""
    count = len(misfit)
    bends = np.diff(np.eye(count), n=2, axis=0) * count
    form = misfit + _SMOOTH * np.trace(misfit) / count * bends.T @ bends / count**2 + 1e-12 * np.eye(count)
    rows = np.vstack([np.linalg.cholesky(form).T / np.sqrt(np.trace(form)), _WHOLE * np.ones(count)])
    steps = nnls(rows, np.append(np.zeros(count), _WHOLE), maxiter=100 * count)[0]
    return np.asarray(steps / steps.sum())
