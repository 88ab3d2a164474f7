"""Blur of projector and camera as a function of place, from pictures of checkers or stripes that are taken anyway.

A camera pixel sees direct light of the projector picture through a Gaussian whose covariance, in projector pixels, is
σp² I + J (σc² + 1/12) Jᵀ: σp the projector's blur there, σc the camera's, 1/12 the camera's own square pixel, J the
derivative of projector by camera pixels. A checker is a product of a row and a column of ±1, so is its blurred
picture, and a blurred step is the error function: no picture need be blurred to know what a pixel is lit with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import erf

from calibration.arrays import BoolArray, Codes, Float32Array, FloatArray
from calibration.errors import CalibrationError
from calibration.structured_light.correspondence import Correspondence

_PIXEL_VARIANCE_PX2 = 1 / 12
"""Of a square pixel."""
LEAST_VARIANCE_PX2 = 0.01
"""Below, a blur is none; it keeps the error function's argument finite."""
_START_PX2 = 0.4
"""Variance of each lens at the start: a blur of 0.6 px."""
_SAMPLES = 5000
"""Camera pixels that the fit looks at: the widths are known to 1 % from a tenth of them."""
_ITERATIONS = 20
_SETTLED_PX2 = 1e-3
_MOST_SHIFT_PX = 0.3
_MOST_STEP_PX2 = 0.25
"""Of a lens's variance in one step of the fit: far from its end the problem is not linear."""
_PLACE_SIGMA_PX = 0.3
"""Of a place before the fit: what codes leave at worst. It decides where no edge of a check comes near."""
_LEAST_SCATTER = 3e-3
"""Of the light of a pixel, as a share of its direct light: no camera is better, however few pictures there are."""
_EDGES = 2
"""Nearest edges on each side that reach a pixel: with checks of 4 blurs or more the third does not."""
_SQRT_HALF, _SQRT_2_PI = np.sqrt(0.5), np.sqrt(2 * np.pi)
_PRIOR_INFORMATION = np.array([0.1, 4.0, 4.0, 4.0] * 2 + [1.0])
"""Of each coefficient before any light is seen [1/px⁴]: a variance changes by some 0.5 px² over a picture. Only where
camera and projector cannot be told apart does it decide."""
_LEAST_FRAMES, _LEAST_PIXELS = 8, 200
_EDGE_PX = 6.0
"""Samples keep so far from the projector picture's border, where white too is blurred."""


@dataclass(frozen=True, eq=False)
class LensBlur:
    """Variance of a lens's point spread over its picture, a paraboloid whose axis may stand anywhere."""

    shape: tuple[int, int]
    """(height, width) of the picture, in pixels."""
    coefficients_px2: tuple[float, float, float, float]
    """c0 + cx u + cy v + c2 (u² + v²), (u, v) from the picture's centre over half its diagonal."""

    def variance_px2(self, xy_px: FloatArray) -> FloatArray:
        """Return (…,) the variance at image points (…, 2); below 0 where pixels are smaller than their distance."""
        return np.asarray(_basis(xy_px, self.shape) @ np.array(self.coefficients_px2))

    def sigma_px(self, xy_px: FloatArray) -> FloatArray:
        """Return (…,) the standard deviation at image points (…, 2)."""
        return np.sqrt(np.maximum(self.variance_px2(xy_px), 0.0))


