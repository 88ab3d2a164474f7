"""Photograph patterns into a step of a session, going on where an earlier run stopped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from calibration.structured_light.patterns import Pattern
from rig.capture.rig import Event, Rig
from rig.records import Record, read_record
from rig.session import Session, Step
from rig.terminal import OnStep, silent


@dataclass(frozen=True, slots=True)
class ExposureBracket(Record):
    """How each pattern of a set is photographed."""

    exposures_s: tuple[float, ...]
    repeats: int = 1

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
                    take_one(rig, session, step, pattern, name=name, exposure_s=exposure_s)
                done += 1
                on_step(f"photograph: {step.name}", done, total)


def take_one(rig: Rig, session: Session, step: Step, pattern: Pattern, *, name: str, exposure_s: float) -> None:
    """Take a frame over from an earlier run of the step that showed the same at the same exposure, else shoot it."""
    camera, projector = rig.profile.camera.name, rig.profile.projector.name
    if not step.reuse_frame(
        name, pattern=pattern.name, codes=pattern.codes, asked_s=exposure_s, camera=camera, projector=projector
    ):
        shoot_one(rig, session, step, pattern, name=name, exposure_s=exposure_s)


def shoot_one(rig: Rig, session: Session, step: Step, pattern: Pattern, *, name: str, exposure_s: float) -> None:
    """Take one frame to the disk, and what went wrong on the way to the session's log, also when the rig gave up."""
    before = len(rig.events)
    try:
        raw = rig.shoot(pattern.codes, name=pattern.name, exposure_s=exposure_s)
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


def _note_events(session: Session, step: Step, name: str, events: Sequence[Event]) -> None:
    known = frame_notes(session) if events else []
    for k, event in enumerate(events):
        note = FrameNote(step=step.name, frame=name, nth=k, event=event.kind, detail=event.detail)
        if note not in known:  # a run that was killed here has noted it already
            session.note(note)


def frame_notes(session: Session) -> list[FrameNote]:
    """Return what went wrong while frames were taken, in the order in which it happened."""
    return [read_record(FrameNote, line["note"]) for line in session.frame_log() if line["event"] == "note"]
