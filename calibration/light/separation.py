"""Direct and global light by shifted checkers.

S. K. Nayar, G. Krishnan, M. D. Grossberg, R. Raskar, Fast separation of direct and global components of a
scene using high frequency illumination, ACM Trans. Graph. 25(3), 2006. With a share a of the picture lit and
a leak b of the unlit checks, L+ = Ld + (a (1 - b) + b) Lg and L- = b Ld + (a (1 - b) + b) Lg.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from calibration.arrays import BoolArray, Codes, Float32Array
from calibration.errors import CalibrationError
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.patterns import WHITE

MARGIN_PX = 2
"""Projector pixels next to a check's edge that count as neither fully lit nor fully unlit: a focused projector's blur,
0.6 px, stays within them (0.1 % of bias in simulated scenes; 1.2 % at 0.9 px)."""
_MOST_OF_WHITE = 1.2
"""Direct light above this share of white is a wrong correspondence: noise of a lit pixel is a few percent."""


@dataclass(frozen=True, eq=False)
class Separation:
    """Light for a white picture, in the unit of the frames."""

    direct: Float32Array
    global_: Float32Array
    valid: BoolArray
    """Pixels with finite, not negative parts."""


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
        raise CalibrationError(f"{count} checker frames, at least {2 * kept} are needed")
    bright, dark = high[1:].mean(axis=0), low[1:].mean(axis=0)
    direct = (bright - dark) / (1 - leak)
    global_ = 2 * (dark - leak * bright) / (1 - leak**2)
    valid = np.isfinite(direct) & np.isfinite(global_)
    if white is not None:
        total = direct + global_
        scale = np.where(total > 0, white / np.where(total > 0, total, 1), 1)
        direct, global_ = direct * scale, global_ * scale
    return Separation(
        direct.astype(np.float32),
        np.maximum(global_, 0).astype(np.float32),
        valid & (direct >= 0) & (global_ >= 0),
    )


def _insert(ranked: Float32Array, image: Float32Array, outer: np.ufunc, inner: np.ufunc) -> None:
    """Keep the outermost values seen so far, in order; `image` is used up."""
    for k in range(len(ranked)):
        held = ranked[k].copy()
        outer(held, image, out=ranked[k])
        inner(held, image, out=image)


def separate_by_pattern(
    frames: Iterable[Float32Array],
    patterns: Iterable[Codes],
    correspondence: Correspondence,
    *,
    white: Float32Array,
    leak: float = 0.0,
    margin_px: int = MARGIN_PX,
) -> Separation:
    """Split the light of white where the correspondence tells what each pixel was lit with.

    L+ is the mean over the shifts in which the pixel lies well inside a lit check, L- over those in which it
    lies well inside an unlit one. Unlike the largest and smallest values these means have no bias from
    noise, and none from a blur that stays within the margin (0.1 % at a blur of 0.6 px, 1.2 % at 0.9 px, 5 %
    at 1.2 px; checks of 8 px). Global light is what direct light leaves of white.

    Parameters
    ----------
    frames : (N of) (H, W)
        Linear light above black.
    patterns : (N of) (h, w)
        The codes that were shown, 0 or 255.
    correspondence : Correspondence
        Which projector pixel each camera pixel sees.
    white : (H, W)
        Linear light above black of a white picture.
    leak : float
        As for :func:`separate`.
    margin_px : int
        Less than half a check.

    Returns
    -------
    Separation
        Valid where the correspondence is and both kinds of shift occurred.

    Raises
    ------
    CalibrationError
        If both kinds of shift occurred nowhere: checks too small for the margin, or no correspondence.
    """
    element = np.ones((2 * margin_px + 1,) * 2, dtype=np.uint8)
    xy = np.nan_to_num(correspondence.projector_xy_px, nan=-9.0)
    x, y = (np.ascontiguousarray(xy[..., k], dtype=np.float32) for k in (0, 1))
    light = np.zeros((2, *x.shape), dtype=np.float32)
    count = np.zeros((2, *x.shape), dtype=np.float32)
    for frame, codes in zip(frames, patterns, strict=True):
        for k, picture in enumerate((codes, WHITE - codes)):
            inside = cv2.erode(picture, element, borderType=cv2.BORDER_CONSTANT, borderValue=0)
            here = cv2.remap(inside, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT) > 0
            light[k] += np.where(here, frame, np.float32(0))
            count[k] += here
    both = (count > 0).all(axis=0) & correspondence.valid
    lit, unlit = light / np.maximum(count, 1)
    direct = np.where(both, (lit - unlit) / (1 - leak), 0).astype(np.float32)
    valid = both & (direct > 0) & (direct < _MOST_OF_WHITE * white)
    if not valid.any():
        raise CalibrationError(
            f"no pixel lies {margin_px} px inside a lit check in one shift and an unlit one in another: "
            "use larger checks ([patterns] checker_size_px), or look at the correspondence map"
        )
    direct = np.where(valid, direct, 0)
    return Separation(direct, np.maximum(white - direct, 0).astype(np.float32), valid)
