"""Brightness that does not pump: pure functions that tell the next gain from the last one."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from rig.live.sources.source import Pixels

WHITE_SHARE = 0.01
"""Share of the projector's pixels that automatic gain allows at white."""
TIME_CONSTANT_S = 1.5
"""Of automatic gain: brightness moves by under 1 % a frame, which nobody sees."""
_CUT_GREY = 30.0
"""Mean change of a thumbnail, in grey levels, that no movement makes in one frame."""
_AFTER_CUT_S = 0.08
"""Time constant while a new scene is still new: the eye does not follow a jump of the picture."""
_NEW_SCENE_S = 0.4
"""How long a scene counts as new: five of its time constants, so that the gain has arrived."""
_STEPS = 16
_FALL, _RISE = 0.5, 1.5
"""Furthest that a step's aim may lie from the gain of now: the next frame tells more. Chosen."""
_LEAST_GAIN = 0.05


@dataclass(frozen=True, slots=True)
class GainState:
    """Automatic gain between two frames."""

    gain: float = 1.0
    since_cut_s: float = math.inf


def smoothed(value: float, wanted: float, elapsed_s: float, time_constant_s: float) -> float:
    """First-order low pass: what a value becomes that has been drawn to ``wanted`` for ``elapsed_s``."""
    return wanted + (value - wanted) * math.exp(-elapsed_s / time_constant_s)


def next_gain(state: GainState, white_share: float, most: float, elapsed_s: float, *, is_cut: bool) -> GainState:
    """Gain of the next frame.

    Parameters
    ----------
    state
        Of the last frame.
    white_share
        Share of the last frame's projector codes that were at white.
    most
        The user's gain: automatic gain only darkens.
    elapsed_s
        Since the last frame.
    is_cut
        The scene is new.
    """
    since_cut_s = 0.0 if is_cut else state.since_cut_s + elapsed_s
    constant_s = _AFTER_CUT_S if since_cut_s < _NEW_SCENE_S else TIME_CONSTANT_S
    gain = smoothed(state.gain, wanted_gain(state.gain, white_share, most), elapsed_s, constant_s)
    return replace(state, gain=gain, since_cut_s=since_cut_s)


def wanted_gain(gain: float, white_share: float, most: float) -> float:
    """Return where the gain is drawn to: down while too much is at white, up while hardly anything is, else nowhere."""
    if white_share > WHITE_SHARE:
        return max(gain * max(math.sqrt(math.sqrt(WHITE_SHARE / white_share)), _FALL), _LEAST_GAIN * most)
    return min(gain * _RISE, most) if white_share < WHITE_SHARE / 2 else min(gain, most)


def share_at_white(codes: Pixels) -> float:
    """Share of codes at 255, of a sample on a grid."""
    return float((codes[::_STEPS, ::_STEPS] == 255).mean())


def thumbnail(codes: Pixels) -> Pixels:
    """(9, 16, 3) means of a picture over large fields, of a sample on a grid."""
    sample = np.ascontiguousarray(codes[:: _STEPS // 2, :: _STEPS // 2])
    return np.asarray(cv2.resize(sample, (16, 9), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def is_scene_cut(before: Pixels, after: Pixels) -> bool:
    """Return whether two thumbnails show different scenes."""
    if before.shape != after.shape:
        return True
    return float(np.abs(after.astype(np.int16) - before).mean()) > _CUT_GREY
