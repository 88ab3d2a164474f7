"""Blur of projector and camera as a function of place, from pictures of checkers or stripes that are taken anyway.

A camera pixel sees direct light of the projector picture through a Gaussian whose covariance, in projector pixels, is
σp² I + J (σc² + 1/12) Jᵀ: σp the projector's blur there, σc the camera's, 1/12 the camera's own square pixel, J the
derivative of projector by camera pixels. What a pixel then sees of a checker: :mod:`calibration.light.two_level`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration.arrays import BoolArray, Codes, Float32Array, FloatArray, IntArray
from calibration.errors import CalibrationError
from calibration.light.two_level import Footprint, TwoLevelPicture, shares_and_slopes, two_level
from calibration.structured_light.correspondence import Correspondence

_PIXEL_VARIANCE_PX2 = 1 / 12
"""Of a square pixel."""
LEAST_VARIANCE_PX2 = 0.01
"""Below, a blur is none; it keeps the error function's argument finite."""
_STARTS_PX2 = (0.4, 0.05)
"""Variance of each lens at the starts, blurs of 0.6 and 0.2 px; the one that leaves less is taken. Where camera pixels
are as large as the projector's and sharp, the walk from the wider one may end at places off by half a pixel."""
_MUCH_LEFT = 0.03
"""Of direct light: what makes the second walk worth its time. The wrong end left 0.07, right ones 0.008 to 0.04."""
_SAMPLES = 5000
"""Camera pixels that the fit looks at: the widths are known to 1 % from a tenth of them."""
_ITERATIONS = 20
_SETTLED_PX2 = 1e-3
_MOST_SHIFT_PX = 0.3
_MOST_STEP_PX2, _MOST_STEP_SHARE = 0.25, 0.5
"""Of a lens's variance in one step of the fit, or that share of what it is: far from its end it is not linear."""
_PLACE_SIGMA_PX = 0.3
"""Of a place before the fit: what codes leave at worst. It decides where no edge comes near, or a single one."""
_LEAST_SCATTER = 3e-3
"""Of the light of a pixel, as a share of its direct light: no camera is better, however few pictures there are."""
_PRIOR_INFORMATION = np.array([0.1, 4.0, 4.0, 4.0] * 2 + [1.0])
"""Of each coefficient before any light is seen [1/px⁴]: a variance changes by some 0.5 px² over a picture. Only where
camera and projector cannot be told apart does it decide."""
_LEAST_FRAMES, _LEAST_PIXELS = 8, 200
_EDGE_PX = 6.0
"""Samples keep so far from the projector picture's border, where white too is blurred."""
_JUMP = 0.5
"""Projector pixels a pixel, and of the gentler slope: where those of both sides differ by more, a thing's edge lies to
one side. Beside the corners of rooms they differ by less, and noise of places is below a tenth."""


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


def stretch(correspondence: Correspondence) -> FloatArray:
    """Return (H, W, 2): Σ_k J[x, k]² and Σ_k J[y, k]², by which a camera's variance counts in projector pixels.

    From differences over a few pixels, on one side where the other has no correspondence, or lies beyond the edge of a
    thing; 0 where none has one.
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
    gentle = np.where(np.abs(ahead) < np.abs(behind), ahead, behind)
    jumps = np.abs(ahead - behind) > _JUMP + _JUMP * np.abs(gentle)
    both = np.where(jumps, gentle, (ahead + behind) / 2)
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


def variance_sigma_map(spread: PointSpread, correspondence: Correspondence) -> FloatArray:
    """Return (H, W, 2) the standard deviations of :func:`footprint_map`'s variances; NaN without correspondence."""
    height, width = correspondence.valid.shape
    camera_xy_px = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
    xy_px = np.where(correspondence.valid[..., None], correspondence.projector_xy_px, np.nan).astype(np.float64)
    shapes = (correspondence.projector_shape, correspondence.valid.shape)
    basis = _variance_basis(xy_px, camera_xy_px, stretch(correspondence), shapes)
    variance = np.einsum("a...z,a...z->...a", basis @ spread.covariance, basis)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


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
        raise CalibrationError(
            f"{len(frames)} pictures to find the blur from, at least {_LEAST_FRAMES} are needed; photograph more"
        )
    problem = _problem(frames, [two_level(codes) for codes in patterns], correspondence, usable)
    fits = [_fitted(problem, _STARTS_PX2[0])]
    if fits[0][2] > _MUCH_LEFT:
        fits.append(_fitted(problem, _STARTS_PX2[1]))
    z, information, rms = min(fits, key=lambda fit: fit[2])
    parts = [tuple(float(c) for c in part) for part in (z[:4], z[4:8])]
    return PointSpread(
        projector=LensBlur(correspondence.projector_shape, parts[0]),  # type: ignore[arg-type]
        camera=LensBlur(usable.shape, parts[1]),  # type: ignore[arg-type]
        between_pixels=float(z[8]),
        covariance=np.asarray(np.linalg.inv(information), dtype=np.float64),
        rms=rms,
    )


