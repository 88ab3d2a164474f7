"""Photon transfer: variance over signal of pairs of frames gives a camera's gain and its read noise.

Light comes in electrons, so its variance is its mean; what is left without light is read noise. Every pixel of a pair
counts at the level that it has, so that an unevenly lit wall is an advantage.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.radiometry.response import Response, ideal_levels, ideal_slope

_BINS = 24
"""Groups of a pair: fine enough for a curve, and thousands of pixels each of a usual frame."""
_LEAST_PIXELS = 20
"""A group of fewer says nothing: its variance is known to a third."""
_LEAST_VARIANCE_DN2 = 1e-9
_LEAST_SHARE_OF_VARIANCE = 1e-3
"""Of the largest: keeps a group whose variance came out as 0 from getting all the weight."""
_MOST_CLIPPED = 0.05
"""Of a frame's pixels: a camera that compresses blocks takes noise from those beside clipped ones, too."""
_UNCLIPPED = 0.95
"""Of full scale: below it no pixel clips in one of the frames."""
_LEAST_SPAN_DN = 4.0
"""That a group of pixels spans: even and odd sums of two frames are in it alike."""
_UNEVEN = 0.1
"""Relative error of a variance by levels that do not lie evenly between whole numbers, where rounding is all of it:
straight lines of four random cameras of eight bits (random_rigs.py, seeds 41, 43, 48, 49) then have a chi² of 1.2 to
2.0 and full wells off by 1 to 4 %; with 0.05 2.8 to 5.0, and 1 to 6 %."""
_LEAST_GROUPS = 4
_NEARLY_STRAIGHT = 0.7
"""Logarithm of a curve's slope against that of the brightest group: such a camera does not cut its noise off."""
_CLEAR_SIGMAS = 4.0
"""Of noise, from black on."""
_CURVE_ERROR = 0.02
"""Relative error of variances by the camera's curve, whose slope is fitted; with many pixels it is the largest."""


@dataclass(frozen=True, slots=True)
class TransferPoints:
    """Groups of pixels of one level each."""

    signals: FloatArray
    """(K,) mean level above black. [dn]"""
    variances: FloatArray
    """(K,) temporal variance of a pixel. [dn²]"""
    counts: FloatArray
    """(K,) pixels of each group."""


@dataclass(frozen=True, kw_only=True)
class PhotonTransfer:
    """The line variance = signal / gain + read noise², and how well it is known."""

    gain_e_per_dn: float
    gain_sigma_e_per_dn: float
    read_noise_dn: float
    read_noise_e: float
    read_noise_sigma_e: float
    chi2: float
    """Of the fit, a degree of freedom: about 1 for a camera that does nothing to its noise. [1]"""


def transfer_points(
    first: FloatArray,
    second: FloatArray,
    *,
    range_dn: tuple[float, float] = (-np.inf, np.inf),
    bins: int = _BINS,
    least_span_dn: float = 0.0,
) -> TransferPoints:
    """Group the pixels of two frames of the same light by level.

    Parameters
    ----------
    first, second : same shape
        Levels above black; any shape, frames of several exposures together. [dn]
    range_dn : (low, high)
        Only pixels whose mean lies strictly between count: above are those that may clip, below those without light
        that would be cut off at 0.
    bins : int
        Groups of about equally many pixels.
    least_span_dn : float
        Groups are made at least so wide. Of two whole numbers whose sum is odd the difference is odd, so groups that
        are narrower than some steps of a coarse camera have variances that jump from one to the next. [dn]

    Returns
    -------
    TransferPoints
        Groups of 20 pixels or fewer are left out.
    """
    mean = (first + second).ravel() / 2
    variance = (first - second).ravel() ** 2 / 2
    inside = (mean > range_dn[0]) & (mean < range_dn[1])
    if not inside.any():
        return joined([])
    edges = _apart(np.quantile(mean[inside], np.linspace(0, 1, bins + 1)), least_span_dn)
    group = np.clip(np.searchsorted(edges, mean[inside]) - 1, 0, len(edges) - 2)
    counts = np.bincount(group)
    full = counts > _LEAST_PIXELS
    signals = np.bincount(group, mean[inside])[full] / counts[full]
    variances = np.bincount(group, variance[inside])[full] / counts[full]
    return TransferPoints(signals, variances, counts[full].astype(np.float64))


