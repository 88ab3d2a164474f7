"""Direct and global light by shifted checkers.

S. K. Nayar, G. Krishnan, M. D. Grossberg, R. Raskar, Fast separation of direct and global components of a
scene using high frequency illumination, ACM Trans. Graph. 25(3), 2006. With a share a of the picture lit and
a leak b of the unlit checks, L+ = Ld + (a (1 - b) + b) Lg and L- = b Ld + (a (1 - b) + b) Lg.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.arrays import BoolArray, Codes, Float32Array, FloatArray, IntArray
from calibration.errors import CalibrationError
from calibration.light.blur import PointSpread, fit_point_spread, footprint_map, footprints, stretch
from calibration.light.outline import beside_border, border_width_px, continued_places, looks_at_picture
from calibration.light.two_level import Footprint, TwoLevelPicture, shares_and_slopes, two_level, white_share
from calibration.structured_light.correspondence import Correspondence

LEAST_MODULATION = 0.05
"""Of the pattern's rms change over its shifts, 0.5 without blur: below, direct light rests on its noise."""
_PASSES = 2
"""A place that is 0.3 px off (beside the corners of a room) is found to 0.03 px in the first."""
_LEAST_SUM = 1e-12
"""A sum of squared changes of light below this is none: a millionth of a pixel's light."""
_MOST_SHIFT_PX = 0.6
_WIDER, _MOST_CHANGE, _OF_TYPICAL = 2.0, 0.01, 0.2
"""No lens's blur is a Gaussian: light whose share would change by more than the second, had the blur so many times its
variance, counts less; where checks are all blur, than that share of what is usual there. On the sharpest random rigs a
bias of 1 % falls to a fifth."""
_CHUNK = 1 << 15
"""Pixels at a time: what they need stays in the cache."""
_MOST_OF_WHITE = 1.2
"""Direct light above this share of white is a wrong correspondence: noise of a lit pixel is a few percent."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Separation:
    """Light for a white picture, in the unit of the frames."""

    direct: Float32Array
    global_: Float32Array
    valid: BoolArray
    """Pixels with finite, not negative parts."""
    variance: Float32Array | None = None
    """Of direct light, by what the frames leave; inf where not valid."""
    projector_xy_px: Float32Array | None = None
    """(H, W, 2) which projector pixel each camera pixel sees, by the checkers' edges: finer than the code's."""
    place_variance_px2: Float32Array | None = None
    """(H, W) variance of these places along an axis, by what the frames leave."""


def separate(
    frames: Iterable[Float32Array],
    *,
    leak: float = 0.0,
    white: Float32Array | None = None,
    ranks: int = 2,
) -> Separation:
    """Split the light of white into direct and global.

    The largest and the smallest of many noisy values lie too far out; the mean of several of the highest and
    lowest ranks lies too far in where few checks light a pixel fully. The mean of ranks 2 … 1 + `ranks` of
    both ends is taken; what bias is left cancels in the sum, and `white`, when given, sets the sum: direct
    keeps its share.

    Parameters
    ----------
    frames : iterable of (H, W)
        Linear light above black, one a shift; half of every picture is lit. At least 2 (ranks + 1).
    leak : float
        Light of an unlit check over that of a lit one, beyond the black level that is already subtracted.
    white : (H, W), optional
        Linear light above black of a white picture.
    ranks : int
        Values of each end that are averaged.

    Returns
    -------
    Separation
        (H, W), in the frames' unit.

    Raises
    ------
    CalibrationError
        For too few frames or a leak outside 0 … 0.5.
    """
    if not 0 <= leak < 0.5:
        raise CalibrationError(f"leak {leak:g} is outside 0 … 0.5: so blurred, checks separate nothing; use larger")
    kept = ranks + 1
    high: Float32Array | None = None
    count = 0
    for frame in frames:
        image = np.asarray(frame, dtype=np.float32)
        if high is None:
            high = np.full((kept, *image.shape), -np.inf, dtype=np.float32)
            low = np.full((kept, *image.shape), np.inf, dtype=np.float32)
        _insert(high, image.copy(), np.maximum, np.minimum)
        _insert(low, image.copy(), np.minimum, np.maximum)
        count += 1
    if high is None or count < 2 * kept:
        raise CalibrationError(f"{count} checker frames, at least {2 * kept} are needed; photograph more shifts")
    bright, dark = high[1:].mean(axis=0), low[1:].mean(axis=0)
    direct = (bright - dark) / (1 - leak)
    global_ = 2 * (dark - leak * bright) / (1 - leak**2)
    valid = np.isfinite(direct) & np.isfinite(global_)
    if white is not None:
        total = direct + global_
        scale = np.where(total > 0, white / np.where(total > 0, total, 1), 1)
        direct, global_ = direct * scale, global_ * scale
    return Separation(
        direct=direct.astype(np.float32),
        global_=np.maximum(global_, 0).astype(np.float32),
        valid=valid & (direct >= 0) & (global_ >= 0),
    )


def _insert(ranked: Float32Array, image: Float32Array, outer: np.ufunc, inner: np.ufunc) -> None:
    """Keep the outermost values seen so far, in order; `image` is used up."""
    for k in range(len(ranked)):
        held = ranked[k].copy()
        outer(held, image, out=ranked[k])
        inner(held, image, out=image)


def separate_by_pattern(
    frames: Sequence[Float32Array],
    patterns: Sequence[Codes],
    correspondence: Correspondence,
    *,
    white: Float32Array,
    spread: PointSpread | None = None,
) -> Separation:
    """Split the light of white where the correspondence tells what each pixel was lit with.

    The light of a pixel in frame k is direct light times the share s_k that the blurred pattern gives it, plus what
    is the same in all frames. Its direct light is the slope of its frames over s_k; a small error of its place in the
    projector picture is found with it (its light then also follows the slopes of s_k along columns and rows), and so
    is no bias. Global light is what direct light leaves of white.

    Parameters
    ----------
    frames : (N of) (H, W)
        Linear light above black.
    patterns : (N of) (h, w)
        The codes that were shown, 0 or 255: checkers.
    correspondence : Correspondence
        Which projector pixel each camera pixel sees.
    white : (H, W)
        Linear light above black of a white picture.
    spread : PointSpread, optional
        Blur of both lenses; default: found from the same frames.

    Returns
    -------
    Separation
        Valid where the correspondence is, the pattern changes enough, and a pixel looks at the picture, not beside it.

    Raises
    ------
    CalibrationError
        If the pattern changes enough nowhere: checks too small for the blur, or no correspondence.
    """
    if spread is None:
        spread = fit_point_spread(frames, patterns, correspondence, correspondence.valid)
    problem = _Pixels(frames, [two_level(codes) for codes in patterns], spread, stretch(correspondence))
    xy_px, found = problem.split_all(correspondence)
    finer = np.where(correspondence.valid[..., None], xy_px, np.nan).astype(np.float32)
    seen = footprint_map(spread, replace(correspondence, projector_xy_px=finer))
    inside = white_share(seen, correspondence.projector_shape).astype(np.float32)
    full, variance, modulation, place = found.astype(np.float32)
    direct = full * inside
    valid = (modulation > LEAST_MODULATION) & (direct > 0) & (direct < _MOST_OF_WHITE * white)
    valid &= looks_at_picture(finer, correspondence.projector_shape)
    if not valid.any():
        raise CalibrationError(
            f"the checkers' light changes nowhere by more than {LEAST_MODULATION:g} of white: "
            "use larger checks ([patterns] checker_size_px), focus the projector, or look at the correspondence map"
        )
    direct = np.where(valid, direct, 0).astype(np.float32)
    return Separation(
        direct=direct,
        global_=np.maximum(white - direct, 0).astype(np.float32),
        valid=valid,
        variance=np.where(valid, variance * inside**2, np.inf).astype(np.float32),
        projector_xy_px=finer,
        place_variance_px2=place,
    )


def with_more_direct(found: Separation, share: float, *, white: Float32Array) -> Separation:
    """Return the same with more direct light, by a share of it; global light is what it then leaves of white.

    Parameters
    ----------
    found : Separation
    share : float
        As :func:`~calibration.light.cross_check.cross_check` finds it by the middles of checks: edges are as wide as
        blur, whose shape no model knows to the last per cent, and what it leaves is direct light's.
    white : (H, W) or (H, W, B)
        Linear light above black of a white picture.

    Returns
    -------
    Separation
    """
    direct = found.direct * np.float32(1 + share)
    return replace(found, direct=direct, global_=np.maximum(white - direct, 0).astype(np.float32))


@dataclass(frozen=True, eq=False)
class _Pixels:
    """Frames of known pictures, and what is needed to say what pixels see of them."""

    frames: Sequence[Float32Array]
    pictures: Sequence[TwoLevelPicture]
    spread: PointSpread
    stretched: FloatArray

    def split_all(self, correspondence: Correspondence) -> tuple[FloatArray, FloatArray]:
        """Places (H, W, 2), moved where light tells, and (4, H, W) as of :meth:`split`.

        Beside the border of the picture they are those of the pixels inside, continued.
        """
        valid, xy_px = correspondence.valid, correspondence.projector_xy_px.astype(np.float64)
        seen = footprint_map(self.spread, correspondence)
        beside = valid & beside_border(seen, correspondence.projector_shape)
        found = np.zeros((4, *valid.shape))
        self.split(np.nonzero(valid & ~beside), xy_px, found)
        width_px = border_width_px(seen, self.stretched, beside)
        continued, outline = continued_places(xy_px, valid & ~beside, beside, width_px), np.nonzero(beside)
        told, untold = (tuple(axis[which] for axis in outline) for which in (continued.told, ~continued.told))
        xy_px[told] = continued.xy_px[continued.told]
        straight = stretch(replace(correspondence, projector_xy_px=xy_px.astype(np.float32)))
        replace(self, stretched=straight).split(told, xy_px, found, are_known=True)
        found[3][told] = continued.variance_px2[continued.told]
        self.split(untold, xy_px, found)
        return xy_px, found

    def split(self, at: tuple[IntArray, ...], xy_px: FloatArray, found: FloatArray, *, are_known: bool = False) -> None:
        """Find direct light, its variance, the pattern's rms change and the variance of places, (4, H, W), of pixels.

        Their places are moved to where light tells, unless they are known.
        """
        for first in range(0, len(at[0]), _CHUNK):
            some = tuple(axis[first : first + _CHUNK] for axis in at)
            light = np.stack([frame[some] for frame in self.frames]).astype(np.float64)
            there = np.stack(some[::-1], axis=-1).astype(np.float64)
            for _ in range(1 if are_known else _PASSES):
                seen = footprints(self.spread, xy_px[some], there, self.stretched[some])
                slopes = _slope_of_light(light, self.pictures, seen, are_known=are_known)
                xy_px[some] += np.clip(slopes[4:].T, -_MOST_SHIFT_PX, _MOST_SHIFT_PX)
            found[:, some[0], some[1]] = slopes[:4]


def _slope_of_light(
    light: FloatArray, pictures: Sequence[TwoLevelPicture], seen: Footprint, *, are_known: bool
) -> FloatArray:
    """(6, N) direct light, its variance, the pattern's rms change, the variance and the errors (x, y) of the places.

    Of light (K, N); places that are known are off by nothing.
    """
    regressors = shares_and_slopes(pictures, seen)
    weight = _weights(pictures, seen, regressors[0])
    count = weight.sum(axis=0)
    # Centred and multiplied by the root of the weights, sums of products are weighted moments.
    root = np.sqrt(weight)
    s, x, y, centred = (
        root * (values - np.einsum("kn,kn->n", weight, values) / count) for values in (*regressors[:3], light)
    )
    if are_known:
        x, y = np.zeros_like(x), np.zeros_like(y)
    ss, xx, yy, sx, sy, xy = (np.einsum("kn,kn->n", a, b) for a, b in ((s, s), (x, x), (y, y), (s, x), (s, y), (x, y)))
    sl, xl, yl = (np.einsum("kn,kn->n", a, centred) for a in (s, x, y))
    determinant = np.maximum(xx * yy - xy * xy, _LEAST_SUM)
    # What of s the slopes cannot stand for, and its share of the light.
    u, v = (yy * sx - xy * sy) / determinant, (xx * sy - xy * sx) / determinant
    own = np.maximum(ss - u * sx - v * sy, _LEAST_SUM)
    direct = (sl - u * xl - v * yl) / own
    a, b = (yy * xl - xy * yl) / determinant, (xx * yl - xy * xl) / determinant
    left = np.einsum("kn,kn->n", centred, centred) - a * xl - b * yl - direct**2 * own
    scatter = np.maximum(left, 0) / np.maximum(count - 4, 1)
    safe = np.where(np.abs(direct) > 0, direct, np.inf)
    # Weights are not those of noise: what has a small weight adds less noise than its part of the sums. Where the
    # pattern does not change along an axis, its frames know nothing of the place along it.
    told = np.minimum(xx, yy) > _LEAST_SUM
    noise = sum(
        np.einsum("kn,kn,kn->n", weight, each, each) / np.where(told, total, 1) ** 2
        for each, total in ((x, xx), (y, yy))
    )
    place = np.where(told, np.minimum(scatter * noise / (2 * safe**2), _MOST_SHIFT_PX**2), _MOST_SHIFT_PX**2)
    return np.stack([direct, scatter / own, np.sqrt(own / count), place, a / safe - u, b / safe - v])


def _weights(pictures: Sequence[TwoLevelPicture], seen: Footprint, share: FloatArray) -> FloatArray:
    """(K, N) how far a pixel's light tells direct light whatever the blur exactly is: 1 in the middle of a check."""
    wider = replace(seen, variance_px2=_WIDER * seen.variance_px2)
    change = shares_and_slopes(pictures, wider, order=0)[0] - share
    typical = np.sqrt(np.einsum("kn,kn->n", change, change) / len(change))
    return np.asarray(1 / (1 + (change / np.maximum(_MOST_CHANGE, _OF_TYPICAL * typical)) ** 2))
