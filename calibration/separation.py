"""Direct and global light by shifted checkers.

S. K. Nayar, G. Krishnan, M. D. Grossberg, R. Raskar, Fast separation of direct and global components of a scene using
high frequency illumination, ACM Trans. Graph. 25(3), 2006. With a share a of the picture lit and a leak b of the unlit
checks, L+ = Ld + (a (1 - b) + b) Lg and L- = b Ld + (a (1 - b) + b) Lg.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from calibration.records import BoolArray, CalibrationError, Float32Array


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

    The largest and the smallest of many noisy values lie too far out; the mean of several of the highest and lowest
    ranks lies too far in where few checks light a pixel fully. The mean of ranks 2 … 1 + `ranks` of both ends is taken;
    what bias is left cancels in the sum, and `white`, when given, sets the sum: direct keeps its share.

    Parameters
    ----------
    frames : iterable of (H, W)
        Linear light above black, one a shift; half of every picture is lit. At least 2 (ranks + 1).
    leak : float
        Light of an unlit check over that of a lit one, beyond the black level that is already subtracted.
    white : (H, W), optional
        Linear light above black of a white picture.

    Raises
    ------
    CalibrationError
        For too few frames or a leak outside 0 … 0.5.
    """
    if not 0 <= leak < 0.5:
        raise CalibrationError(f"leak {leak:g} is outside 0 … 0.5: checks this blurred separate nothing; use larger ones")
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
        direct.astype(np.float32), np.maximum(global_, 0).astype(np.float32), valid & (direct >= 0) & (global_ >= 0)
    )


def _insert(ranked: Float32Array, image: Float32Array, outer: np.ufunc, inner: np.ufunc) -> None:
    """Keep the outermost values seen so far, in order; `image` is used up."""
    for k in range(len(ranked)):
        held = ranked[k].copy()
        outer(held, image, out=ranked[k])
        inner(held, image, out=image)
