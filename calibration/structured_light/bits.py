"""Words read from pairs of frames: which is the brighter one, and where noise leaves that open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration import _kernel
from calibration.arrays import Frame
from calibration.structured_light.frames import (
    Limit,
    common_kind,
    limit_of_kind,
    of_kind,
    part,
    saturation_of_kind,
)
from calibration.structured_light.gray import Words

OWN_LIGHT_BITS = 3
"""Next finer than wide stripes, with which both frames put the same light on other walls."""
SURE_SHARE = 0.85
"""Of the light that fine stripes say is a pixel's own: they, too, light other walls unevenly by a few per cent."""
_TELLING_PIXELS = 100_000
"""Enough for a median to 0.2 % of the pixels."""
_BRIGHT_ENOUGH = 0.3
"""Of the contrast of the brightest tenth: darker pixels are mostly of light that came from other surfaces."""
_UNEVEN = 0.02
"""Of the pixels, by which bright and dark stripes may differ: at a rim, behind things."""
_HALVES = (0.25, 0.8)
"""What half of the light may come to: 0.76 by gamma 2.5, 0.25 by gamma 0.5."""
_ANY = 2**16 - 1
"""Beyond twice any position: codes have at most 14 bits."""


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class BitPairs:
    """The photographs of one axis, all of one kind and contiguous, as the kernel takes them."""

    lit: tuple[Frame, ...]
    """Of each bit, the most significant first. (H, W) uint8, uint16 or float32 [dn]"""
    other: tuple[Frame, ...]
    """Which the first one is brighter than, where the bit is 1."""
    limit: NDArray[Any]
    """() or (H, W): a bit of which the two differ by less is open."""
    table: Words
    """Position of each word."""
    black: Frame | None
    """Given where wide stripes have to be told by the pixel's own light."""
    wide: int
    """Bits of wide stripes."""
    saturation: NDArray[Any] | None
    """(1,) values from here on are clipped."""
    first: int
    end: int
    """Twice the positions that the projector shows."""

    @classmethod
    def of(
        cls,
        pairs: Sequence[tuple[Frame, Frame]],
        limit: Limit,
        table: Words,
        *,
        black: Frame | None = None,
        wide: int = 0,
        saturation: float | None = None,
        bounds: tuple[int, int] = (0, _ANY),
    ) -> BitPairs:
        """Prepare to read an axis; limit and saturation are numbers that its frames can be held against."""
        is_told = black is not None and wide > 0 and len(pairs) >= wide + OWN_LIGHT_BITS
        kind = common_kind([frame for pair in pairs for frame in pair])
        return cls(
            lit=tuple(of_kind(lit, kind) for lit, _ in pairs),
            other=tuple(of_kind(other, kind) for _, other in pairs),
            limit=limit_of_kind(limit, kind),
            table=table,
            black=of_kind(black, kind) if black is not None and is_told else None,
            wide=wide,
            saturation=saturation_of_kind(saturation, kind),
            first=bounds[0],
            end=bounds[1],
        )

    def read(self, rows: slice, twice: NDArray[np.uint16], reason: NDArray[np.uint8]) -> None:
        """Find twice the positions that some rows show, and why pixels have none; of several reasons the lowest.

        One open bit is no harm if both its values give neighbouring positions: the pixel lies on the border
        between them, and that border is its position. ``calibration.reference.words`` is the definition.

        Parameters
        ----------
        rows : slice
        twice : (rows, W)
            To be filled.
        reason : (rows, W)
            PixelReason codes, of what is known already; to be changed.
        """
        _kernel.read_words(
            [frame[rows] for frame in self.lit],
            [frame[rows] for frame in self.other],
            limit=np.ascontiguousarray(part(self.limit, rows)).reshape(-1),
            wide=self.wide,
            black=None if self.black is None else self.black[rows],
            sure_share=SURE_SHARE,
            saturation=self.saturation,
            table=self.table,
            first=self.first,
            end=self.end,
            twice=twice,
            reason=reason,
        )


def difference(lit: Frame, other: Frame) -> Frame:
    """Return by how much two frames differ, in single precision."""
    return np.asarray(np.abs(lit.astype(np.float32) - other))


def middle(bright: Frame, dark: Frame, share: float = 0.5) -> Frame:
    """(H, W) level so far from black to white; of whole numbers its whole part, above which they are where above it."""
    if bright.dtype.kind == "u" and bright.dtype == dark.dtype:
        step = bright - np.minimum(bright, dark)
        return np.asarray(dark + np.floor(step * np.float32(share)).astype(step.dtype))
    light, none = bright.astype(np.float32), dark.astype(np.float32)
    return np.asarray(none + (light - none) * np.float32(share))


def half_share(finest: Sequence[Frame], bright: Frame, dark: Frame, contrast_limit: Limit) -> float:
    """Return what half of a pixel's light comes to, from black to white: 0.5, or up to three quarters by a tone curve.

    Of stripes so fine that all of a scene sees many of them, half of the pixels are on the bright side, whatever the
    curve: so half the light is at the median of what they read. Sharp stripes have nothing between dark and bright, and
    any level there tells them apart: then it is a half. Blurred ones are moved, dark ones made narrow, by a level that
    is not that of half the light.

    Parameters
    ----------
    finest : sequence of (H, W)
        Frames of the finest stripes of each axis. [dn]
    bright, dark : (H, W)
        Frames of white and black. [dn]
    contrast_limit : float or (H, W)
        Least white minus black of a pixel that tells. [dn]
    """
    step = max(1, int(np.sqrt(bright.size / _TELLING_PIXELS)))
    few = (slice(None, None, step), slice(None, None, step))
    black = dark[few].astype(np.float32)
    contrast = bright[few].astype(np.float32) - black
    lit = contrast >= np.asarray(contrast_limit)[few if np.ndim(contrast_limit) else ...]
    if not finest or not lit.any():
        return 0.5
    lit &= contrast > _BRIGHT_ENOUGH * np.quantile(contrast[lit], 0.9)
    shares = [(frame[few].astype(np.float32)[lit] - black[lit]) / contrast[lit] for frame in finest]
    ends = [np.nanquantile(share, (0.5 - _UNEVEN, 0.5 + _UNEVEN)) for share in shares]
    low, high = max(low for low, _ in ends), min(high for _, high in ends)
    return float(np.clip(np.clip(0.5, min(low, high), max(low, high)), *_HALVES))
