"""The job of a live show: orders from a page in place of keys, and frame times for its strip chart."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.live.plan import LiveRequest, plan_live
from rig.live.run import run_live
from rig.live.show.controls import GAIN_RANGE, Controls
from rig.live.show.loop import LiveLoop, ShownFrame
from rig.live.sources.reader import Reader
from rig.page.jobs.requests import KeepJob, ShowJob
from rig.page.jobs.wire import Wire
from rig.records import JsonObject, Record
from rig.shows.keeper import KeeperState
from rig.shows.prepared import PreparedShow
from rig.shows.run import Operator, keep_show
from rig.terminal import OnStep

_STATUS_S = 0.25
"""Between two messages: a strip chart that moves, and little work beside the show."""
_PICTURE_S = 0.2
_PICTURE_WIDTH_PX = 480
"""Of what is on screen, to look at."""
_MOST_TIMES = 60


@dataclass(frozen=True, kw_only=True)
class ShowStatus(Record):
    """How a show is doing."""

    source: str
    strategy: str
    """Empty where pictures are shown as they are."""
    strategies: tuple[str, ...]
    compensating: bool
    gain: float
    auto_gain: bool
    frozen: bool
    black: bool
    frames: int
    late: int
    dropped: int
    repeated: int
    unplugged: int
    error_levels: float | None = None
    """Expected error, rms. [grey levels]"""
    times_ms: tuple[float, ...]
    """Between pictures since the last message."""
    period_ms: float
    failure: str | None = None


class PageRemote:
    """The page at a show: commands in place of keys, and what it charts.

    Parameters
    ----------
    wire
        To the server.
    """

    def __init__(self, wire: Wire):
        self._wire = wire
        self._keys = ""
        self._status_s = self._picture_s = 0.0
        self._times_ms: list[float] = []
        self._last_s: float | None = None

    def adjusted(self, controls: Controls) -> Controls:
        """Do to the settings what was ordered."""
        for order in self._wire.orders():
            try:
                controls = self._obey(order, controls)
            except UsageError as error:
                self._wire.tell("refused", {"error": str(error)})
        return controls

    def _obey(self, order: JsonObject, controls: Controls) -> Controls:
        value = order.get("value")
        match order.get("do"):
            case "next":
                self._keys += "n"
                return controls
            case "gain" if isinstance(value, int | float) and GAIN_RANGE[0] <= value <= GAIN_RANGE[1]:
                return replace(controls, gain=float(value))
            case "strategy" if value in ("exact", "bounded", "none"):
                if value == "none":
                    return replace(controls, compensating=False)
                return replace(controls, strategy=str(value), compensating=True)
            case ("compensating" | "auto_gain" | "frozen" | "black") as name if isinstance(value, bool):
                changed: dict[str, bool] = {str(name): value}
                return replace(controls, **changed)  # type: ignore[arg-type]
            case other:
                raise UsageError(
                    f"a show does not know {str(other)[:40]!r} with {str(value)[:40]!r}; load the page anew"
                )

    def pressed(self) -> str:
        """Return the keys that were ordered; q when the page wants the show's end."""
        keys, self._keys = self._keys, ""
        return keys + "q" if self._wire.is_stopping else keys

    def shown(self, frame: ShownFrame) -> None:
        """Note when a picture came, and send a small copy now and then."""
        if self._last_s is not None:
            self._times_ms.append(1e3 * (frame.on_screen_s - self._last_s))
        self._last_s = frame.on_screen_s
        now_s = time.monotonic()
        if now_s - self._picture_s >= _PICTURE_S:
            self._picture_s = now_s
            self._wire.tell("frame", {"number": frame.number, "taken_s": time.time()}, small_jpeg(frame.codes))

    def follow(self, loop: LiveLoop, reader: Reader, dropped: int) -> None:
        """Tell how the show is doing."""
        now_s = time.monotonic()
        if now_s - self._status_s >= _STATUS_S:
            self._status_s = now_s
            self._wire.tell("state", self._status(loop, reader, dropped).as_json())
            self._times_ms.clear()

    def _status(self, loop: LiveLoop, reader: Reader, dropped: int) -> ShowStatus:
        statistics, controls = loop.statistics, loop.controls
        return ShowStatus(
            source=reader.name,
            strategy=controls.shown_strategy,
            strategies=loop.strategies,
            compensating=controls.compensating,
            gain=loop.gain,
            auto_gain=controls.auto_gain,
            frozen=controls.frozen,
            black=controls.black,
            frames=statistics.frames,
            late=statistics.late,
            dropped=dropped,
            repeated=statistics.repeated,
            unplugged=statistics.unplugged,
            error_levels=statistics.error_mean,
            times_ms=tuple(self._times_ms[-_MOST_TIMES:]),
            period_ms=1e3 / loop.refresh_rate_hz,
            failure=None if reader.failure is None else str(reader.failure),
        )


def small_jpeg(codes: NDArray[np.uint8]) -> bytes:
    """Return (H, W, 3) codes as a small JPEG; pixels are taken as they lie, for the show must not wait."""
    step = max(1, codes.shape[1] // _PICTURE_WIDTH_PX)
    return cv2.imencode(".jpg", codes[::step, ::step, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 75])[1].tobytes()


def show_on(job: ShowJob, wire: Wire, on_step: OnStep) -> JsonObject:
    """Show until the page, the sources or the time ends it; returns what `rig live --json` prints."""
    request = LiveRequest(
        folder=None if job.session is None else Path(job.session),
        profile=job.profile,
        sources=job.sources,
        strategy=job.strategy,
        gain=job.gain,
        auto_gain=job.auto_gain,
        endless=job.endless,
        keeps_going=job.keeps_going,
        rate_hz=job.rate_hz,
        seconds=job.seconds,
        is_linear=job.linear,
        threads=job.threads,
    )
    plan = plan_live(request, on_step)
    on_step("show", 0, 0)
    page = PageRemote(wire)
    return run_live(plan, remote=page, watcher=page).as_json()


def keep_on(job: KeepJob, wire: Wire, on_step: OnStep, prepared: PreparedShow | None = None) -> JsonObject:
    """Keep a saved show until the page ends it; returns what `rig live --show --json` prints.

    What was prepared before is used if it is still what the files say.
    """
    page = PageRemote(wire)

    def told(state: KeeperState) -> None:
        wire.tell("kept", state.as_json())
        on_step({"showing": "show"}.get(state.phase, state.phase), 0, 0)

    operator = Operator(remote=page, watcher=page, on_state=told)
    return keep_show(job.show, on_step, operator=operator, prepared=prepared).as_json()
