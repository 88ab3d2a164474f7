"""A live show from beginning to end: model, devices, sources, loop, and black at the end of it."""

from __future__ import annotations

import gc
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rig.capture.devices import make_devices
from rig.capture.recovery import close_quietly
from rig.devices.clock import SystemClock
from rig.devices.protocols import Camera, Clock, Projector
from rig.devices.simulated.display import ClockedDisplay
from rig.errors import DeviceError, UsageError
from rig.live.latency import light_latency
from rig.live.model import LiveModel, guessed_model, session_model
from rig.live.record import Recorder
from rig.live.show.compensator import Compensator
from rig.live.show.controls import Controls
from rig.live.show.frame_mailbox import FrameMailbox
from rig.live.show.frame_statistics import resident_mb
from rig.live.show.keys import Keyboard
from rig.live.show.loop import LiveLoop, LoopArguments, ShownFrame
from rig.live.show.output import ThreadedOutput
from rig.live.show.priority import realtime_priority
from rig.live.show.signals import EndSignals, Interrupted
from rig.live.sources.choose import SourceSettings, make_source
from rig.live.sources.reader import Reader
from rig.profile.schema import Profile, load_profile
from rig.session import Session
from rig.stages.error_tree import one_error_tree
from rig.terminal import OnStep
from sim.frame.compensator import FrameCompensator

STRATEGIES = ("exact", "bounded")
_STATUS_S = 0.5
_WARM_UP_S = 5.0
"""After that, memory should not grow any more."""
_SWITCH_INTERVAL_S = 0.0005
"""The loop's thread should not wait 5 ms, Python's usual, when the reader is at work."""