def _fitted(problem: _BlurProblem, start_px2: float) -> tuple[FloatArray, FloatArray, float]:
    """Coefficients (9,), the information about them, and the residual at the end of a walk from one width."""
    z = np.zeros(9)
    z[[0, 4]] = start_px2
    information, rms = np.eye(9), np.inf
    for _ in range(_ITERATIONS):
        step, shift_px, information, rms = problem.step(z)
        z, problem = z + step, replace(problem, xy=problem.xy + shift_px, scatter=rms)
        if np.abs(step[[0, 4]]).max() < _SETTLED_PX2:
            break
    return z, information, rms


def _held(z: FloatArray, step: FloatArray) -> FloatArray:
    """The step of the coefficients, cut to what its linear problem holds for; no lens gets sharper than 0."""
    most = max(_MOST_STEP_PX2, _MOST_STEP_SHARE * float(z[[0, 4]].max()))
    cut = step * min(1.0, most / max(float(np.abs(step[[0, 4]]).max()), 1e-12))
    cut[[0, 4]] = np.maximum(cut[[0, 4]], -z[[0, 4]])
    return np.asarray(cut)


def pixels_inside(
    xy_px: FloatArray, projector_shape: tuple[int, int], usable: BoolArray, *, edge_px: float, most: int
) -> tuple[IntArray, IntArray]:
    """Choose camera pixels by chance, always the same, that see the projector's picture away from its border.

    Parameters
    ----------
    xy_px : (H, W, 2)
        Projector pixel of each camera pixel; NaN where there is none.
    projector_shape : tuple of int
        (height, width) of the projector's picture.
    usable : (H, W)
        Those that may be chosen.
    edge_px : float
        Least distance from the border of the projector's picture.
    most : int
        Of the pixels.

    Returns
    -------
    rows, columns : (N,)
    """
    height, width = projector_shape
    with np.errstate(invalid="ignore"):
        inside = ((xy_px > edge_px) & (xy_px < np.array([width, height]) - 1 - edge_px)).all(axis=-1)
    rows, columns = np.nonzero(usable & inside)
    few = np.random.default_rng(0).permutation(len(rows))[:most]
    return rows[few], columns[few]


