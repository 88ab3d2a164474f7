"""Photographs of pictures that a loop was closed on, as evidence of the light for other pictures.

Steps `told-LOOP-PICTURE` hold what each picture's photographs say, step `evidence` all of them that are used now. Both
are written and read as step `transport` writes its photographs, and with them they are what a model has learned from.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.light.transport.posterior import Photographs
from rig.records import Record
from rig.session import Session, Step
from rig.stages.transport.records import TransportRecord, read_told, read_uneven
from rig.terminal.line import counted

FloatArray = NDArray[np.float64]

EVIDENCE = "evidence"
"""Name of the step, and of the record in it and in each picture's step."""
_TOLD = "told-"
"""How the names of the pictures' steps begin."""
_OF_HASH = 12
"""Digits of a picture's hash that tell it from others."""


@dataclass(frozen=True, kw_only=True)
class EarlierPicture(Record):
    """A picture on which a loop was closed; errors in grey levels of 255."""

    picture: str
    """Name of the target."""
    target_sha256: str
    photographs: int
    """The loop's captures. They are nearly the same picture: their mean counts as one photograph of their mean."""
    brings: float = 0.0
    """Part of the model's error on usual pictures that was expected to go with it ..."""
    noise: float = 0.0
    """... and the noise of a photograph at a place of the picture, below which it does not count."""
    refused: str = ""
    """Why it does not count; empty: it does."""


@dataclass(frozen=True, kw_only=True)
class EvidenceRecord(Record):
    """What photographs of loops tell, beside their images; errors in grey levels of 255."""

    rests_on: Mapping[str, str]
    """Hashes of the steps that they were read by: of another model they say nothing."""
    pictures: tuple[EarlierPicture, ...] = ()
    """One in a picture's own step; in step `evidence` those that are used."""
    rms_before: float = 0.0
    """Of all that are used: what is expected of the model's error on usual pictures without them ..."""
    rms_left: float = 0.0
    """... and with them, as they show of each other."""
    refused: str = ""
    """Why none is used though there are some."""

    @property
    def photographs(self) -> int:
        """How many there are."""
        return sum(one.photographs for one in self.pictures)

    @property
    def counts(self) -> bool:
        """Tell whether a model is to learn from them."""
        return not self.refused and any(not one.refused for one in self.pictures)


def told_name(loop: str, target_sha256: str) -> str:
    """Return the name of the step of a loop's step and a picture."""
    return f"{_TOLD}{loop}-{target_sha256[:_OF_HASH]}"


def steps_below(session: Session) -> tuple[str, ...]:
    """Return the steps that a session's model comes from but for photographs of earlier pictures."""
    return ("model", "transport") if session.profile.transport.photographs else ("model",)


def rests_on(session: Session) -> dict[str, str]:
    """Return hashes of what photographs are read by. Raises SessionError where a step is not finished."""
    return {name: session.finished(name).outputs_sha256 for name in ("response", *steps_below(session))}


def told_records(session: Session) -> dict[str, EvidenceRecord]:
    """Return what the steps of all pictures say, of whatever model, in the order in which they were begun last."""
    began = dict.fromkeys(event["step"] for event in reversed(session.events()) if event["event"] == "begin")
    names = [name for name in reversed(began) if name.startswith(_TOLD) and session.is_finished(name)]
    return {name: session.finished(name).load_record(EVIDENCE, EvidenceRecord) for name in names}


def gathered_evidence(session: Session) -> EvidenceRecord | None:
    """Return what step `evidence` says of the present model, used or not; None where it has no picture."""
    if not session.is_finished(EVIDENCE):
        return None
    record = session.finished(EVIDENCE).load_record(EVIDENCE, EvidenceRecord)
    return record if record.pictures and record.rests_on == rests_on(session) else None


def evidence_words(record: EvidenceRecord) -> str:
    """Return what photographs of earlier pictures brought, in words."""
    what = f"{counted(record.photographs, 'photograph')} of {counted(len(record.pictures), 'earlier picture')}"
    if record.refused:
        return f"nothing is learned from {what}: {record.refused}"
    return f"learned from {what}: predicted error {record.rms_before:.2f} -> {record.rms_left:.2f} grey levels"


def model_steps(session: Session) -> tuple[str, ...]:
    """Return the steps that a session's model comes from."""
    record = gathered_evidence(session)
    return (*steps_below(session), *((EVIDENCE,) if record is not None and record.counts else ()))


def told_of_light(
    session: Session, n_bands: int, steps: tuple[str, ...]
) -> tuple[list[Photographs], FloatArray] | None:
    """Return in each band what the photographs of some steps say, and (H, W, B) what they left within places.

    That is the largest of what any step's left. None where they took no photograph.
    """
    found = [session.finished(name) for name in steps]
    found = [step for step in found if _has_photographs(step)]
    if not found:
        return None
    each = [read_told(step, n_bands) for step in found]
    told = each[0]
    for more in each[1:]:
        told = [band.and_(other) for band, other in zip(told, more, strict=True)]
    return told, np.maximum.reduce([read_uneven(step) for step in found])


def _has_photographs(step: Step) -> bool:
    if step.name == "transport":
        return bool(step.load_record("transport", TransportRecord).photographs)
    return step.load_record(EVIDENCE, EvidenceRecord).counts
