"""What a live show tells of itself when it is over; its JSON has every key, with null for what is not known."""

from __future__ import annotations

from dataclasses import dataclass, fields
from signal import Signals

from rig.records import JsonObject, Record, json_of

_OF_SIGNALS = 128
"""Added to a signal's number, as shells do: 130 SIGINT, 143 SIGTERM, 129 SIGHUP."""


def status_of_signal(name: str) -> int:
    """Return the exit status of a program that a signal ended, such as 143 for ``"SIGTERM"``."""
    return _OF_SIGNALS + Signals[name]


class FullRecord(Record):
    """A record whose JSON says null for what is not known."""

    def as_json(self) -> JsonObject:
        """The record as one JSON object with all its fields."""
        return {item.name: json_of(getattr(self, item.name)) for item in fields(self)}  # type: ignore[arg-type]


@dataclass(frozen=True)
class Percentiles(FullRecord):
    """Median and 99th percentile of times, in milliseconds."""

    p50: float | None
    p99: float | None


@dataclass(frozen=True, kw_only=True)
class LightLatency(FullRecord):
    """Time from a picture in memory to its light, in milliseconds."""

    p50: float
    p99: float
    max: float
    flashes: int
    """Over how many flashes."""
    unseen: float
    """How much of it the camera cannot tell, for its frames take time."""


@dataclass(frozen=True)
class Recorded(FullRecord):
    """How many files a recording has."""

    frames: int
    photographs: int


@dataclass(frozen=True, kw_only=True)
class FrameFigures(FullRecord):
    """Counts and times of the frames that were shown."""

    frames: int
    fps_median: float | None
    """Frames a second."""
    latency_ms: Percentiles
    """From complete in memory and due to on screen."""
    latency_frames_p99: float | None
    """The same in periods of the display."""
    compute_ms: Percentiles
    late_frames: int
    """Those that missed the refresh nearest to their deadline."""
    on_time_share: float | None
    """Of the frames that the sources gave."""
    dropped: int
    """Never shown: a newer one came first."""
    repeated: int
    """Refreshes without a new frame."""
    out_of_order: int
    unplugged: int
    """How often the display was away."""
    error_mean: float | None
    """Root mean square of predicted minus wanted camera image, mean over the frames. [grey levels]"""


@dataclass(frozen=True, kw_only=True)
class SourceFailure(FullRecord):
    """A source that gave no more pictures though it should have."""

    kind: str
    """CameraMissing, FilmBroken, PictureBroken, SourceGone or PipeBroken."""
    message: str
    exit_status: int
    """Of the command line, for whoever supervises it."""


@dataclass(frozen=True, kw_only=True)
class ShowResult(FullRecord):
    """A live show that is over."""

    figures: FrameFigures
    strategy: str
    """The last one; none where pictures were shown as they are."""
    gain: float
    memory_growth_mb: float | None
    """After the warm-up; None for shorter shows."""
    seconds: float
    sources: tuple[str, ...]
    model: str
    """Where it comes from, in words."""
    ended_by: str
    """time, source, quit, or signal."""
    signal: str | None
    failure: SourceFailure | None
    """The first source that failed and did not come back; None when all was well."""
    recorded: Recorded | None
    notes: tuple[str, ...]
    light_latency_ms: LightLatency | None
    real_time: bool
    """Whether its threads came before all normal work."""

    @property
    def exit_status(self) -> int:
        """What the command line ends with: 128 + the signal that ended it, the failed source's, else 0."""
        if self.signal is not None:
            return status_of_signal(self.signal)
        return 0 if self.failure is None else self.failure.exit_status

    def as_json(self) -> JsonObject:
        """One JSON object; the figures stand among the other keys."""
        whole = super().as_json()
        del whole["figures"]
        return {**self.figures.as_json(), **whole}