@dataclass(frozen=True, eq=False, kw_only=True)
class PointSpread:
    """Blur of projector and camera."""

    projector: LensBlur
    camera: LensBlur
    between_pixels: float
    """By how much the projector's variance between two of its pixels is above that at their centres: 0 for square
    pixels side by side, 1 for points that straight lines join."""
    covariance: FloatArray
    """(9, 9) of the projector's coefficients, the camera's, and `between_pixels`. [px⁴]"""
    rms: float
    """What the fit leaves of the samples' light, as a share of their direct light."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Footprint:
    """What each of N camera pixels sees of the projector picture: a Gaussian, its axes those of the picture."""

    xy_px: FloatArray
    """(N, 2) its centre."""
    variance_px2: FloatArray
    """(N, 2) along columns and rows."""


@dataclass(frozen=True, eq=False)
class TwoLevelPicture:
    """A picture of black and white that is the product of a row and a column of ±1: checkers, stripes."""

    column: FloatArray
    """(width,) ±1."""
    row: FloatArray
    """(height,) ±1; white where the product is 1."""


def two_level(codes: Codes) -> TwoLevelPicture:
    """Return a picture of codes 0 and 255 as a row and a column of ±1.

    Raises
    ------
    CalibrationError
        If it has other codes, or is no product.
    """
    signs = np.where(codes > codes.max() / 2, 1.0, -1.0)
    picture = TwoLevelPicture(signs[0] * signs[0, 0], signs[:, 0].copy())
    if not np.isin(codes, (0, 255)).all() or not np.array_equal(np.outer(picture.row, picture.column), signs):
        raise CalibrationError("this picture is no checker and no stripes: its blur has no closed form; give checkers")
    return picture


def stretch(correspondence: Correspondence) -> FloatArray:
    """Return (H, W, 2): Σ_k J[x, k]² and Σ_k J[y, k]², by which a camera's variance counts in projector pixels.

    From differences over a few pixels, on one side where the other has no correspondence; 0 where none has one.
    """
    xy = correspondence.projector_xy_px.astype(np.float64)
    slopes = [_slope(xy, axis) for axis in (0, 1)]
    return np.asarray(np.nansum([slope**2 for slope in slopes], axis=0))


def _slope(xy: FloatArray, axis: int, reach: int = 2) -> FloatArray:
    ahead, behind = (np.full_like(xy, np.nan) for _ in range(2))
    low, high = [slice(None)] * 3, [slice(None)] * 3
    low[axis], high[axis] = slice(None, -reach), slice(reach, None)
    difference = (xy[tuple(high)] - xy[tuple(low)]) / reach
    ahead[tuple(low)], behind[tuple(high)] = difference, difference
    both = (ahead + behind) / 2
    return np.where(np.isfinite(both), both, np.where(np.isfinite(ahead), ahead, behind))


def footprints(spread: PointSpread, xy_px: FloatArray, camera_xy_px: FloatArray, stretched: FloatArray) -> Footprint:
    """Return what camera pixels see of the projector picture.

    Parameters
    ----------
    spread : PointSpread
    xy_px : (N, 2)
        Projector pixel of each.
    camera_xy_px : (N, 2)
        Where each stands in the camera's picture.
    stretched : (N, 2)
        Of :func:`stretch`.
    """
    camera = spread.camera.variance_px2(camera_xy_px) + _PIXEL_VARIANCE_PX2
    variance = spread.projector.variance_px2(xy_px)[:, None] + stretched * camera[:, None]
    variance += spread.between_pixels * _between_pixels(xy_px)
    return Footprint(xy_px=xy_px, variance_px2=np.maximum(variance, LEAST_VARIANCE_PX2))


def footprint_map(spread: PointSpread, correspondence: Correspondence) -> Footprint:
    """Return what every camera pixel sees, (H, W, 2) each; NaN where it has no correspondence."""
    height, width = correspondence.valid.shape
    camera_xy_px = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
    xy_px = np.where(correspondence.valid[..., None], correspondence.projector_xy_px, np.nan).astype(np.float64)
    seen = footprints(spread, xy_px.reshape(-1, 2), camera_xy_px.reshape(-1, 2), stretch(correspondence).reshape(-1, 2))
    return Footprint(xy_px=xy_px, variance_px2=seen.variance_px2.reshape(height, width, 2))


def white_share(seen: Footprint, projector_shape: tuple[int, int]) -> FloatArray:
    """Return (…,) how much of a white picture pixels see: 1 but for those at its border; 0 where they see nothing."""
    xy = np.nan_to_num(seen.xy_px.reshape(-1, 2), nan=-1e6)
    variance = np.nan_to_num(seen.variance_px2.reshape(-1, 2), nan=1.0)
    height, width = projector_shape
    along = [blurred_steps(np.ones(n), xy[:, k], variance[:, k])[0] for k, n in enumerate((width, height))]
    return np.asarray((along[0] * along[1]).reshape(seen.xy_px.shape[:-1]))


def blurred_steps(signs: FloatArray, x: FloatArray, variance: FloatArray, order: int = 0) -> FloatArray:
    """Return (1 + order, N) a row of ±1, dark (0) outside, after a Gaussian blur, and its derivatives along the row.

    Parameters
    ----------
    signs : (n,)
        Value of each pixel; the first reaches from -0.5 to 0.5.
    x : (N,)
        Where it is wanted. [px]
    variance : (N,)
        Of the blur. [px²]
    order : int
        Of the highest derivative, at most 2.
    """
    padded = np.concatenate([[0.0], signs, [0.0]])
    at = np.flatnonzero(np.diff(padded))
    edges, jumps = at - 0.5, np.diff(padded)[at]
    first = np.searchsorted(edges, x, side="right")
    result = np.zeros((order + 1, len(x)))
    result[0] = padded[np.clip(np.floor(x + 0.5).astype(np.intp), -1, len(signs)) + 1]
    sigma = np.sqrt(variance)
    for k in range(-_EDGES, _EDGES):
        which = np.clip(first + k, 0, len(edges) - 1)
        jump = np.where(which == first + k, jumps[which], 0.0)
        t = (x - edges[which]) / sigma
        result[0] += jump * 0.5 * (erf(t * _SQRT_HALF) - np.where(t >= 0, 1.0, -1.0))
        if order:
            bell = jump * np.exp(-0.5 * t * t) / (_SQRT_2_PI * sigma)
            result[1] += bell
        if order > 1:
            result[2] -= t / sigma * bell
    return result


def lit_share(picture: TwoLevelPicture, seen: Footprint) -> FloatArray:
    """Return (N,) share of white's direct light that pixels get of a picture."""
    (x, y), (vx, vy) = seen.xy_px.T, seen.variance_px2.T
    inside = blurred_steps(np.ones_like(picture.column), x, vx)[0] * blurred_steps(np.ones_like(picture.row), y, vy)[0]
    pattern = blurred_steps(picture.column, x, vx)[0] * blurred_steps(picture.row, y, vy)[0]
    return np.asarray(0.5 * (inside + pattern))