OnStatus = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What the user asked for."""

    folder: Path | None
    profile: str | None
    sources: tuple[str, ...]
    strategy: str = "bounded"
    seconds: float | None = None
    size: tuple[int, int] | None = None
    rate_hz: float | None = None
    endless: bool = False
    gain: float = 1.0
    auto_gain: bool = False
    is_linear: bool = False
    record: Path | None = None
    flashes: bool = False
    """Measure the latency by light before the show."""
    threads: int = 2


@dataclass(slots=True)
class _Devices:
    """The projector that shows, and a camera that may photograph it."""

    projector: Projector
    camera: Camera | None
    clock: Clock
    name: str


@dataclass(slots=True)
class _Show:
    """A show that runs."""

    loop: LiveLoop
    slot: FrameMailbox
    reader: Reader
    recorder: Recorder | None
    signals: EndSignals
    clock: Clock
    seconds: float | None
    notes: list[str]
    on_status: OnStatus = lambda line: None
    started_s: float = 0.0
    ended_by: str = ""
    resident_mb: float | None = None
    """After the warm-up."""


def run_live(request: Request, on_step: OnStep, on_status: OnStatus) -> dict[str, Any]:
    """Show sources until one of: time over, sources over, key q, a signal. The projector is black afterwards.

    Raises
    ------
    UsageError, ProfileError, SessionError
        It cannot begin.
    DeviceError
        The projector does not open, or stayed away for longer than `timing.replug_timeout_s`.
    """
    check_request(request)
    with one_error_tree():
        profile, model = _profile_and_model(request, on_step)
        with realtime_priority() as is_urgent:
            return {**_shown(request, profile, model, on_step, on_status), "real_time": is_urgent}


def _shown(
    request: Request, profile: Profile, model: LiveModel | None, on_step: OnStep, on_status: OnStatus
) -> dict[str, Any]:
    """The show."""
    compensators = compensators_of(model, request.threads)
    _warm_up(compensators, profile.projector.shape)
    controls = _controls(request, compensators)
    light_latency_ms = _light_latency_ms(request, profile, compensators, controls, on_step)
    with ExitStack() as stack:
        signals = stack.enter_context(EndSignals())
        show = _prepare(request, profile, compensators, controls, signals, stack)
        show.on_status = on_status
        _run(show)
    return {**_result(request, show, model), "light_latency_ms": light_latency_ms}


def check_request(request: Request) -> None:
    """Raise UsageError for what makes no sense before anything is opened."""
    if request.strategy not in (*STRATEGIES, "none"):
        raise UsageError(f"live strategy {request.strategy!r}; there are {', '.join(STRATEGIES)} and none")
    if request.seconds is not None and request.seconds <= 0:
        raise UsageError(f"--seconds {request.seconds:g}; give more than 0")
    if not 0 < request.gain <= 4:
        raise UsageError(f"--gain {request.gain:g}; it lies between 0 and 4")
    if request.folder is None and request.profile is None:
        raise UsageError("rig live needs a session, or a profile with -p: rig live -p sim-room --source pattern")


def _profile_and_model(request: Request, on_step: OnStep) -> tuple[Profile, LiveModel | None]:
    on_step("prepare frames", 0, 1)
    profile = load_profile(request.profile) if request.profile is not None else None
    if request.folder is not None:
        with Session.open(request.folder) as session:
            profile = profile or session.profile
            model: LiveModel | None = session_model(session, is_linear=request.is_linear)
    elif profile is not None and profile.projector.driver == "simulated":
        model = guessed_model(profile, is_linear=request.is_linear)
    else:
        model = None
    if profile is None:
        raise UsageError("rig live needs a session, or a profile with -p")
    _check_fit(profile, model)
    on_step("prepare frames", 1, 1)
    return profile, model


def _check_fit(profile: Profile, model: LiveModel | None) -> None:
    if profile.projector.driver == "replay":
        raise UsageError(f"{profile.path}: a recording shows nothing live; give a real or simulated rig's profile")
    if model is not None and model.frames.shape != profile.projector.shape:
        raise UsageError(
            f"{profile.path}: the projector has {profile.projector.shape} px, the session's {model.frames.shape}; "
            "leave the profile out"
        )


def compensators_of(model: LiveModel | None, threads: int) -> Mapping[str, Compensator]:
    """One for each strategy; none without a model."""
    if model is None:
        return {}
    return {
        "exact": FrameCompensator(model.frames, "exact", threads),
        "bounded": FrameCompensator(model.frames, "bounded", threads),
    }


def _warm_up(compensators: Mapping[str, Compensator], shape: tuple[int, int]) -> None:
    """A first frame takes longer than the others."""
    codes = np.zeros((*shape, 3), np.uint8)
    for compensator in compensators.values():
        compensator.frame(codes, np.empty_like(codes))
        compensator.reset()


def _controls(request: Request, compensators: Mapping[str, Compensator]) -> Controls:
    return Controls(
        strategy=request.strategy if request.strategy in STRATEGIES else STRATEGIES[0],
        compensating=bool(compensators) and request.strategy != "none",
        gain=request.gain,
        auto_gain=request.auto_gain,
    )


def _light_latency_ms(
    request: Request,
    profile: Profile,
    compensators: Mapping[str, Compensator],
    controls: Controls,
    on_step: OnStep,
) -> dict[str, Any] | None:
    if not request.flashes:
        return None
    on_step("measure latency by light", 0, 1)
    found = light_latency(profile, compensators, controls)
    on_step("measure latency by light", 1, 1)
    return found


def _devices(profile: Profile, *, photographs: bool) -> _Devices:
    """The profile's, closed; a simulated one without photographs is only a display that keeps time."""
    settings = profile.projector
    if settings.driver == "simulated" and not photographs:
        clock = SystemClock()
        display = ClockedDisplay(settings.shape, settings.refresh_rate_hz, clock)
        return _Devices(display, None, clock, "simulated display")
    made = make_devices(profile, real_time=True)
    name = settings.output or f"{settings.driver} projector"
    return _Devices(made.projector, made.camera if photographs else None, made.clock, name)


def _prepare(
    request: Request,
    profile: Profile,
    compensators: Mapping[str, Compensator],
    controls: Controls,
    signals: EndSignals,
    stack: ExitStack,
) -> _Show:
    notes: list[str] = []
    devices = _devices(profile, photographs=request.record is not None)
    shape, rate_hz, clock = profile.projector.shape, profile.projector.refresh_rate_hz, devices.clock
    settings = SourceSettings(shape, request.size, request.rate_hz)
    sources = [make_source(word, settings, clock) for word in request.sources]
    slot = FrameMailbox(shape, 1 / rate_hz, clock)
    reader = Reader(sources, slot, shape, rate_hz, clock, endless=request.endless)
    with signals.interrupting():
        stack.callback(close_quietly, devices.projector)  # black, whatever happens
        devices.projector.open()
        camera = _open_camera(devices.camera, profile, stack, notes)
    recorder = _recorder(request, profile, clock, camera)
    keyboard = stack.enter_context(Keyboard())
    stack.callback(reader.close)
    output = ThreadedOutput(devices.projector)
    stack.callback(output.close)
    surroundings = LoopArguments(
        projector=devices.projector,
        feed=slot,
        compensators=compensators,
        clock=clock,
        refresh_rate_hz=rate_hz,
        replug_timeout_s=profile.timing.replug_timeout_s,
        keys=keyboard.pressed,
        next_source=reader.next_source,
        on_shown=_watcher(recorder),
        interrupting=signals.interrupting,
        notes=notes,
        output=output,
    )
    loop = LiveLoop(surroundings, controls)
    return _Show(loop, slot, reader, recorder, signals, clock, request.seconds, notes)