def _apart(edges: FloatArray, least: float) -> FloatArray:
    """Leave out edges that are nearer than that to the one before; the first and the last stay."""
    kept = [edges[0]]
    for edge in edges[1:-1]:
        if edge - kept[-1] >= least and edges[-1] - edge >= least:
            kept.append(edge)
    return np.array([*kept, edges[-1]])


def joined(parts: list[TransferPoints]) -> TransferPoints:
    """Return the groups of several pairs as one.

    Parameters
    ----------
    parts : list of TransferPoints
        May be empty.

    Returns
    -------
    TransferPoints
        All groups, in the order of the parts.
    """
    columns = ([part.signals for part in parts], [part.variances for part in parts], [part.counts for part in parts])
    return TransferPoints(*(np.concatenate([np.empty(0), *column]) for column in columns))


def linearised(points: TransferPoints, response: Response, step_dn: float = 1.0) -> TransferPoints:
    """Undo the camera's curve and the rounding to digital numbers.

    A curve bends the line: a variance grows with the square of the curve's slope, a signal does not. Rounding to
    steps adds a variance that is not the sensor's: step² / 12, and less where noise is smaller than a step.

    Parameters
    ----------
    points : TransferPoints
        As measured.
    response : Response
        Of the camera.
    step_dn : float
        Between neighbouring digital numbers. [dn]

    Returns
    -------
    TransferPoints
        As of a straight camera of the same full scale.

    References
    ----------
    EMVA Standard 1288, section on quantisation noise.
    """
    slope = ideal_slope(response, points.signals)
    true, growth = _unrounded(points.variances / step_dn**2)
    # where rounding hides noise, what is left is known less well
    counts = 2 / (2 / points.counts * growth**2 + (_UNEVEN * (growth - 1)) ** 2)
    return TransferPoints(ideal_levels(response, points.signals), true * step_dn**2 * slope**2, counts)


