"""How certain a fit's unknowns are, where the errors of neighbouring points are not independent."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibration.arrays import FloatArray, IntArray
from calibration.geometry.robust_fit import Fit

SIGMAS = 4.0
"""A contradiction: by chance one in 16,000."""
_BLOCKS_PX = (12, 24, 48, 96)
"""Sides of the camera's squares whose points are taken together: from the window of the refinement on."""
_STRIPS_PX = (4, 8, 16, 32)
"""Widths of the projector's strips whose points are taken together: codes err by lines. On the floor of a random rig
(small-9776) whole rows were off by up to 0.1 px; its focal length was 7.4 sigma off by squares, 3.7 with strips."""
_LEAST_BLOCKS = 1.5
"""Sums of blocks per unknown: below, the fit has bent itself to most of them and they tell too little."""

_SHARED_BLOCK_PX, _LEAST_IN_BLOCK, _LEAST_SHARED_BLOCKS = 48, 4, 12
"""Side of the camera's squares whose means tell of errors that all points of a wall share, points that a square needs,
and how many squares: longer waves the fit takes for lenses."""
_SHARED_OVER_BLOCKS = 2.5
"""What walls were off over what such squares are: 4.9, 0.9, 0.6, 1.6 on four random rigs (7103, 7101, 7102, 7104)."""
_SHARED_RANGE_PX, _USUAL_SHARED_PX = (0.002, 0.1), 0.01
"""Of such an error, however little or much the squares say; and where there are too few. Walls of four random rigs were
off by 0.0004 to 0.044 px."""
_WIDE_SHARE = 0.1
"""Of the points: a strip with a hundredth of them was off by 0.03 px where whole walls were by 0.01 px."""
_STEP = 1e-6
"""Of a forward difference: unknowns are of order 1."""


