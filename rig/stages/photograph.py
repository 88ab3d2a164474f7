"""Photograph patterns into a step of a session, going on where an earlier run stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from calibration.radiometry.flicker import PHASES, is_third
from calibration.structured_light.patterns import Pattern
from rig.capture.rig import Event, Rig
from rig.devices.protocols import RawFrame
from rig.records import Record, read_record
from rig.session import Session, Step
from rig.terminal import OnStep, silent

_MOST_TRIES = 5
"""Until a frame falls into the wanted part of a period; then any is taken."""
_MOST_PAUSE = 12
"""Camera frames: most frame rates meet every third of a period of 100 or 120 Hz within so many, and some never."""


@dataclass(frozen=True, slots=True)
class ExposureBracket(Record):
    """How each pattern of a set is photographed."""

    exposures_s: tuple[float, ...]
    repeats: int = 1
    swell_hz: float | None = None
    """Of room light that no exposure holds a whole period of: repeats are then taken a third of its period apart."""

    @classmethod
    def blind_to(cls, swell_hz: float | None, exposures_s: tuple[float, ...], repeats: int = 1) -> ExposureBracket:
        """Return a bracket of at least so many repeats, in whole sets over the period of a swell if there is one."""
        sets = repeats if swell_hz is None else PHASES * -(-repeats // PHASES)
        return cls(exposures_s, sets, swell_hz)

    @property
    def frames_per_pattern(self) -> int:
        """Frames that one pattern costs."""
        return len(self.exposures_s) * self.repeats


@dataclass(frozen=True, kw_only=True)
class FrameNote(Record):
    """What went wrong while a frame was taken, as the session's journal has it."""

    step: str
    frame: str
    nth: int
    """Number within the frame's events, from 0."""
    event: str
    """Kind of the event; see :class:`rig.capture.rig.Event`."""
    detail: str


def frame_name(pattern: str, exposure: int = 0, repeat: int = 0) -> str:
    """Return the name of a frame: `white.e1.r0` is white, second exposure, first repeat."""
    return f"{pattern}.e{exposure}.r{repeat}"


def photograph(
    rig: Rig,
    session: Session,
    step: Step,
    patterns: Iterable[Pattern],
    *,
    bracket: ExposureBracket,
    n_patterns: int,
    on_step: OnStep = silent,
) -> None:
    """Shoot what the step does not have yet; every frame is on disk before the next is shown.

    Every other pattern takes its exposures backwards: a camera needs several frames to take a new one over.

    Parameters
    ----------
    rig
        Open.
    session, step
        Where frames and notes go.
    patterns
        What is shown, in order.
    bracket
        Exposures and repeats of each pattern.
    n_patterns
        How many patterns there are, for the progress.
    on_step
        Told after each frame.
    """
    total = n_patterns * bracket.frames_per_pattern
    done = 0
    for nth, pattern in enumerate(patterns):
        exposures = list(enumerate(bracket.exposures_s))
        for exposure, exposure_s in reversed(exposures) if nth % 2 else exposures:
            for repeat in range(bracket.repeats):
                name = frame_name(pattern.name, exposure, repeat)
                if not step.has_frame(name):
                    first = step.load_frame(frame_name(pattern.name, exposure)) if repeat else None
                    wanted = InPhase.after(first, repeat, bracket.swell_hz)
                    take_one(rig, session, step, pattern, name=name, exposure_s=exposure_s, wanted=wanted)
                done += 1
                on_step(f"photograph: {step.name}", done, total)


@dataclass
class OneCount:
    """The progress of a step that photographs in several goes: one count, which knows of more when it comes to them."""

    on_step: OnStep
    before: int = 0
    """Frames of the goes before."""

    def take(self, work: Callable[[OnStep], None]) -> None:
        """Do one go; it is given what it tells its own count."""
        last = 0

        def told(label: str, done: int, total: int) -> None:
            nonlocal last
            last = done
            self.on_step(label, self.before + done, max(total, self.before + done))

        work(told)
        self.before += last