def fit_point_spread(
    frames: Sequence[Float32Array],
    patterns: Sequence[Codes],
    correspondence: Correspondence,
    usable: BoolArray,
) -> PointSpread:
    """Find the blur of both lenses from pictures of checkers (or of stripes along rows and along columns).

    Each sample pixel has its own direct light, its own constant light and its own place in the projector picture;
    what is common to all, how fast light changes across the edges of the checks, are the two lenses' variances.

    Parameters
    ----------
    frames : (K of) (H, W)
        Linear light above black.
    patterns : (K of) (h, w)
        The codes that were shown, 0 or 255.
    correspondence : Correspondence
        Which projector pixel each camera pixel sees.
    usable : (H, W)
        Pixels that are lit and not clipped.

    Returns
    -------
    PointSpread

    Raises
    ------
    CalibrationError
        For fewer than 8 frames, pictures that are neither checkers nor stripes, or too few usable pixels.
    """
    if len(frames) < _LEAST_FRAMES:
        raise CalibrationError(f"{len(frames)} pictures to find the blur from, at least {_LEAST_FRAMES} are needed")
    problem = _problem(frames, [two_level(codes) for codes in patterns], correspondence, usable)
    z = np.zeros(9)
    z[[0, 4]] = _START_PX2
    information, rms = np.eye(9), np.inf
    for _ in range(_ITERATIONS):
        step, shift_px, information, rms = problem.step(z)
        z, problem = z + step, replace(problem, xy=problem.xy + shift_px)
        if np.abs(step[[0, 4]]).max() < _SETTLED_PX2:
            break
    parts = [tuple(float(c) for c in part) for part in (z[:4], z[4:8])]
    return PointSpread(
        projector=LensBlur(correspondence.projector_shape, parts[0]),  # type: ignore[arg-type]
        camera=LensBlur(usable.shape, parts[1]),  # type: ignore[arg-type]
        between_pixels=float(z[8]),
        covariance=np.asarray(np.linalg.inv(information), dtype=np.float64),
        rms=rms,
    )


