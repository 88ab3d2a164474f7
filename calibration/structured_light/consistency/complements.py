"""Whether patterns and their inverses are what they are called: in linear light all pairs have the same sum.

Neither blur nor light from other walls changes that, so a frame that shows another picture than it should (an old one,
of a camera's or a projector's queue) is told from whatever a scene does to stripes.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import Frame
from calibration.errors import CalibrationError

_INVERSE = "-inverse"
_LEAST_PAIRS = 4
"""Fewer have no middle one that a wrong one leaves as it is."""
_LIT, _STRONG = 5.0, 0.3
"""Of the noise limit, and of the contrast of bright pixels: there half of the contrast is 3.5 standard deviations of a
sum of four frames, and room light that flickers is less."""
_RESOLVED = 0.15
"""Contrast over light: with less, stripes are washed out, and a lamp that drifts by some per cent changes sums as much.
"""
_LEAST_LIT = 100
"""Pixels; fewer say nothing."""
_APART = 0.5
"""Of the contrast. A wrong picture changes a sum by all of it wherever the two differ; a lamp that drifts and room
light that flickers by some hundredths."""
_MOST_UNLIKE = 0.05
"""Of the lit pixels: the picture before changes a fifth of them and more, where the camera resolves stripes; whoever
walks through the picture, fewer."""


def refuse_stale_frames(
    frames: Mapping[str, Frame], noise_limit: float | NDArray[np.floating], saturation: float
) -> None:
    """Refuse frames of a code with inverses of which one shows another picture than it should.

    Parameters
    ----------
    frames : mapping of pattern name to (H, W)
        Linear in light, whole or every n-th pixel: each `NAME` with `NAME-inverse`, and `white` with `black`. [dn]
    noise_limit : float or (H, W)
        Two standard deviations of the difference of two frames. [dn]
    saturation : float
        Values from here on are clipped, and not judged. [dn]

    Raises
    ------
    CalibrationError
        If a pair's sum is not that of the others; the message names it.
    """
    pairs = [(name, f"{name}{_INVERSE}") for name in frames if f"{name}{_INVERSE}" in frames] + [("white", "black")]
    if len(pairs) <= _LEAST_PAIRS:
        return
    lit, other = (np.stack([frames[pair[k]] for pair in pairs]).astype(np.float32) for k in (0, 1))
    contrast = np.median(np.abs(lit[:-1] - other[:-1]), axis=0)
    total = np.median(lit + other, axis=0)
    judged = (contrast > _LIT * np.asarray(noise_limit)) & (contrast > _RESOLVED * total)
    judged &= np.maximum(lit, other).max(axis=0) < saturation
    if judged.sum() < _LEAST_LIT:
        return
    judged &= contrast > _STRONG * np.quantile(contrast[judged], 0.95)
    unlike = (np.abs(lit + other - total) > _APART * contrast)[:, judged].mean(axis=1)
    worst = int(unlike.argmax())
    if unlike[worst] > _MOST_UNLIKE:
        one, inverse = pairs[worst]
        raise CalibrationError(
            f"{one} and {inverse} do not add up to what the other pairs do at {100 * unlike[worst]:.0f} % of the lit "
            f"pixels (limit {100 * _MOST_UNLIKE:g} %): one of the two is a stale frame that shows another picture, or "
            "something moved; measure the latency of the rig with `rig check`, or double projector.latency_s, and "
            "begin a new session"
        )
