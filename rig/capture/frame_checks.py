"""Whether a frame belongs to a picture.

It does when its exposure began after the picture's light had settled, with the exposure that was set, and when it
is no copy of an older frame with a new time stamp: the noise of a real sensor never comes twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.devices.protocols import RawFrame

EXPOSURE_TOLERANCE = 0.01
"""Relative; a frame whose exposure differs by more is from before the camera took the setting over."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a frame has to be."""

    settled_s: float
    """Its exposure begins then or later, on the rig's clock."""
    exposure_s: float | None
    """None: any."""


@dataclass(frozen=True, slots=True)
class Rejection:
    """Why a frame is not the one that was asked for."""

    kind: str
    """stale, ahead, repeated, lost, malformed or exposure."""
    detail: str


class FrameValidator:
    """Judges the frames of one camera, in the order in which it delivers them.

    Parameters
    ----------
    shape
        (height, width, channels) of the camera's frames.
    full_scale_dn
        The largest digital number that they may hold.
    period_s
        Between two frames; a time stamp further ahead of the clock is wrong.
    live
        Whether frames come from a sensor, with noise that never repeats. A recording may give a frame twice.
    """

    def __init__(self, shape: tuple[int, int, int], full_scale_dn: int, period_s: float, *, live: bool):
        self._shape = shape
        self._full_scale_dn = full_scale_dn
        self._period_s = period_s
        self._live = live
        self._last: RawFrame | None = None
        self._last_sequence: int | None = None

    def forget_count(self) -> None:
        """The camera was opened again: its counter may begin anew."""
        self._last_sequence = None

    def rejection(self, frame: RawFrame, wanted: Wanted, now_s: float) -> Rejection | None:
        """Say what is wrong with the next frame; None when it is good. Remembers it either way."""
        found = (
            self._out_of_order(frame)
            or self._malformed(frame)
            or self._wrong_time(frame, wanted.settled_s, now_s)
            or _wrong_exposure(frame, wanted.exposure_s)
            or self._copied(frame)
            or self._after_a_gap(frame)
        )
        self._remember(frame)
        return found

    def _remember(self, frame: RawFrame) -> None:
        """A lower number on a newer frame is a counter that began anew: believed from the next frame on."""
        newer = self._last is None or frame.started_s > self._last.started_s
        if newer or self._last_sequence is None or frame.sequence > self._last_sequence:
            self._last_sequence = frame.sequence
        self._last = frame

    def _out_of_order(self, frame: RawFrame) -> Rejection | None:
        last = self._last_sequence
        if last is None or frame.sequence > last:
            return None
        return Rejection("repeated", f"frame {frame.sequence} came after frame {last}")

    def _malformed(self, frame: RawFrame) -> Rejection | None:
        pixels = frame.pixels
        if pixels.dtype != np.uint16 or pixels.shape != self._shape:
            detail = f"frame of {pixels.dtype} {pixels.shape}, expected uint16 {self._shape}"
            return Rejection("malformed", detail)
        brightest = int(pixels.max())
        if brightest > self._full_scale_dn:
            return Rejection("malformed", f"pixel of {brightest} dn, full scale is {self._full_scale_dn} dn")
        return None

    def _wrong_time(self, frame: RawFrame, settled_s: float, now_s: float) -> Rejection | None:
        if not frame.started_s >= settled_s:
            early_ms = (settled_s - frame.started_s) * 1e3
            return Rejection("stale", f"exposure began {early_ms:.1f} ms before the picture settled")
        ahead_s = frame.started_s - now_s
        if ahead_s > self._period_s:
            detail = f"time stamp is {ahead_s:.3g} s ahead of the clock: the camera uses another clock"
            return Rejection("ahead", detail)
        return None

    def _copied(self, frame: RawFrame) -> Rejection | None:
        if not self._live or not (frame.repeats or self._equals_last(frame)) or _is_constant(frame.pixels):
            return None
        return Rejection("repeated", f"frame {frame.sequence} has the pixels of the frame before: frozen?")

    def _equals_last(self, frame: RawFrame) -> bool:
        """The middle row alone tells two frames of a sensor apart."""
        if self._last is None or frame.pixels.shape != self._last.pixels.shape:
            return False
        middle = len(frame.pixels) // 2
        return np.array_equal(frame.pixels[middle], self._last.pixels[middle]) and np.array_equal(
            frame.pixels, self._last.pixels
        )

    def _after_a_gap(self, frame: RawFrame) -> Rejection | None:
        """Nobody can tell whether a frame is a copy of one that was lost."""
        if not self._live or not frame.lost:
            return None
        return Rejection("lost", f"{frame.lost} frames before frame {frame.sequence}")


def _wrong_exposure(frame: RawFrame, set_s: float | None) -> Rejection | None:
    if set_s is not None and not abs(frame.exposure_s - set_s) <= EXPOSURE_TOLERANCE * set_s:
        return Rejection("exposure", f"exposed {frame.exposure_s:.6g} s, set {set_s:.6g} s")
    return None


def _is_constant(pixels: NDArray[np.uint16]) -> bool:
    """Black or saturated everywhere: such frames are equal without being copies."""
    return bool(pixels.min() == pixels.max())
