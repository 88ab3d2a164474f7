"""Whether patterns and their inverses are what they are called: in linear light all pairs have the same sum.

Neither blur nor light from other walls changes that, so a frame that shows another picture than it should (an old one,
of a camera's or a projector's queue) is told from whatever a scene does to stripes. So is one in which the light of the
room was another, or somebody stood in the picture.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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
_CHANGED, _EVERYWHERE = 0.1, 0.8
"""Of the contrast, and of the lit pixels: what light in the room or a gain changes, while the stripes stay. Of a wrong
picture and its counterpart half is the same."""
_ONE_SIDED, _MOST_COVERED = 0.95, 0.35
"""Of the pixels that changed, and of the lit ones. A frame that shows black in place of stripes is darker in half."""


def refuse_stale_frames(
    frames: Mapping[str, Frame], noise_limit: float | NDArray[np.floating], saturation: float, *, swell: float = 0.0
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
    swell : float
        By what share of its light a mains light in the room makes single frames of black brighter and darker: so much
        may a pair's light change as black's does. [1]

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
    change = (lit + other - total)[:, judged]
    change = _without_swell(change, other[-1][judged], swell) / contrast[judged]
    unlike = (np.abs(change) > _APART).mean(axis=1)
    worst = int(unlike.argmax())
    if unlike[worst] > _MOST_UNLIKE:
        seen = float((np.abs(lit[worst] - other[worst]) > _APART * contrast)[judged].mean())
        one, inverse = pairs[worst]
        raise CalibrationError(
            f"{one} and {inverse} do not add up to what the other pairs do at {100 * unlike[worst]:.0f} % of the lit "
            f"pixels (limit {100 * _MOST_UNLIKE:g} %): {_cause(change[worst], seen, is_flat=one == 'white')}; "
            "keep lights, walls and devices as they are, and begin a new session"
        )


def superposition_error(
    pairs: Sequence[tuple[Frame, Frame]],
    white: Frame,
    black: Frame,
    *,
    noise_limit: float | NDArray[np.floating],
    saturation: float,
    swell: float = 0.0,
) -> float | None:
    """Return by how much light patterns have more with their inverses than white has, in all pairs alike.

    Light adds up, whatever a scene does with it: a pattern and its inverse make white. They do not where a projector
    dims bright pictures, or a camera brightens what lies in dark ones. What single pairs differ by, as where a lamp
    warms up from picture to picture, does not count, nor does what room light may add that swells.

    Parameters
    ----------
    pairs : sequence of two (H, W)
        Patterns and their inverses, linear in light, whole or every n-th pixel. [dn]
    white, black : (H, W)
        In the same pixels. [dn]
    noise_limit : float or (H, W)
        Two standard deviations of the difference of two frames. [dn]
    saturation : float
        Values from here on are clipped, and not judged. [dn]
    swell : float
        By what share of its light a mains light in the room makes single frames of black brighter and darker. [1]

    Returns
    -------
    float or None
        The least that any pair has more, or less, over the contrast of white; 0 where some have more and others less.
        None where too few pixels are lit, or there is no pair. [1]
    """
    contrast = white - black
    judged = (contrast > _LIT * np.asarray(noise_limit)) & (white < saturation)
    if not pairs or judged.sum() < _LEAST_LIT:
        return None
    judged &= contrast > _STRONG * np.quantile(contrast[judged], 0.95)
    lit, dark = contrast[judged], black[judged]
    shares = [float(np.median((one + other - white - black)[judged] / lit)) for one, other in pairs]
    common = max(min(shares), 0.0) + min(max(shares), 0.0)
    may_swell = 4 * swell * float(np.median(dark / lit))
    return float(np.sign(common) * max(abs(common) - may_swell, 0.0))


def _without_swell(change: NDArray[np.floating], black: NDArray[np.floating], swell: float) -> NDArray[np.floating]:
    """Changes of pairs (P, N) less what a mains light may add to all of their picture.

    Each of two frames may be off the light's mean by its amplitude, and so may each of the two of the middle pair.
    """
    if swell <= 0:
        return change
    most = 4 * swell / max(1 - swell, swell)
    share = np.median(change / np.maximum(black, np.finfo(np.float32).tiny), axis=1, keepdims=True)
    return np.asarray(change - np.clip(share, -most, most) * black)


def _cause(change: NDArray[np.floating], seen: float, *, is_flat: bool) -> str:
    """What changed the sum of a pair so, as shares of the contrast; the pair's own stripes are seen at a share of them.

    A wrong picture makes some stripes brighter and others darker; of white and black, only one of the two.
    """
    brighter, darker = (float((sign * change > _CHANGED).mean()) for sign in (1, -1))
    if min(max(brighter, darker), seen) > _EVERYWHERE:
        return (
            f"all of the picture is {'brighter' if brighter > darker else 'darker'} in them: light in the room was "
            "switched or let in among the photographs, or a device changed its gain: switch everything automatic off"
        )
    unlike = change[np.abs(change) > _APART]
    covered = len(unlike) < _MOST_COVERED * len(change)
    if covered and not is_flat and float((unlike < 0).mean()) > _ONE_SIDED:
        return "these are darker, none are brighter: somebody or something stood in the light, or before the camera"
    return (
        "one of the two is a stale frame that shows another picture, or something moved: measure the latency of the "
        "rig with `rig check`, or double projector.latency_s"
    )
