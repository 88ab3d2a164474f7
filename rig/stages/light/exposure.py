"""The reference exposure: white just below saturation, in whole periods of the room light. Step `exposure`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.exposure import (
    ExposureAim,
    brightest_share,
    late_share,
    next_exposure,
    refuse_darkness,
    refuse_lateness,
)
from calibration.radiometry.flicker import MAINS_LIGHT_HZ, PHASES, room_light_hz, swell_of_means, whole_periods
from calibration.structured_light.patterns import flat
from rig.capture.rig import Rig
from rig.devices.protocols import RawFrame
from rig.errors import NotRecorded
from rig.profile.schema import Profile
from rig.records import JsonObject, Record, json_of
from rig.session import Session, Step
from rig.stages.photograph import ExposureBracket, frame_name, photograph, take_one
from rig.terminal import OnStep

FloatArray = NDArray[np.float64]

_AIM = ExposureAim(share=0.85, accepted=(0.9 * 0.85, 1.06 * 0.85))
"""Of the brightest permille of projector white, which must not clip."""
_MAX_TRIES = 10
_DARK_FRAMES = 8
"""Frames of black that are asked for room light that swells: three phases of 100 Hz at 30 frames a second, twice."""
_PAUSES = 3
"""Of 0, 1 and 2 frames between them."""
_USUAL_FRAMES = 2 + _DARK_FRAMES
"""Frames of the search that a plan counts with: two of white, and the black ones."""


@dataclass(frozen=True, kw_only=True)
class CameraExposure(Record):
    """The reference exposure of one camera."""

    exposure_s: float
    brightest_share_of_full_scale: float
    """Of the brightest permille of projector white, when the exposure was looked for."""
    room_light_hz: float | None = None
    """Room light that swells so often was seen; if whole periods of it fit, the exposure holds such."""
    swell_percent: float = 0.0
    """Of projector white's mean number above black: by how much frames of black differ from each other, where no whole
    period of that room light fits into the exposure; else 0."""
    swell_left_percent: float | None = None
    """Of the same, by how much means of three frames differ, each a third of a period after the one before. None where
    nothing swells, or whole periods fit, and in sessions of older versions."""
    late_percent: float | None = None
    """Of white's light: what the first frame of black after white still has, and those after it have not. None where
    room light swells, which changes frames, too, and in sessions of older versions."""

    @property
    def averaged_hz(self) -> float | None:
        """Of room light over whose period photographs are averaged; None where that is not needed, or does not help."""
        left = self.swell_left_percent
        return self.room_light_hz if left is not None and left < self.swell_percent else None


@dataclass(frozen=True, kw_only=True)
class ExposureRecord(Record):
    """What step `exposure` found."""

    cameras: Mapping[str, CameraExposure]


def exposure_settings(session: Session) -> JsonObject:
    """Return what step `exposure` depends on."""
    return {"aim": _AIM.share, "start_s": session.profile.camera.exposure_s, "blind_to": json_of(MAINS_LIGHT_HZ)}


def exposure_frames(_: Profile) -> int:
    """Return about how many frames step `exposure` takes."""
    return _USUAL_FRAMES


def find_exposure(rig: Rig, session: Session, step: Step, on_step: OnStep) -> None:
    """Step `exposure`: projector white just below saturation."""
    white = flat(rig.projector.shape, 255, "white")
    exposure_s = rig.profile.camera.exposure_s
    full_scale = rig.camera.full_scale_dn
    earlier: tuple[float, float] | None = None
    for attempt in range(_MAX_TRIES):
        on_step("photograph: exposure", attempt, _MAX_TRIES)
        name = frame_name("white", attempt)
        if not step.has_frame(name):
            take_one(rig, session, step, white, name=name, exposure_s=exposure_s)
        level = brightest_share(step.load_frame(name).pixels, full_scale)
        chosen_s = next_exposure(exposure_s, level, _AIM, rig.profile.camera.exposure_range_s, earlier=earlier)
        if chosen_s is None:
            break
        earlier, exposure_s = (exposure_s, level), chosen_s
    on_step("photograph: exposure", _MAX_TRIES, _MAX_TRIES)
    dark, bright = _dark_frames(rig, session, step, exposure_s), step.load_frame(frame_name("white", attempt))
    refuse_darkness(bright.pixels, dark[-1].pixels, full_scale_dn=full_scale, exposure_s=exposure_s)
    late = late_share([frame.pixels for frame in dark], bright.pixels)
    refuse_lateness(late, "black", "white")
    light_hz = room_light_hz([frame.pixels for frame in dark], _middles_s(dark), full_scale)
    blind_s = None if light_hz is None else whole_periods(exposure_s, light_hz, rig.profile.camera.exposure_range_s)
    swell, left = 0.0, None
    if light_hz is not None and blind_s is None:
        swell = _percent_of_white(np.ptp(_means(dark)), bright, dark)
        thirds = _dark_thirds(rig, session, step, exposure_s=exposure_s, light_hz=light_hz)
        left = None if thirds is None else _percent_of_white(swell_of_means(_means(thirds)), bright, dark)
    found = CameraExposure(
        exposure_s=exposure_s if blind_s is None else blind_s,
        brightest_share_of_full_scale=level,
        room_light_hz=light_hz,
        swell_percent=swell,
        swell_left_percent=left,
        late_percent=None if light_hz is not None else max(100 * late, 0.0),
    )
    step.save_record("exposure", ExposureRecord(cameras={rig.profile.camera.name: found}))


def _dark_frames(rig: Rig, session: Session, step: Step, exposure_s: float) -> list[RawFrame]:
    """Frames of projector black, with pauses: one every tenth of a second would see each swell at the same phase."""
    black = flat(rig.projector.shape, 0, "black")
    names = [frame_name("black", 0, repeat) for repeat in range(_DARK_FRAMES)]
    for repeat, name in enumerate(names):
        if not step.has_frame(name):
            pause_s = repeat % _PAUSES / rig.profile.camera.frame_rate_hz
            rig.clock.wait_until_s(rig.clock.now_s() + pause_s)
            take_one(rig, session, step, black, name=name, exposure_s=exposure_s)
    return [step.load_frame(name) for name in names]


def _dark_thirds(
    rig: Rig, session: Session, step: Step, *, exposure_s: float, light_hz: float
) -> list[RawFrame] | None:
    """Frames of projector black, each a third of the swell's period after the one before, twice over.

    None of a recording of before these were taken.
    """
    bracket = ExposureBracket((exposure_s,), 2 * PHASES, swell_hz=light_hz)
    black = flat(rig.projector.shape, 0, "black-thirds")
    try:
        photograph(rig, session, step, [black], bracket=bracket, n_patterns=1)
    except NotRecorded:
        return None
    return [step.load_frame(frame_name(black.name, 0, repeat)) for repeat in range(bracket.repeats)]


def _means(frames: Sequence[RawFrame]) -> FloatArray:
    return np.array([float(frame.pixels.mean(dtype=np.float64)) for frame in frames])


def _percent_of_white(swell: float, bright: RawFrame, dark: Sequence[RawFrame]) -> float:
    """A difference of frames' mean numbers, of what white adds to the mean of those of black."""
    return float(100 * swell / max(_means([bright])[0] - _means(dark).mean(), 1e-9))


def load_exposure(session: Session) -> CameraExposure:
    """Return what the finished step `exposure` found of the only camera."""
    record = session.finished("exposure").load_record("exposure", ExposureRecord)
    return record.cameras[session.profile.camera.name]


def _middles_s(frames: Sequence[RawFrame]) -> FloatArray:
    return np.array([frame.started_s + frame.exposure_s / 2 for frame in frames])


def reference_exposure_s(session: Session) -> float:
    """Return the session's reference exposure."""
    return load_exposure(session).exposure_s