def _open_camera(camera: Camera | None, profile: Profile, stack: ExitStack, notes: list[str]) -> Camera | None:
    """A camera for photographs; without one the show goes on."""
    if camera is None:
        return None
    stack.callback(close_quietly, camera)
    try:
        camera.open()
        camera.set_exposure(profile.camera.exposure_s)
    except DeviceError as error:
        notes.append(f"no photographs: {error}")
        return None
    return camera


def _recorder(request: Request, profile: Profile, clock: Clock, camera: Camera | None) -> Recorder | None:
    if request.record is None:
        return None
    header = {"profile": profile.name, "session": str(request.folder or ""), "sources": list(request.sources)}
    return Recorder(request.record, profile.projector.shape, header, clock, camera)


def _watcher(recorder: Recorder | None) -> Callable[[ShownFrame], None]:
    return (lambda frame: None) if recorder is None else recorder.offer


def _run(show: _Show) -> None:
    """Step until the end; whatever ends it, what was recorded is closed."""
    show.started_s = show.clock.now_s()
    show.reader.start()
    try:
        with _undisturbed():
            _steps(show)
        show.loop.complete()
    except Interrupted:
        show.ended_by = "signal"
    finally:
        if show.recorder is not None:
            show.recorder.close({"frames": show.loop.tally.frames, "ended_by": show.ended_by or "error"})


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


def _steps(show: _Show) -> None:
    next_status_s = show.started_s
    while not show.ended_by:
        show.loop.step()
        now_s = show.clock.now_s()
        show.ended_by = _end_of(show, now_s)
        if now_s >= next_status_s:
            show.on_status(status_line(show))
            next_status_s = now_s + _STATUS_S
        if show.resident_mb is None and now_s - show.started_s > _WARM_UP_S:
            show.resident_mb = resident_mb()


def _end_of(show: _Show, now_s: float) -> str:
    if show.signals.received is not None:
        return "signal"
    if show.seconds is not None and now_s - show.started_s >= show.seconds:
        return "time"
    return show.loop.ended


def status_line(show: _Show) -> str:
    """One line for a person."""
    loop, tally = show.loop, show.loop.tally
    controls = loop.controls
    what = controls.strategy if controls.compensating else "as it is"
    flags = [
        word
        for word, on in (("BLACK", controls.black), ("FROZEN", controls.frozen), ("auto", controls.auto_gain))
        if on
    ]
    return (
        f"{show.reader.name} · {what} · {1 / tally.last_interval_s:.0f} fps · {tally.frames} frames, "
        f"{tally.late} late, {show.slot.dropped} dropped · gain {loop.gain:.2f} {' '.join(flags)}"
    )


def _result(request: Request, show: _Show, model: LiveModel | None) -> dict[str, Any]:
    controls = show.loop.controls
    notes = [*(model.notes if model else ("no session: pictures are shown as they are",)), *show.notes]
    notes += show.reader.notes
    recorded = None
    if show.recorder is not None:
        notes += show.recorder.notes
        recorded = {"frames": show.recorder.frames, "photographs": show.recorder.photographs}
    return {
        **show.loop.tally.result(show.slot.dropped),
        "strategy": controls.strategy if controls.compensating else "none",
        "gain": show.loop.gain,
        "memory_growth_mb": None if show.resident_mb is None else resident_mb() - show.resident_mb,
        "seconds": show.clock.now_s() - show.started_s,
        "sources": list(request.sources),
        "model": model.origin if model else "none",
        "ended_by": show.ended_by,
        "signal": None if show.signals.received is None else signal.Signals(show.signals.received).name,
        "recorded": recorded,
        "notes": notes,
    }
