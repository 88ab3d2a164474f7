"""The way of live pictures, put together: sources, reader, mailbox, compensators, output, projector; one direction."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from rig.capture.recovery import close_quietly
from rig.devices.clock import SystemClock
from rig.devices.drivers import make_devices
from rig.devices.protocols import Camera, Clock, Projector
from rig.devices.simulated.display import ClockedDisplay
from rig.errors import DeviceError
from rig.live.plan import LivePlan, LiveRequest
from rig.live.record import Recorder
from rig.live.show.controls import RemoteControl
from rig.live.show.frame_mailbox import FrameMailbox
from rig.live.show.loop import LiveLoop, LoopArguments, ShownFrame, nothing_more
from rig.live.show.output import ThreadedOutput
from rig.live.sources.choose import SourceSettings, make_source
from rig.live.sources.reader import Reader
from rig.live.sources.source import Source
from rig.live.watcher import ShowWatcher
from rig.profile.schema import Profile
from rig.terminal.keys import Keyboard
from rig.terminal.signals import EndSignals


@dataclass(frozen=True, slots=True, eq=False)
class ShowDevices:
    """The projector that shows, and a camera that may photograph it; closed."""

    projector: Projector
    camera: Camera | None
    clock: Clock


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LivePipeline:
    """What a picture passes, in this order."""

    reader: Reader
    """Reads the sources, and scales their pictures."""
    mailbox: FrameMailbox
    """Holds the newest picture."""
    loop: LiveLoop
    """Takes it, compensates it, and lets the projector show it."""
    recorder: Recorder | None
    """Keeps some of what was shown."""
    clock: Clock
    """Of all of them."""
    notes: list[str]
    """What went wrong with devices meanwhile."""


@contextmanager
def open_pipeline(
    plan: LivePlan, signals: EndSignals, remote: RemoteControl, watcher: ShowWatcher | None = None
) -> Iterator[LivePipeline]:
    """Make a show's devices, open them, and tie everything together; the projector is black afterwards.

    A signal may end the opening. Raises UsageError for a bad source, DeviceError, SessionError for a bad recording.
    """
    request, profile = plan.request, plan.profile
    devices = _devices(profile, photographs=request.record is not None)
    sources = _sources(request, profile, devices.clock)
    with ExitStack() as stack:
        notes: list[str] = []
        with signals.interrupting():
            stack.callback(close_quietly, devices.projector)  # black, whatever happens
            devices.projector.open()
            camera = _open_camera(devices.camera, profile, stack, notes)
        recorder = _recorder(request, profile, devices.clock, camera)
        keyboard = stack.enter_context(Keyboard())
        shape, rate_hz = profile.projector.shape, profile.projector.refresh_rate_hz
        mailbox = FrameMailbox(shape, 1 / rate_hz, devices.clock)
        reader = Reader(
            sources,
            mailbox,
            shape=shape,
            refresh_rate_hz=rate_hz,
            clock=devices.clock,
            endless=request.endless,
            keeps_going=request.keeps_going,
        )
        stack.callback(reader.close)
        output = ThreadedOutput(devices.projector)
        stack.callback(output.close)
        arguments = LoopArguments(
            projector=devices.projector,
            queue=mailbox,
            compensators=plan.compensators,
            output=output,
            clock=devices.clock,
            refresh_rate_hz=rate_hz,
            replug_timeout_s=profile.timing.replug_timeout_s,
            keys=keyboard.pressed,
            remote=remote,
            next_source=reader.next_source,
            on_shown=_watchers(recorder, watcher),
            interrupting=signals.interrupting,
            notes=notes,
        )
        yield LivePipeline(
            reader=reader,
            mailbox=mailbox,
            loop=LiveLoop(arguments, plan.controls),
            recorder=recorder,
            clock=devices.clock,
            notes=notes,
        )


def _watchers(recorder: Recorder | None, watcher: ShowWatcher | None) -> Callable[[ShownFrame], None]:
    """Who is told of each picture that was shown."""
    if recorder is None:
        return nothing_more if watcher is None else watcher.shown
    if watcher is None:
        return recorder.offer

    def told(frame: ShownFrame) -> None:
        recorder.offer(frame)
        watcher.shown(frame)

    return told


def _devices(profile: Profile, *, photographs: bool) -> ShowDevices:
    """The profile's; a simulated one without photographs is only a display that keeps time."""
    settings = profile.projector
    if settings.driver == "simulated" and not photographs:
        clock = SystemClock()
        return ShowDevices(ClockedDisplay(settings.shape, settings.refresh_rate_hz, clock), None, clock)
    made = make_devices(profile, real_time=True)
    return ShowDevices(made.projector, made.camera if photographs else None, made.clock)


def _sources(request: LiveRequest, profile: Profile, clock: Clock) -> list[Source]:
    only = len(request.sources) == 1
    settings = SourceSettings(profile.projector.shape, request.size, request.rate_hz, is_only=only)
    return [make_source(word, settings, clock) for word in request.sources]


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


def _recorder(request: LiveRequest, profile: Profile, clock: Clock, camera: Camera | None) -> Recorder | None:
    if request.record is None:
        return None
    recorder = Recorder(request.record, profile.projector.shape, clock, camera)
    recorder.begin(profile=profile.name, session=str(request.folder or ""), sources=request.sources)
    return recorder