def _unrounded(variances: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Variance before rounding to whole numbers, of pixels whose true levels lie anywhere between these.

    Two roundings of noise with variance v differ by v + 1/12 - sum of exp(-4 π² k² v) / (2 π² k²): by 1/12 more where
    v is large, by less where neighbouring frames mostly round alike. Second, by what a relative error has grown.
    """
    true = np.concatenate([[0.0], np.geomspace(1e-5, 1.0, 400)])
    k = np.arange(1, 200)[:, None]
    rounded = true + 1 / 12 - (np.exp(-4 * np.pi**2 * k**2 * true) / (2 * np.pi**2 * k**2)).sum(axis=0)
    before = np.where(variances < rounded[-1], np.interp(variances, rounded, true), variances - 1 / 12)
    slope = np.where(variances < rounded[-1], np.interp(variances, rounded, np.gradient(true, rounded)), 1.0)
    return before, np.maximum(variances * slope / np.maximum(before, true[1]), 1.0)


def fit_camera_noise(levels: FloatArray, exposures: FloatArray, response: Response) -> PhotonTransfer:
    """Fit the photon transfer of a camera with any curve to repeated frames of one picture.

    Frames of equal exposure are compared with each other, a change of all light between them is taken out, and what
    noise near black is cut off by a tone curve is left out.

    Parameters
    ----------
    levels : (F, N)
        Digital numbers above black of N pixels in F frames.
    exposures : (F,)
        In any unit; each at least twice, further ones count nothing, nor do those in which much clips.
    response : Response
        Of the camera.

    Returns
    -------
    PhotonTransfer
        Of a straight camera of the same full scale.

    Raises
    ------
    CalibrationError
        If no exposure is repeated, or variance does not grow with signal.
    """
    top = _UNCLIPPED * response.levels[-1]
    parts = []
    for exposure in np.unique(exposures):
        same = levels[exposures == exposure]
        if len(same) > 1 and np.mean(same[:2] >= top) <= _MOST_CLIPPED:
            first, second = same[0], same[1]
            inside = (first < top) & (second < top)
            common = (first[inside].mean() - second[inside].mean()) if inside.any() else 0.0
            parts.append(transfer_points(first, second + common, range_dn=(-np.inf, top), least_span_dn=_LEAST_SPAN_DN))
    points = clear_of_black(joined(parts), response)
    if len(points.signals) < _LEAST_GROUPS:
        raise CalibrationError(
            f"camera noise: {len(points.signals)} groups of pixels between black and saturation in frames of equal "
            f"exposure of which at most {100 * _MOST_CLIPPED:g} % clips, at least {_LEAST_GROUPS} are needed; check "
            "exposure range and lamp"
        )
    return fit_photon_transfer(linearised(points, response), rounds=3)


def clear_of_black(points: TransferPoints, response: Response, known_from_dn: float = 0.0) -> TransferPoints:
    """Leave out groups whose noise a tone curve cuts off at black, or stretches so that it is not small any more.

    Parameters
    ----------
    points : TransferPoints
        As measured.
    response : Response
        Of the camera.
    known_from_dn : float
        Below it the curve goes on where hardly any frame tells of it: variances take such a slope squared. [dn]

    Returns
    -------
    TransferPoints
        All of them where the curve is nearly straight.
    """
    if not len(points.signals):
        return points
    slope = ideal_slope(response, points.signals)
    is_straight = np.abs(np.log(slope / np.maximum(slope[np.argmax(points.signals)], 1e-9))) < _NEARLY_STRAIGHT
    least = np.maximum(_CLEAR_SIGMAS * np.sqrt(points.variances) + 1, known_from_dn)
    kept = is_straight | (points.signals > least)
    return TransferPoints(points.signals[kept], points.variances[kept], points.counts[kept])


def fit_photon_transfer(points: TransferPoints, *, rounds: int = 5) -> PhotonTransfer:
    """Fit the straight line of variance over signal.

    Parameters
    ----------
    points : TransferPoints
        From :func:`transfer_points`.
    rounds : int
        How often the weights are taken anew from the fitted line. With 0 each group is weighted by its own measured
        variance: enough for the noise model of a session, which decides about bits and merges exposures, and needs
        each number only to some percent. Groups whose variance came out low by chance weigh too much then, so a
        gain that is itself the result, with its standard error, takes several rounds.

    Returns
    -------
    PhotonTransfer
        With standard errors; these grow with the scatter about the line where that is larger than expected.

    Raises
    ------
    CalibrationError
        If variance does not grow with signal.

    References
    ----------
    J. R. Janesick, Photon Transfer, SPIE Press 2007; EMVA Standard 1288.
    """
    matrix = np.column_stack([points.signals, np.ones_like(points.signals)])
    line = _weighted_line(matrix, points.variances, 1 / np.maximum(points.variances, _LEAST_VARIANCE_DN2))
    for _ in range(rounds):
        line = _weighted_line(matrix, points.variances, 1 / _sigma(points, matrix @ line))
    slope, offset = line
    if slope <= 0:
        raise CalibrationError(
            f"noise does not grow with light (slope {slope:.3g} dn): frames are processed, averaged or heavily "
            "compressed in the camera; switch its noise reduction off"
        )
    scaled = 1 / _sigma(points, matrix @ line)
    chi2 = float((((points.variances - matrix @ line) * scaled) ** 2).sum() / max(len(matrix) - 2, 1))
    covariance = np.linalg.pinv((matrix * scaled[:, None]).T @ (matrix * scaled[:, None])) * max(chi2, 1.0)
    gain = float(1 / slope)
    read_noise_dn = float(np.sqrt(max(offset, 0.0)))
    # read noise² in electrons is offset gain²: errors of slope and offset together
    jacobian = np.array([-2 * offset * gain**3, gain**2])
    squared_sigma = float(np.sqrt(jacobian @ covariance @ jacobian))
    return PhotonTransfer(
        gain_e_per_dn=gain,
        gain_sigma_e_per_dn=gain**2 * float(np.sqrt(covariance[0, 0])),
        read_noise_dn=read_noise_dn,
        read_noise_e=gain * read_noise_dn,
        read_noise_sigma_e=squared_sigma / max(2 * gain * read_noise_dn, 1e-9),
        chi2=chi2,
    )


def _weighted_line(matrix: FloatArray, values: FloatArray, weight: FloatArray) -> FloatArray:
    """(2,) slope and offset."""
    return np.asarray(np.linalg.lstsq(matrix * weight[:, None], values * weight, rcond=None)[0])


def _sigma(points: TransferPoints, model: FloatArray) -> FloatArray:
    """(K,) standard errors: a variance of n pixels is known to sqrt(2 / n) of itself, and as well as the curve."""
    largest = points.variances.max(initial=0.0)
    # A line that falls below 0 near black would give the groups there all the weight.
    floor = np.maximum(points.variances / 2, max(_LEAST_SHARE_OF_VARIANCE * largest, _LEAST_VARIANCE_DN2))
    return np.asarray(np.maximum(model, floor) * np.sqrt(2 / points.counts + _CURVE_ERROR**2))