def _problem(
    frames: Sequence[Float32Array],
    pictures: Sequence[TwoLevelPicture],
    correspondence: Correspondence,
    usable: BoolArray,
) -> _BlurProblem:
    stretched, xy = stretch(correspondence), correspondence.projector_xy_px.astype(np.float64)
    told = usable & correspondence.valid & (stretched > 0).all(axis=-1)
    rows, columns = pixels_inside(xy, correspondence.projector_shape, told, edge_px=_EDGE_PX, most=_SAMPLES)
    if len(rows) < _LEAST_PIXELS:
        raise CalibrationError(
            f"{len(rows)} lit pixels with a projector pixel to find the blur from, at least {_LEAST_PIXELS} are "
            "needed: look at the correspondence map"
        )
    return _BlurProblem(
        light=np.stack([frame[rows, columns].astype(np.float64) for frame in frames]),
        pictures=tuple(pictures),
        told_xy=xy[rows, columns],
        xy=xy[rows, columns],
        camera_xy=np.stack([columns, rows], axis=-1).astype(np.float64),
        stretched=stretched[rows, columns],
        shapes=(correspondence.projector_shape, usable.shape),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _BlurProblem:
    """Sample pixels, and how their light changes with the coefficients z (9,)."""

    light: FloatArray
    """(K, N)."""
    pictures: tuple[TwoLevelPicture, ...]
    told_xy: FloatArray
    """(N, 2) places by the code ..."""
    xy: FloatArray
    """... and as they were found since."""
    camera_xy: FloatArray
    stretched: FloatArray
    shapes: tuple[tuple[int, int], tuple[int, int]]
    scatter: float = _LEAST_SCATTER
    """Of the light of a typical pixel, as a share of its direct light."""

    @cached_property
    def basis(self) -> FloatArray:
        """(2, N, 9): derivative of the variance along columns and rows by the coefficients."""
        return _variance_basis(self.xy, self.camera_xy, self.stretched, self.shapes)

    def step(self, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """A Gauss-Newton step of z, one of the samples' places, the information about z, and the residual."""
        variance = (self.basis @ z).T + _PIXEL_VARIANCE_PX2 * self.stretched
        seen = Footprint(xy_px=self.xy, variance_px2=np.maximum(variance, LEAST_VARIANCE_PX2))
        regressors = shares_and_slopes(self.pictures, seen, order=2)
        own = np.concatenate([regressors[:3], np.ones_like(regressors[:1])]).transpose(2, 1, 0)
        own = np.concatenate([own, self._told_places()], axis=1)
        seen_and_widths = np.concatenate([self.light[None], regressors[3:]]).transpose(2, 1, 0)
        seen_and_widths = np.concatenate([seen_and_widths, np.zeros((len(own), 2, 3))], axis=1)
        gram = own.transpose(0, 2, 1) @ own + np.diag([1e-9, 0.0, 0.0, 1e-9])
        found = np.linalg.solve(gram, own.transpose(0, 2, 1) @ seen_and_widths)
        rest = seen_and_widths - own @ found
        direct = found[:, 0, 0]
        residual, slopes = rest[..., 0], rest[..., 1:] * direct[:, None, None]
        jacobian = np.einsum("nka,anz->nkz", slopes, self.basis)
        scatter = np.sqrt((residual**2).sum(axis=1) / (len(self.pictures) - 2))
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

    def _told_places(self) -> FloatArray:
        """(N, 2, 4) what the code says of a pixel's place, as rows of its equations: zero but for noise.

        A single edge near a pixel tells its place as well as the blur, and neither alone.
        """
        rows = np.zeros((len(self.xy), 2, 4))
        rows[:, :, 0], rows[:, 0, 1], rows[:, 1, 2] = self.xy - self.told_xy, 1.0, 1.0
        return rows * (self.scatter / _PLACE_SIGMA_PX)


def _variance_basis(
    xy_px: FloatArray, camera_xy_px: FloatArray, stretched: FloatArray, shapes: Sequence[tuple[int, ...]]
) -> FloatArray:
    """(2, …, 9) derivative of the variances along columns and rows by the coefficients; of points (…, 2)."""
    projector, camera = _basis(xy_px, shapes[0]), _basis(camera_xy_px, shapes[1])
    between = _between_pixels(xy_px)
    parts = ([projector, stretched[..., k, None] * camera, between[..., k, None]] for k in (0, 1))
    return np.stack([np.concatenate(part, axis=-1) for part in parts])


def _between_pixels(xy_px: FloatArray) -> FloatArray:
    """(…, 2) variance of a point between two pixels that share it by distance, less its mean along the line."""
    share = xy_px - np.floor(xy_px)
    return np.asarray(share * (1 - share) - 1 / 6)


def _basis(xy_px: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """(…, 4) 1, u, v, u² + v²."""
    height, width = shape
    uv = (xy_px - np.array([(width - 1) / 2, (height - 1) / 2])) / (np.hypot(height, width) / 2)
    u, v = uv[..., 0], uv[..., 1]
    return np.stack([np.ones_like(u), u, v, u * u + v * v], axis=-1)
