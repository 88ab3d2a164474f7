"""The loop: the newest picture, compensated, on screen at the next refresh; once a refresh, until somebody ends it.

Pictures of a film are known ahead: the next one is computed while the last one is still on its way to the screen.
Pictures that come by themselves are taken as late as possible, and computed and shown one after the other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field

import numpy as np

from rig.capture.recovery import Recovery
from rig.devices.protocols import Clock, Projector, check_on_screen
from rig.errors import DeviceLost
from rig.live.show.compensator import Compensator
from rig.live.show.controls import Controls, NoRemote, RemoteControl, pressed
from rig.live.show.frame_mailbox import FrameQueue, LiveFrame
from rig.live.show.frame_pacing import DisplayClock, LatchTimer
from rig.live.show.frame_statistics import FrameStatistics
from rig.live.show.output import DirectOutput, Output
from rig.live.show.smoothing import GainState, is_scene_cut, next_gain, share_at_white, thumbnail
from rig.live.sources.source import Pixels

_WATCH_S = 0.5
"""Between two questions whether the picture is still on screen."""
_AHEAD = 1.35
"""Refreshes before its own that a film's picture is begun at the earliest: what it may be held up, and its latency."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ShownFrame:
    """A picture that was shown, for who records or watches."""

    number: int
    codes: Pixels
    """(H, W, 3) projector codes; good until the next frame."""
    on_screen_s: float
    gain: float
    controls: Controls


def no_keys() -> str:
    """Keys where there is no keyboard."""
    return ""


def nothing_more(_: ShownFrame) -> None:
    """Stand for a watcher of frames where there is none."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Pending:
    """A picture that is on its way to the screen."""

    codes: Pixels
    gain: float
    controls: Controls
    frame: LiveFrame | None = None
    """None if it was shown before, with other settings."""
    target_s: float = 0.0
    deadline_s: float = 0.0
    busy_s: float = 0.0
    in_time: bool = True
    """Begun when there was time enough."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopArguments:
    """All that the loop works with."""

    queue: FrameQueue
    """Gives it pictures."""
    compensators: Mapping[str, Compensator]
    """By strategy; empty when pictures can only be shown as they are."""
    projector: Projector
    """Open; shows them."""
    output: Output | None = None
    """Hands them to the projector; by default in the loop's own thread."""
    clock: Clock
    refresh_rate_hz: float
    replug_timeout_s: float = 20.0
    keys: Callable[[], str] = no_keys
    remote: RemoteControl = field(default_factory=NoRemote)
    next_source: Callable[[], None] = lambda: None
    on_shown: Callable[[ShownFrame], None] = nothing_more
    interrupting: Callable[[], AbstractContextManager[None]] = nullcontext
    """Around waits for a device."""
    notes: list[str] = field(default_factory=list)
    """What went wrong with the projector, and came right again."""


