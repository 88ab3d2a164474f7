"""A live show from beginning to end: pictures run until somebody ends them, and black comes last."""

from __future__ import annotations

import gc
import math
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rig.live.pipeline import LivePipeline, open_pipeline
from rig.live.plan import LivePlan
from rig.live.results import Recorded, ShowResult, SourceFailure
from rig.live.show.controls import NoRemote, RemoteControl
from rig.live.show.frame_statistics import resident_mb
from rig.live.show.priority import realtime_priority
from rig.live.sources.source import SourceBroken
from rig.live.watcher import ShowWatcher
from rig.stages.error_tree import one_error_tree
from rig.terminal.signals import EndSignals, Interrupted

_STATUS_S = 0.5
"""Between two lines of status: a person reads no faster."""
_WARM_UP_S = 5.0
"""After that, memory should not grow any more."""
_SWITCH_INTERVAL_S = 0.0005
"""The loop's thread should not wait 5 ms, Python's usual, when the reader is at work."""

FIRST_PICTURE_S = 5.0
"""So much longer than the show lasts its first picture is waited for: a busy machine has been seen to take 0.4 s."""

OnStatus = Callable[[str], None]


@dataclass(slots=True, kw_only=True)
class _Progress:
    """How far a show is."""

    started_s: float
    until_s: float
    """When its time is over; that begins with the first picture."""
    seconds: float
    next_status_s: float
    awaits_first: bool = True
    """The first picture."""
    ended_by: str = ""
    """Empty while it goes on."""
    resident_mb: float | None = None
    """After the warm-up."""


def run_live(
    plan: LivePlan,
    on_status: OnStatus = lambda _: None,
    remote: RemoteControl | None = None,
    watcher: ShowWatcher | None = None,
) -> ShowResult:
    """Show sources until one of: time over, sources over, key q, a signal. The projector is black afterwards.

    Parameters
    ----------
    plan
        Of :func:`rig.live.plan.plan_live`.
    on_status
        Told a line for a person twice a second.
    remote
        Commands beside those of the keyboard.
    watcher
        Told of each frame and each step.

    Returns
    -------
    ShowResult
        What was shown, how fast, and what came late.

    Raises
    ------
    UsageError, SessionError
        A source or the folder of the recording cannot be used.
    DeviceError
        The projector does not open, or stayed away for longer than `timing.replug_timeout_s`.
    """
    with one_error_tree(), realtime_priority() as is_realtime:
        with EndSignals() as signals, open_pipeline(plan, signals, remote or NoRemote(), watcher) as pipeline:
            progress = _run(pipeline, signals, plan.request.seconds, on_status, watcher=watcher)
        return _result(plan, pipeline, progress, signals.received, is_realtime=is_realtime)


def _run(
    pipeline: LivePipeline,
    signals: EndSignals,
    seconds: float | None,
    on_status: OnStatus,
    *,
    watcher: ShowWatcher | None,
) -> _Progress:
    """Step until the end; whatever ends it, what was recorded is closed."""
    now_s = pipeline.clock.now_s()
    long_s = math.inf if seconds is None else seconds
    progress = _Progress(started_s=now_s, until_s=now_s + long_s + FIRST_PICTURE_S, seconds=long_s, next_status_s=now_s)
    pipeline.reader.start()
    try:
        with _undisturbed():
            while not progress.ended_by:
                pipeline.loop.step()
                _follow(pipeline, signals, progress, on_status)
                if watcher is not None:
                    watcher.follow(pipeline.loop, pipeline.reader, pipeline.mailbox.dropped)
        pipeline.loop.complete()
    except Interrupted:
        progress.ended_by = "signal"
    finally:
        if pipeline.recorder is not None:
            pipeline.recorder.close(frames=pipeline.loop.statistics.frames, ended_by=progress.ended_by or "error")
    return progress


@contextmanager
def _undisturbed() -> Iterator[None]:
    """No long garbage collection, and quick changes between threads."""
    before_s = sys.getswitchinterval()
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before_s)
        gc.unfreeze()


def _follow(pipeline: LivePipeline, signals: EndSignals, progress: _Progress, on_status: OnStatus) -> None:
    """After each step: has it ended, is a line of status due, is the warm-up over."""
    now_s = pipeline.clock.now_s()
    if progress.awaits_first and pipeline.loop.statistics.frames:
        progress.awaits_first = False
        progress.until_s = now_s + progress.seconds
    if signals.received is not None:
        progress.ended_by = "signal"
    elif now_s >= progress.until_s:
        progress.ended_by = "time"
    else:
        progress.ended_by = pipeline.loop.ended
    if now_s >= progress.next_status_s:
        on_status(status_line(pipeline))
        progress.next_status_s = now_s + _STATUS_S
    if progress.resident_mb is None and now_s - progress.started_s > _WARM_UP_S:
        progress.resident_mb = resident_mb()


def status_line(pipeline: LivePipeline) -> str:
    """One line for a person."""
    loop, statistics = pipeline.loop, pipeline.loop.statistics
    controls = loop.controls
    flags = [
        word
        for word, on in (("BLACK", controls.black), ("FROZEN", controls.frozen), ("auto", controls.auto_gain))
        if on
    ]
    return (
        f"{pipeline.reader.name} · {controls.shown_strategy or 'as it is'} · "
        f"{1 / statistics.last_interval_s:.0f} fps · {statistics.frames} frames, "
        f"{statistics.late} late, {pipeline.mailbox.dropped} dropped · "
        f"gain {loop.gain:.2f} {' '.join(flags)}"
    )


def _failure(pipeline: LivePipeline, progress: _Progress) -> SourceFailure | None:
    """What a source failed with; that none gave a picture in all the time there was is a failure, too."""
    error = pipeline.reader.failure
    if error is None and progress.ended_by == "time" and pipeline.loop.statistics.frames == 0:
        waited_s = progress.seconds + FIRST_PICTURE_S
        error = SourceBroken(
            f"{pipeline.reader.name}: no picture came in {waited_s:g} s; start what writes it, or show it for longer"
        )
    if error is None:
        return None
    return SourceFailure(kind=type(error).__name__, message=str(error), exit_status=error.exit_code)


def _result(
    plan: LivePlan, pipeline: LivePipeline, progress: _Progress, received: int | None, *, is_realtime: bool
) -> ShowResult:
    loop, recorder = pipeline.loop, pipeline.recorder
    grown_mb = None if progress.resident_mb is None else resident_mb() - progress.resident_mb
    return ShowResult(
        figures=loop.statistics.figures(pipeline.mailbox.dropped),
        strategy=loop.controls.shown_strategy or "none",
        gain=loop.gain,
        memory_growth_mb=grown_mb,
        seconds=pipeline.clock.now_s() - progress.started_s,
        sources=plan.request.sources,
        model=plan.model_origin,
        ended_by=progress.ended_by,
        signal=None if received is None else signal.Signals(received).name,
        failure=_failure(pipeline, progress),
        recorded=None if recorder is None else Recorded(recorder.frames, recorder.photographs),
        notes=(*plan.notes, *pipeline.notes, *pipeline.reader.notes, *([] if recorder is None else recorder.notes)),
        light_latency_ms=plan.light_latency_ms,
        real_time=is_realtime,
    )
