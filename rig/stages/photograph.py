"""Photograph patterns into a step of a session, going on where an earlier run stopped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from calibration.structured_light.patterns import Pattern
from rig.capture.rig import Event, Rig
from rig.session import Session, Step
from rig.terminal import OnStep


@dataclass(frozen=True, slots=True)
class ExposureBracket:
    """How each pattern of a set is photographed."""

    exposures_s: tuple[float, ...]
    repeats: int = 1

    @property
    def frames_per_pattern(self) -> int:
        """Frames that one pattern costs."""
        return len(self.exposures_s) * self.repeats


def frame_name(pattern: str, exposure: int = 0, repeat: int = 0) -> str:
    """Name of a frame: `white.e1.r0` is white, second exposure, first repeat."""
    return f"{pattern}.e{exposure}.r{repeat}"


def photograph(
    rig: Rig,
    session: Session,
    step: Step,
    patterns: Iterable[Pattern],
    shot: ExposureBracket,
    n_patterns: int,
    on_step: OnStep,
) -> None:
    """Shoot what the step does not have yet; every frame is on disk before the next is shown.

    Every other pattern takes its exposures backwards: a camera needs several frames to take a new one over.
    """
    total = n_patterns * shot.frames_per_pattern
    done = 0
    for nth, pattern in enumerate(patterns):
        exposures = list(enumerate(shot.exposures_s))
        for exposure, exposure_s in reversed(exposures) if nth % 2 else exposures:
            for repeat in range(shot.repeats):
                name = frame_name(pattern.name, exposure, repeat)
                if not step.has_frame(name):
                    shoot_one(rig, session, step, pattern, name, exposure_s)
                done += 1
                on_step(f"photograph: {step.name}", done, total)


def shoot_one(rig: Rig, session: Session, step: Step, pattern: Pattern, name: str, exposure_s: float) -> None:
    """One frame to disk, and what went wrong on the way to the session's log, also when the rig gave up."""
    before = len(rig.events)
    try:
        raw = rig.shoot(pattern.codes, name=pattern.name, exposure_s=exposure_s)
    finally:
        _note_events(session, step, name, rig.events[before:])
    step.save_frame(name, raw, pattern=pattern.name, codes=pattern.codes)


def _note_events(session: Session, step: Step, name: str, events: Sequence[Event]) -> None:
    notes = [
        {"step": step.name, "frame": name, "nth": k, "event": e.kind, "detail": e.detail} for k, e in enumerate(events)
    ]
    known = [line["note"] for line in session.frame_log() if line["event"] == "note"] if notes else []
    for note in notes:
        if note not in known:  # a run that was killed here has noted it already
            session.note(note)