@dataclass(frozen=True, kw_only=True)
class InPhase:
    """When in the period of a swell a frame is wanted."""

    first_s: float
    """Middle of the exposure that the others follow."""
    nth: int
    swell_hz: float

    @classmethod
    def after(cls, first: RawFrame | None, nth: int, swell_hz: float | None) -> InPhase | None:
        """Return when the nth frame after a first one is wanted; None at any time."""
        if first is None or swell_hz is None:
            return None
        return cls(first_s=first.started_s + first.exposure_s / 2, nth=nth % PHASES, swell_hz=swell_hz)

    def holds(self, frame: RawFrame) -> bool:
        """Whether a frame was taken then."""
        return is_third(frame.started_s + frame.exposure_s / 2, self.first_s, self.nth, self.swell_hz)


def take_one(
    rig: Rig,
    session: Session,
    step: Step,
    pattern: Pattern,
    *,
    name: str,
    exposure_s: float,
    wanted: InPhase | None = None,
) -> None:
    """Take a frame over from an earlier run of the step that showed the same at the same exposure, else shoot it."""
    camera, projector = rig.profile.camera.name, rig.profile.projector.name
    if not step.reuse_frame(
        name, pattern=pattern.name, codes=pattern.codes, asked_s=exposure_s, camera=camera, projector=projector
    ):
        shoot_one(rig, session, step, pattern, name=name, exposure_s=exposure_s, wanted=wanted)


def shoot_one(
    rig: Rig,
    session: Session,
    step: Step,
    pattern: Pattern,
    *,
    name: str,
    exposure_s: float,
    wanted: InPhase | None = None,
) -> None:
    """Take one frame to the disk, and what went wrong on the way to the session's log, also when the rig gave up."""
    before = len(rig.events)
    try:
        raw = _shot_in_phase(rig, pattern, exposure_s, wanted)
    finally:
        _note_events(session, step, name, rig.events[before:])
    step.save_frame(
        name,
        raw,
        pattern=pattern.name,
        codes=pattern.codes,
        camera=rig.profile.camera.name,
        projector=rig.profile.projector.name,
        asked_s=exposure_s,
    )


def _shot_in_phase(rig: Rig, pattern: Pattern, exposure_s: float, wanted: InPhase | None) -> RawFrame:
    """Shoot, and again after pauses of whole camera frames until a frame falls where it is wanted."""
    asked_s = rig.clock.now_s()
    raw = rig.shoot(pattern.codes, name=pattern.name, exposure_s=exposure_s)
    # a recording has its frames in the order in which they were taken, at times of its own
    if wanted is None or rig.profile.camera.driver == "replay":
        return raw
    frame_s = 1 / rig.profile.camera.frame_rate_hz
    for _ in range(_MOST_TRIES):
        if wanted.holds(raw):
            break
        soonest = replace(raw, started_s=rig.clock.now_s() + raw.started_s - asked_s)
        ahead = (replace(soonest, started_s=soonest.started_s + n * frame_s) for n in range(_MOST_PAUSE))
        pause = next((n for n, one in enumerate(ahead) if wanted.holds(one)), 1)
        asked_s = rig.clock.now_s() + pause * frame_s
        rig.clock.wait_until_s(asked_s)
        raw = rig.shoot(pattern.codes, name=pattern.name, exposure_s=exposure_s)
    return raw


def _note_events(session: Session, step: Step, name: str, events: Sequence[Event]) -> None:
    known = frame_notes(session) if events else []
    for k, event in enumerate(events):
        note = FrameNote(step=step.name, frame=name, nth=k, event=event.kind, detail=event.detail)
        if note not in known:  # a run that was killed here has noted it already
            session.note(note)


def frame_notes(session: Session) -> list[FrameNote]:
    """Return what went wrong while frames were taken, in the order in which it happened."""
    return [read_record(FrameNote, line["note"]) for line in session.frame_log() if line["event"] == "note"]
