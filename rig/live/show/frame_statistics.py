"""What is counted while pictures run, in memory that does not grow."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.live.results import FrameFigures, Percentiles

_KEPT = 1 << 16
"""Frames over which medians and percentiles are taken: 18 minutes at 60 Hz."""
_MB = 1e6
_GREY_LEVELS = 255
_TOLERANCE = 0.6
"""Of the period: a picture may be due half a period before or after a refresh, and clocks jitter."""


class Ring:
    """The last numbers of a series."""

    def __init__(self, size: int = _KEPT):
        self._values = np.zeros(size)
        self._count = 0

    def add(self, value: float) -> None:
        """Note a number."""
        self._values[self._count % len(self._values)] = value
        self._count += 1

    @property
    def values(self) -> NDArray[np.float64]:
        """(N,) in no particular order."""
        return self._values[: min(self._count, len(self._values))]

    def quantile(self, share: float) -> float | None:
        """Return a quantile of the values; None without any."""
        return float(np.quantile(self.values, share)) if self._count else None


class FrameStatistics:
    """Counts and times of shown frames.

    Parameters
    ----------
    period_s
        Of the display.
    """

    def __init__(self, period_s: float):
        self.frames = 0
        self.late = 0
        self.repeated = 0
        self.out_of_order = 0
        self.unplugged = 0
        self.last_interval_s = period_s
        self._period_s = period_s
        self._last_number = 0
        self._last_s: float | None = None
        self._errors, self._error_count = 0.0, 0
        self._latencies_s, self._intervals_s, self._busy_s = Ring(), Ring(), Ring()

    def is_late(self, on_screen_s: float, deadline_s: float) -> bool:
        """Return whether a picture missed the refresh nearest to its deadline."""
        return on_screen_s > deadline_s + _TOLERANCE * self._period_s

    def note_frame(self, number: int, *, ready_s: float, busy_s: float, deadline_s: float, on_screen_s: float) -> None:
        """Count a frame that was shown, and the refreshes since the last one that had no new frame."""
        self.frames += 1
        self.late += self.is_late(on_screen_s, deadline_s)
        self.out_of_order += number <= self._last_number
        self._last_number = number
        self._latencies_s.add(on_screen_s - ready_s)
        self._busy_s.add(busy_s)
        if self._last_s is not None:
            self.last_interval_s = on_screen_s - self._last_s
            self._intervals_s.add(self.last_interval_s)
            self.repeated += max(round(self.last_interval_s / self._period_s) - 1, 0)
        self._last_s = on_screen_s

    def note_error(self, error: float) -> None:
        """Count a frame's expected error, share of full scale; NaN is not counted."""
        if math.isfinite(error):
            self._errors += _GREY_LEVELS * error
            self._error_count += 1

    def forget_interval(self) -> None:
        """The display was away: the next interval says nothing."""
        self._last_s = None

    def figures(self, dropped: int = 0) -> FrameFigures:
        """Counts, medians and percentiles; ``dropped`` frames of the source were never shown, so never on time."""
        wanted = self.frames + dropped
        interval_s = self._intervals_s.quantile(0.5)
        return FrameFigures(
            frames=self.frames,
            fps_median=1 / interval_s if interval_s else None,
            latency_ms=_percentiles(self._latencies_s),
            latency_frames_p99=_share(self._latencies_s.quantile(0.99), self._period_s),
            compute_ms=_percentiles(self._busy_s),
            late_frames=self.late,
            on_time_share=(self.frames - self.late) / wanted if wanted else None,
            dropped=dropped,
            repeated=self.repeated,
            out_of_order=self.out_of_order,
            unplugged=self.unplugged,
            error_mean=self.error_mean,
        )

    @property
    def error_mean(self) -> float | None:
        """Mean of the frames' expected errors so far; None without any. [grey levels]."""
        return self._errors / self._error_count if self._error_count else None


def _percentiles(times_s: Ring) -> Percentiles:
    return Percentiles(_ms(times_s.quantile(0.5)), _ms(times_s.quantile(0.99)))


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else 1000 * seconds


def _share(seconds: float | None, period_s: float) -> float | None:
    return None if seconds is None else seconds / period_s


def resident_mb() -> float:
    """Memory that this process has now. [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / _MB