class LiveLoop:
    """Shows frames of a queue on a projector that is open; call :meth:`step` until :attr:`ended`, then `complete`."""

    def __init__(self, arguments: LoopArguments, controls: Controls):
        self.controls = controls
        self.statistics = FrameStatistics(1 / arguments.refresh_rate_hz)
        self.ended = ""
        """Why: quit, or source; empty while it goes on."""
        self._arguments = arguments
        self._period_s = 1 / arguments.refresh_rate_hz
        self._display = DisplayClock(self._period_s)
        self._latch_timer = LatchTimer(self._period_s)
        self._frame: LiveFrame | None = None
        self._output = arguments.output or DirectOutput(arguments.projector)
        self._pending: _Pending | None = None
        self._out, self._spare, self._black = (np.zeros((*arguments.projector.shape, 3), np.uint8) for _ in range(3))
        self._gain = GainState(controls.gain)
        self._scene = np.zeros((0, 0, 3), np.uint8)
        self._changed = False
        self._watched_s = arguments.clock.now_s()

    @property
    def gain(self) -> float:
        """The gain of the last frame."""
        return self._gain.gain if self.controls.auto_gain else self.controls.gain

    @property
    def refresh_rate_hz(self) -> float:
        """Of the display."""
        return self._arguments.refresh_rate_hz

    @property
    def strategies(self) -> tuple[str, ...]:
        """Names of what may compensate; none without a model."""
        return tuple(self._arguments.compensators)

    def step(self) -> None:
        """One refresh: keys, at most one picture, show it. Raises DeviceError when the projector stays away."""
        self._obey_keys()
        if self.ended:
            return
        target_s = self._display.target_s(self._arguments.clock.now_s() + self._latch_timer.lead_s)
        frame = self._take(target_s)
        if frame is not None:
            self._frame = frame
            self._show_frame(frame, target_s)
        elif self._changed and self._frame is not None:
            self._show_again(self._frame, target_s)
        else:
            self.complete()
            self._display.let_pass(target_s)
        self._changed = False
        self._watch()

    def complete(self) -> None:
        """Wait until the last picture is on screen. Raises DeviceError when the projector stays away."""
        pending, self._pending = self._pending, None
        if pending is None:
            return
        on_screen_s = self._finish(pending.codes)
        frame = pending.frame
        if frame is not None:
            missed = pending.in_time and self.statistics.is_late(on_screen_s, pending.target_s)
            self._latch_timer.note(pending.busy_s, is_late=missed)
            self.statistics.note_frame(
                frame.number,
                ready_s=frame.ready_s,
                busy_s=pending.busy_s,
                deadline_s=pending.deadline_s,
                on_screen_s=on_screen_s,
            )
            self._arguments.on_shown(
                ShownFrame(
                    number=frame.number,
                    codes=pending.codes,
                    on_screen_s=on_screen_s,
                    gain=pending.gain,
                    controls=pending.controls,
                )
            )

    @property
    def _ahead(self) -> bool:
        """Whether the next picture is computed while the last one is on its way."""
        return self._arguments.queue.is_timed and self._output.is_concurrent

    def _obey_keys(self) -> None:
        before, self.controls = self.controls, self._arguments.remote.adjusted(self.controls)
        self._changed = self._changed or self.controls != before
        for key in self._arguments.keys() + self._arguments.remote.pressed():
            if key == "q":
                self.ended = "quit"
            elif key == "n":
                self._arguments.next_source()
                self._restart()
            else:
                before = self.controls
                self.controls = pressed(before, key, tuple(self._arguments.compensators))
                self._changed = self._changed or self.controls != before

    def _restart(self) -> None:
        for compensator in self._arguments.compensators.values():
            compensator.reset()

    def _take(self, target_s: float) -> LiveFrame | None:
        queue, clock = self._arguments.queue, self._arguments.clock
        latch_s = target_s - self._latch_timer.lead_s
        if self.controls.frozen:
            queue.skip(target_s)
            clock.wait_until_s(latch_s)
            return None
        if self._pending is not None:
            clock.wait_until_s(target_s - _AHEAD * self._period_s)
        frame = queue.take(latch_s, target_s)
        if frame is None and queue.ended:
            self.ended = "source"
        return frame

    def _show_frame(self, frame: LiveFrame, target_s: float) -> None:
        clock = self._arguments.clock
        begun_s = clock.now_s()
        codes = self._codes_of(frame.codes)
        busy_s = clock.now_s() - begun_s
        deadline_s = frame.due_s
        if deadline_s is None:
            deadline_s = self._display.target_s(frame.ready_s + self._latch_timer.lead_s)
        self._follow_brightness(frame, codes)
        in_time = begun_s <= target_s - self._latch_timer.lead_s
        pending = _Pending(
            codes=codes,
            gain=self.gain,
            controls=self.controls,
            frame=frame,
            target_s=target_s,
            deadline_s=deadline_s,
            busy_s=busy_s,
            in_time=in_time,
        )
        self._start(pending, target_s)
        if not self._ahead:
            self.complete()

    def _show_again(self, frame: LiveFrame, target_s: float) -> None:
        """Show the last picture once more, with the settings of now."""
        self._start(_Pending(codes=self._codes_of(frame.codes), gain=self.gain, controls=self.controls), target_s)
        self.complete()

    def _codes_of(self, codes: Pixels) -> Pixels:
        """Projector codes of a target, as the settings want it, in memory that stays until the one after the next."""
        if self.controls.black:
            return self._black
        self._out, self._spare = self._spare, self._out
        compensator = self._compensator
        if compensator is None:
            np.copyto(self._out, codes)
            return self._out
        out = compensator.frame(codes, self._out, self.gain)
        if compensator.last is not None:
            self.statistics.note_error(compensator.last.error)
        return out

    @property
    def _compensator(self) -> Compensator | None:
        return self._arguments.compensators.get(self.controls.strategy) if self.controls.compensating else None

    def _follow_brightness(self, frame: LiveFrame, codes: Pixels) -> None:
        """Automatic gain: learn from this frame what the next one's should be."""
        if not self.controls.auto_gain:
            self._gain = GainState(self.controls.gain)
            return
        scene = thumbnail(frame.codes)
        is_cut, self._scene = is_scene_cut(self._scene, scene), scene
        if self._compensator is not None and not self.controls.black:
            interval_s = self.statistics.last_interval_s
            self._gain = next_gain(self._gain, share_at_white(codes), self.controls.gain, interval_s, is_cut=is_cut)

    def _start(self, pending: _Pending, target_s: float) -> None:
        """Let the output show a picture, once it has shown the last one."""
        self.complete()
        now_s = self._arguments.clock.now_s()
        self._output.start(pending.codes, check=self._is_watch_due(now_s))
        self._pending = pending
        self._display.expect(target_s, now_s)

    def _finish(self, codes: Pixels) -> float:
        """When the codes that were started are on screen; waits for a projector that went away."""
        arguments = self._arguments
        recovery = Recovery(arguments.clock, arguments.replug_timeout_s, self._note)
        while True:
            try:
                shown = self._output.finish()
            except DeviceLost as loss:
                lost = loss.with_traceback(
                    None
                )  # a value from here on: its traceback would hold this frame, which holds it
            else:
                self._display.note(shown.on_screen_s)
                return shown.on_screen_s
            self._wait_for_display(recovery, lost)
            self._output.start(codes, check=False)

    def _wait_for_display(self, recovery: Recovery, loss: DeviceLost) -> None:
        self.statistics.unplugged += 1
        with self._arguments.interrupting():
            recovery.bring_back(self._arguments.projector, "the projector", loss, lambda: None)
        self._display.forget()
        self.statistics.forget_interval()

    def _is_watch_due(self, now_s: float) -> bool:
        """Whether it is time to ask if the picture is still on screen: some outputs take pictures without a cable."""
        if now_s - self._watched_s < _WATCH_S:
            return False
        self._watched_s = now_s
        return True

    def _watch(self) -> None:
        """Ask now and then, where nothing new is shown."""
        if self._frame is None or self.ended or self._pending is not None:
            return
        if not self._is_watch_due(self._arguments.clock.now_s()):
            return
        try:
            check_on_screen(self._arguments.projector)
        except DeviceLost as loss:
            recovery = Recovery(self._arguments.clock, self._arguments.replug_timeout_s, self._note)
            self._wait_for_display(recovery, loss)
            self._show_again(self._frame, self._arguments.clock.now_s())

    def _note(self, kind: str, detail: str) -> None:
        self._arguments.notes.append(f"{kind}: {detail}")