def _held(z: FloatArray, step: FloatArray) -> FloatArray:
    """The step of the coefficients, cut to what its linear problem holds for; no lens gets sharper than 0."""
    cut = step * min(1.0, _MOST_STEP_PX2 / max(float(np.abs(step[[0, 4]]).max()), 1e-12))
    cut[[0, 4]] = np.maximum(cut[[0, 4]], -z[[0, 4]])
    return np.asarray(cut)


def _problem(
    frames: Sequence[Float32Array],
    pictures: Sequence[TwoLevelPicture],
    correspondence: Correspondence,
    usable: BoolArray,
) -> _BlurProblem:
    stretched = stretch(correspondence)
    xy = correspondence.projector_xy_px.astype(np.float64)
    height, width = correspondence.projector_shape
    with np.errstate(invalid="ignore"):
        inside = ((xy > _EDGE_PX) & (xy < np.array([width, height]) - 1 - _EDGE_PX)).all(axis=-1)
    chosen = usable & correspondence.valid & inside & (stretched > 0).all(axis=-1)
    rows, columns = np.nonzero(chosen)
    if len(rows) < _LEAST_PIXELS:
        raise CalibrationError(
            f"{len(rows)} lit pixels with a projector pixel to find the blur from, at least {_LEAST_PIXELS} are "
            "needed: look at the correspondence map"
        )
    few = np.random.default_rng(0).permutation(len(rows))[:_SAMPLES]
    rows, columns = rows[few], columns[few]
    return _BlurProblem(
        light=np.stack([frame[rows, columns].astype(np.float64) for frame in frames]),
        pictures=tuple(pictures),
        xy=xy[rows, columns],
        camera_xy=np.stack([columns, rows], axis=-1).astype(np.float64),
        stretched=stretched[rows, columns],
        shapes=((height, width), usable.shape),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _BlurProblem:
    """Sample pixels, and how their light changes with the coefficients z (9,)."""

    light: FloatArray
    """(K, N)."""
    pictures: tuple[TwoLevelPicture, ...]
    xy: FloatArray
    camera_xy: FloatArray
    stretched: FloatArray
    shapes: tuple[tuple[int, int], tuple[int, int]]

    @cached_property
    def basis(self) -> FloatArray:
        """(2, N, 9): derivative of the variance along columns and rows by the coefficients."""
        projector, camera = _basis(self.xy, self.shapes[0]), _basis(self.camera_xy, self.shapes[1])
        shape = _between_pixels(self.xy)
        return np.stack(
            [
                np.concatenate([projector, self.stretched[:, k, None] * camera, shape[:, k, None]], axis=1)
                for k in (0, 1)
            ]
        )

    def step(self, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """A Gauss-Newton step of z, one of the samples' places, the information about z, and the residual."""
        variance = (self.basis @ z).T + _PIXEL_VARIANCE_PX2 * self.stretched
        seen = Footprint(xy_px=self.xy, variance_px2=np.maximum(variance, LEAST_VARIANCE_PX2))
        regressors = shares_and_slopes(self.pictures, seen, order=2)
        own = np.concatenate([regressors[:3], np.ones_like(regressors[:1])]).transpose(2, 1, 0)
        widths = regressors[3:].transpose(2, 1, 0)
        light = self.light.T[..., None]
        known = (_LEAST_SCATTER / _PLACE_SIGMA_PX) ** 2
        gram = own.transpose(0, 2, 1) @ own + np.diag([1e-9, known, known, 1e-9])
        found = np.linalg.solve(gram, own.transpose(0, 2, 1) @ np.concatenate([light, widths], axis=2))
        rest = np.concatenate([light, widths], axis=2) - own @ found
        direct = found[:, 0, 0]
        residual, slopes = rest[..., 0], rest[..., 1:] * direct[:, None, None]
        jacobian = np.einsum("nka,anz->nkz", slopes, self.basis)
        scatter = np.sqrt((residual**2).sum(axis=1) / (len(self.pictures) - 4))
        typical = max(float(np.median(scatter / np.maximum(direct, 1e-9))), _LEAST_SCATTER)
        weight = np.where(direct > 0, 1 / np.maximum(scatter, typical * direct), 0.0) ** 2
        weight *= 1 / (1 + (scatter / np.maximum(2 * typical * direct, 1e-12)) ** 2)
        information = np.einsum("nkz,nky,n->zy", jacobian, jacobian, weight) + np.diag(_PRIOR_INFORMATION)
        right = np.einsum("nkz,nk,n->z", jacobian, residual, weight) - _PRIOR_INFORMATION * z
        step = _held(z, np.linalg.solve(information, right))
        shift = found[:, 1:3, 0] / np.where(direct > 0, direct, np.inf)[:, None]
        shift -= np.einsum("nka,an->nk", found[:, 1:3, 1:], self.basis @ step)
        shift_px = np.clip(shift, -_MOST_SHIFT_PX, _MOST_SHIFT_PX)
        return step, shift_px, information, float(typical)


def shares_and_slopes(pictures: Sequence[TwoLevelPicture], seen: Footprint, order: int = 1) -> FloatArray:
    """Return (1 + 2 order, K, N) the share of white that pixels get of K pictures, well inside of them, and its slopes.

    After the share come its derivatives along columns and along rows; with order 2 also those by the two variances.
    """
    (x, y), (vx, vy) = seen.xy_px.T, seen.variance_px2.T
    c = _derivatives([picture.column for picture in pictures], x, vx, order)
    r = _derivatives([picture.row for picture in pictures], y, vy, order)
    found = np.empty((1 + 2 * order, len(pictures), len(x)))
    np.multiply(c[0], r[0], out=found[0])
    for k in range(1, order + 1):
        # The variance of a Gaussian is its time in the heat equation: ∂s/∂v = ½ ∂²s/∂x².
        np.multiply(c[k], r[0], out=found[2 * k - 1])
        np.multiply(c[0], r[k], out=found[2 * k])
    found[:3] *= 0.5
    found[3:] *= 0.25
    found[0] += 0.5
    return found


def _derivatives(signs: Sequence[FloatArray], x: FloatArray, variance: FloatArray, order: int) -> list[FloatArray]:
    """(K, N) blurred rows of ±1 and their derivatives up to an order; equal rows are computed once."""
    different, which = np.unique(signs, axis=0, return_inverse=True)
    found = [blurred_steps(each, x, variance, order) for each in different]
    return [np.stack([each[k] for each in found])[which] for k in range(order + 1)]


def _between_pixels(xy_px: FloatArray) -> FloatArray:
    """(N, 2) variance of a point between two pixels that share it by distance, less its mean along the line."""
    share = xy_px - np.floor(xy_px)
    return np.asarray(share * (1 - share) - 1 / 6)


def _basis(xy_px: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """(…, 4) 1, u, v, u² + v²."""
    height, width = shape
    uv = (xy_px - np.array([(width - 1) / 2, (height - 1) / 2])) / (np.hypot(height, width) / 2)
    u, v = uv[..., 0], uv[..., 1]
    return np.stack([np.ones_like(u), u, v, u * u + v * v], axis=-1)
