"""Latency by light: flashes go the way of live pictures, and the rig's camera tells when their light came."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rig.capture.rig import Rig
from rig.devices.drivers import make_devices
from rig.devices.protocols import Clock, Codes, Projector, Shown
from rig.errors import UsageError
from rig.live.plan import LivePlan
from rig.live.results import LightLatency
from rig.live.show.frame_mailbox import FrameMailbox
from rig.live.show.loop import LiveLoop, LoopArguments
from rig.live.show.priority import realtime_priority
from rig.live.sources.source import Pixels
from rig.self_check.parts.exposure import prepare_rig, with_generous_latency
from rig.self_check.parts.latency import measure_latency
from rig.stages.error_tree import one_error_tree
from rig.terminal import OnStep


class LivePath:
    """A projector whose pictures go through a live loop; it dates them from when they were handed over.

    Parameters
    ----------
    projector
        That the loop shows on.
    mailbox
        That the loop takes from.
    loop
        Stepped here, in the caller's thread.
    """

    def __init__(self, projector: Projector, mailbox: FrameMailbox, loop: LiveLoop, clock: Clock):
        self._projector = projector
        self._mailbox = mailbox
        self._loop = loop
        self._clock = clock

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), in pixels."""
        return self._projector.shape

    def open(self) -> None:
        """Open the projector."""
        self._projector.open()

    def close(self) -> None:
        """Close the projector."""
        self._projector.close()

    def show(self, codes: Codes, *, name: str) -> Shown:
        """Hand a picture over as a source does, and let the loop show it. Raises DeviceError."""
        handed_over_s = self._clock.now_s()
        there: Pixels = self._mailbox.writable()
        np.copyto(there, codes if codes.ndim == 3 else codes[..., None])
        self._mailbox.offer(None)
        shown = self._loop.statistics.frames
        while self._loop.statistics.frames == shown and not self._loop.ended:
            self._loop.step()
        return Shown(handed_over_s, name)


def measure_light_latency(rig: Rig, path: LivePath) -> LightLatency:
    """Measure the time from a picture in memory to its light, over many flashes.

    ``rig`` is closed and has a generous latency. Raises CalibrationFailed when the camera sees nothing, DeviceError.
    """
    flashing = Rig(rig.profile, rig.camera, path, rig.clock)
    with flashing:
        flashing.set_exposure(rig.profile.camera.exposure_s)
        found = measure_latency(prepare_rig(flashing))
    return LightLatency(
        p50=1000 * found.median,
        p99=1000 * float(np.quantile(found.values_s, 0.99)),
        max=1000 * found.max,
        flashes=len(found.values_s),
        unseen=1000 * found.unseen_s,
    )


def with_light_latency(plan: LivePlan, on_step: OnStep) -> LivePlan:
    """Return the plan of a show with its latency by light, where flashes are asked for; else the plan as it is.

    A simulated rig is measured in virtual time, in which computing takes none.
    Raises UsageError for a recording, CalibrationFailed when the camera sees nothing, DeviceError.
    """
    if not plan.request.flashes:
        return plan
    on_step("measure latency by light", 0, 1)
    with one_error_tree(), realtime_priority():
        found = _light_latency(plan)
    on_step("measure latency by light", 1, 1)
    return replace(plan, light_latency_ms=found)


def _light_latency(plan: LivePlan) -> LightLatency:
    profile = plan.profile
    if profile.camera.driver == "replay":
        raise UsageError(f"{profile.path}: a recording has no latency; give a profile of a real or simulated rig")
    rig = Rig(with_generous_latency(profile), *make_devices(profile))
    rate_hz = profile.projector.refresh_rate_hz
    mailbox = FrameMailbox(rig.projector.shape, 1 / rate_hz, rig.clock)
    arguments = LoopArguments(
        projector=rig.projector,
        queue=mailbox,
        compensators=plan.compensators,
        clock=rig.clock,
        refresh_rate_hz=rate_hz,
    )
    return measure_light_latency(rig, LivePath(rig.projector, mailbox, LiveLoop(arguments, plan.controls), rig.clock))
