"""From buffers to frames: bad ones rejected and counted, each good one with the start of its exposure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rig.devices.fingerprint import Fingerprint
from rig.devices.protocols import Clock, RawFrame
from rig.devices.v4l2 import abi
from rig.devices.v4l2.cadence import Cadence
from rig.devices.v4l2.formats import Layout, PixelFormat, Undecodable
from rig.devices.v4l2.stream import Filled, Stream
from rig.errors import DeviceError

_TIME_STAMP_SLACK_S = 1.0
"""A stamp further off is of another clock, or nonsense."""
_JITTER_SHARE = 0.75
"""Of a frame period."""


@dataclass(slots=True, kw_only=True)
class FrameSearch:
    """What came while a frame was searched for."""

    frames: int = 0
    with_error: int = 0
    short: int = 0
    undecodable: int = 0
    late: int = 0
    """Frames whose time stamps came too late to be trusted."""
    early_s: float | None = None

    def __str__(self) -> str:
        if not self.frames:
            return "no frame came at all"
        rejected = (
            f"{self.with_error} with the error flag, {self.short} too short, {self.undecodable} undecodable, "
            f"{self.late} stamped too late"
        )
        early = "" if self.early_s is None else f", the newest began {self.early_s * 1e3:.0f} ms too early"
        return f"{self.frames} frames came, {rejected}{early}"


class Frames:
    """The frames of a stream, in order.

    Parameters
    ----------
    stream
        Started.
    pixel_format, layout, channels
        What its buffers hold.
    period_s
        Of the frame rate that is set.
    exposes_always
        It has no exposure control, and exposes for the whole frame period.
    clock
        CLOCK_MONOTONIC.
    """

    def __init__(
        self,
        stream: Stream,
        pixel_format: PixelFormat,
        layout: Layout,
        channels: int,
        *,
        period_s: float,
        exposes_always: bool,
        clock: Clock,
    ):
        self._stream = stream
        self._format = pixel_format
        self._layout = layout
        self._channels = channels
        self._period_s = period_s
        self._exposes_always = exposes_always
        self._clock = clock
        self._began_s = clock.now_s()
        self._fingerprint = Fingerprint()
        self._last_print: tuple[int, int, bytes] | None = None
        self._rejected = 0
        self._ended_s = -math.inf
        self._cadence = Cadence(period_s)

    def next(self, after_s: float, until_s: float, exposure_s: float, seen: FrameSearch) -> RawFrame | None:
        """The next good frame that began at or after a time; None when none has come by ``until_s``.

        Raises DeviceLost, and StreamBroken when the stream has to be started again.
        """
        while True:
            filled = self._stream.next(until_s)
            if filled is None:
                return None
            try:
                frame = self._look_at(filled, after_s, exposure_s, seen)
            finally:
                self._stream.give_back(filled.index)
            if frame is not None:
                return frame
            if self._clock.now_s() >= until_s:
                return None

    def _look_at(self, filled: Filled, after_s: float, exposure_s: float, seen: FrameSearch) -> RawFrame | None:
        """The frame in a buffer; None when it is bad, began too early, or nobody knows when.

        The time stamp of a bad one is not looked at: a buffer that no frame came into, as when the cable is pulled,
        has none. The first one after frames that nobody saw may be a copy of one of them: it only serves to judge
        the next.
        """
        seen.frames += 1
        if self._is_bad(filled, seen):
            return None
        self._check_time_stamp(filled)
        is_late = self._cadence.is_late(filled.number, filled.stamp_s, exposure_s)
        seen.late += is_late
        started_s = self._started_s(filled, exposure_s)
        is_wanted = started_s >= after_s and not filled.unseen and not is_late
        try:
            with self._stream.bytes_of(filled) as data:
                fingerprint = self._fingerprint.of(data)
                pixels = self._format.decode(data, self._layout, self._channels) if is_wanted else None
        except Undecodable:
            seen.undecodable += 1
            self._rejected += 1
            return None
        repeats, self._last_print = fingerprint == self._last_print, fingerprint
        lost, self._rejected = filled.lost + self._rejected, 0
        if started_s < after_s:
            seen.early_s = after_s - started_s
        if pixels is None:
            return None
        return RawFrame(
            pixels=pixels,
            exposure_s=exposure_s,
            started_s=started_s,
            sequence=filled.number,
            lost=lost,
            repeats=repeats,
        )

    def _started_s(self, filled: Filled, exposure_s: float) -> float:
        """Start of exposure; where exposures abut, none is said to begin before the last one's end.

        Time stamps jitter, exposures do not overlap. What is added so was taken off before: nothing is known of when
        in its period such a camera exposes, so its stamps count as those of a frame's end. A larger overlap is left.
        """
        started_s = start_of_exposure(filled, exposure_s, self._period_s, self._format.is_compressed)
        if not self._exposes_always:
            return started_s
        if _is_start(filled):
            started_s -= self._period_s
        if 0 < self._ended_s - started_s < _JITTER_SHARE * self._period_s:
            started_s = self._ended_s
        self._ended_s = started_s + exposure_s
        return started_s

    def _is_bad(self, filled: Filled, seen: FrameSearch) -> bool:
        is_short = filled.bytes_used < self._format.least_bytes(self._layout)
        seen.with_error += filled.has_error
        seen.short += is_short and not filled.has_error
        self._rejected += filled.has_error or is_short
        return filled.has_error or is_short

    def _check_time_stamp(self, filled: Filled) -> None:
        if filled.flags & abi.TIMESTAMP_MASK != abi.TIMESTAMP_MONOTONIC:
            raise DeviceError(
                f"the driver's time stamps are not of the monotonic clock (flags {filled.flags:#x}), so fresh frames "
                "cannot be told from stale ones; take another driver or camera"
            )
        now_s = self._clock.now_s()
        latest_s = now_s + self._period_s + _TIME_STAMP_SLACK_S
        if not self._began_s - _TIME_STAMP_SLACK_S <= filled.stamp_s <= latest_s:
            raise DeviceError(
                f"a frame's time stamp is {filled.stamp_s - now_s:+.3f} s from now, so it is of another clock; "
                "with uvcvideo: echo CLOCK_MONOTONIC > /sys/module/uvcvideo/parameters/clock"
            )


def start_of_exposure(filled: Filled, exposure_s: float, period_s: float, is_compressed: bool) -> float:
    """Return when a frame's exposure began at the latest, by what its time stamp can be trusted for.

    A frame that is said to have begun later than it did may carry the picture before; one that is said to have begun
    earlier only costs another frame. So each stamp is read in its least favourable meaning:

    - "Start of exposure" is what uvcvideo flags although it stamps the first packet that arrives, which a camera
      sends when the first row has been exposed: one exposure is taken off.
    - "End of frame" (the default of V4L2) is stamped when the last row has arrived; rows arrive during one frame
      period at most: exposure and period are taken off.
    - A compressed frame cannot be sent before its last row is read: another period is taken off.

    What a camera keeps frames for inside, no stamp tells; `rig check` measures it as part of the latency.
    """
    ended_s = filled.stamp_s
    if not _is_start(filled):
        ended_s -= period_s
    if is_compressed:
        ended_s -= period_s
    return ended_s - exposure_s


def _is_start(filled: Filled) -> bool:
    return filled.flags & abi.TIMESTAMP_SOURCE_MASK == abi.TIMESTAMP_START_OF_EXPOSURE