def observation_variance(fit: Fit, x1: FloatArray, label: IntArray, x2: FloatArray | None = None) -> float:
    """Estimate the variance of an independent observation: that of a residual, times how many share one error.

    Points are summed over squares of the camera's picture on one wall, and over strips of the projector's columns and
    rows on it. The sum of n independent errors has n times the variance of one; where neighbours share their error it
    has more, and that excess is what a square's points count less. The larger the squares, the longer the waves of
    error that are seen; the largest excess is taken. What the fit has taken out of the sums for its unknowns is put
    back.

    Parameters
    ----------
    fit : Fit
        A solution.
    x1 : (N, 2)
        Camera pixels of its points. [px]
    label : (N,)
        Their walls.
    x2 : (N, 2), optional
        Projector pixels of its points, where a code tells them. [px]

    Returns
    -------
    float
        [px²]
    """
    weighted = fit.residual * fit.weight[:, None]
    own = float((weighted**2).mean())
    unknowns = effective_unknowns(fit)
    found = [own]
    squares = [_cells(x1 // side, label) for side in _BLOCKS_PX]
    strips = [] if x2 is None else [_cells(x2[:, [k]] // width, label) for width in _STRIPS_PX for k in (0, 1)]
    for index in (*squares, *strips):
        sums = np.stack([np.bincount(index, column) for column in weighted.T])
        # Squares with few points say little, and there are many at the rims.
        free = sums.size - unknowns
        if sums.size > _LEAST_BLOCKS * unknowns:
            found.append(float((sums**2).sum()) / len(x1) / fit.residual.shape[1] * sums.size / free)
    return max(found)


def _cells(place: FloatArray, label: IntArray) -> IntArray:
    """(N,) numbers, from 0, of the squares or strips (N, 1 or 2) in which points lie, each wall's its own."""
    key = label.astype(np.int64)
    for column in place.T.astype(np.int64):
        key = key * 10_000 + column
    return np.unique(key, return_inverse=True)[1].ravel()


def effective_unknowns(fit: Fit) -> float:
    """Return how many unknowns the points determine, not the priors."""
    return float(len(fit.z) - fit.priors.weight * np.sum(fit.priors.precision * covariance(fit, 1.0)))


def covariance(fit: Fit, variance_px2: float, taken: FloatArray | float = 0.0) -> FloatArray:
    """Return the covariance of a solution from the curvature of its cost, priors included.

    Parameters
    ----------
    fit : Fit
        A solution, whose priors were weighed by that variance.
    variance_px2 : float
        Of an independent observation. [px²]
    taken : (n, n), optional
        What other unknowns, which the points leave open, take from the curvature.

    Returns
    -------
    (n, n)
        Covariance of the unknowns; a direction that changes nothing (the length of the translation) has none.
    """
    return np.asarray(variance_px2 * inverse_of(fit.hessian - taken))


def inverse_of(hessian: FloatArray) -> FloatArray:
    """Return the inverse of a curvature (n, n), zero in the direction that changes nothing."""
    scale = 1 / np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    values, vectors = np.linalg.eigh(hessian * np.outer(scale, scale))
    # The length of the translation changes nothing: one eigenvalue is zero but for rounding.
    inverse = np.where(values > 1e-12 * values.max(), 1 / np.maximum(values, 1e-300), 0.0)
    return np.asarray((vectors * inverse) @ vectors.T * np.outer(scale, scale))


def shared_error_px(fit: Fit, x1: FloatArray, label: IntArray) -> float:
    """Estimate by how much all points of a wall are off together: by the waves that a fit leaves in its residuals.

    A wall's mean error cannot be seen, for the lenses bend to it. But where squares of neighbours are off together by
    more than the noise of single points, walls are, too: blur on slanting walls, light of other walls in the codes.

    Parameters
    ----------
    fit : Fit
        A solution.
    x1 : (N, 2)
        Camera pixels of its points. [px]
    label : (N,)
        Their walls.

    Returns
    -------
    float
        Standard deviation of each coordinate, on a wall that is wide. [px]
    """
    weighted = fit.residual * fit.weight[:, None]
    index = _cells(x1 // _SHARED_BLOCK_PX, label)
    count = np.bincount(index)
    many = count >= _LEAST_IN_BLOCK
    if many.sum() < _LEAST_SHARED_BLOCKS:
        return _USUAL_SHARED_PX
    sums = np.stack([np.bincount(index, column)[many] for column in weighted.T], axis=1)
    of_noise = float((weighted**2).mean()) / count[many]
    beyond = np.average((sums**2).mean(axis=1) / count[many] ** 2 - of_noise, weights=count[many])
    return float(np.clip(_SHARED_OVER_BLOCKS * np.sqrt(max(float(beyond), 0.0)), *_SHARED_RANGE_PX))


def common_covariance(fit: Fit, label: IntArray, weight: FloatArray | float, sigma_px: float) -> FloatArray:
    """Return the covariance that errors bring which all points of a wall share.

    Parameters
    ----------
    fit : Fit
        A solution.
    label : (N,)
        Walls of its points.
    weight : (N, 2) or float
        By which the points' residuals are multiplied.
    sigma_px : float
        Of the shared error of each coordinate on a wall with a tenth of the points or more. That of a smaller one is
        larger: the waves of error average over its area. [px]

    Returns
    -------
    (n, n)
        Of the unknowns.
    """
    pull = fit.jacobian * (fit.weight[:, None] * weight)
    numbers, count = np.unique(label, return_counts=True)
    larger = np.sqrt(np.maximum(_WIDE_SHARE * len(label) / count, 1.0))
    walls = np.stack([pull[:, label == k].sum(axis=1) * f for k, f in zip(numbers, larger, strict=True)], axis=1)
    moved = covariance(fit, 1.0) @ walls.reshape(len(fit.z), -1)
    return np.asarray(sigma_px**2 * moved @ moved.T)


def standard_deviations(
    figures: Callable[[FloatArray], FloatArray], unknowns: FloatArray, covariance: FloatArray
) -> FloatArray:
    """Carry the covariance of unknowns (n, n) into figures (m,) that follow from them: (m,) standard deviations."""
    _, slope = slopes(figures, unknowns)
    return np.asarray(np.sqrt(np.maximum(np.einsum("mi,ij,mj->m", slope, covariance, slope), 0)))


def normal_deviate(chi_squared: float, freedom: int) -> float:
    """Return a chi-squared variable as one of a standard normal (Wilson and Hilferty, PNAS 17, 1931)."""
    if freedom < 1:
        return 0.0
    spread = 2 / (9 * freedom)
    return float((np.cbrt(chi_squared / freedom) - (1 - spread)) / np.sqrt(spread))


def slopes(figures: Callable[[FloatArray], FloatArray], unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return figures (m,) that follow from unknowns (n,), and (m, n) by how much they change with each."""
    value = figures(unknowns)
    slope = np.empty((len(value), len(unknowns)))
    for k in range(len(unknowns)):
        moved = unknowns.copy()
        moved[k] += _STEP
        slope[:, k] = (figures(moved) - value) / _STEP
    return value, slope


def plus_minus(sigma: float, unit: str, *, most: float, decimals: int = 2) -> str:
    """Say a standard deviation in words: "+- 0.11 m"; "(not determined)" where it is larger than `most`, or no number.

    Of what the points leave open, the covariance holds numbers of any size, which say nothing.
    """
    return f"+- {sigma:.{decimals}f} {unit}" if sigma <= most else "(not determined)"
