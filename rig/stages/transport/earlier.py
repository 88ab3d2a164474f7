"""What photographs of closed loops tell of the light: read beside each loop, gathered for the pictures after it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from calibration.light.transport.posterior import Photographs, posterior
from calibration.structured_light.patterns import Pattern
from rig.files.channels import layers
from rig.session import Session, Step
from rig.stages.linear_light import merge_exposures
from rig.stages.model import load_model, load_prior_model, transport_priors
from rig.stages.prediction import predict
from rig.stages.target import Target
from rig.stages.transport.evidence import (
    EVIDENCE,
    EarlierPhotograph,
    EvidenceRecord,
    evidence_in_use,
    rests_on,
    steps_below,
    told_name,
    told_of_light,
    told_records,
)
from rig.stages.transport.held_out import ShownPictures, learned_bands
from rig.stages.transport.learn import PictureSearch, photographs_of, usual_at_all_places
from rig.stages.transport.learned import learned_band
from rig.stages.transport.records import save_photographs
from rig.terminal import OnStep, silent
from rig.terminal.line import counted

FloatArray = NDArray[np.float64]

_LEAST_WITHIN = 0.85
"""Of a loop's first photograph within three standard deviations of the prediction: with less, the rig is not as it was
measured."""


def keep_evidence(session: Session, shown: ShownPictures, target: Target) -> None:
    """Step `told-LOOP-PICTURE`: what a loop's photographs tell of the light beyond what is known, for other pictures.

    As in step `transport`, one counts that is expected to take more off the model's error than its noise.

    Parameters
    ----------
    session
        Open to write, its model finished.
    shown
        The loop's pictures, in order.
    target
        On which it was closed.
    """
    bracket = shown.bracket
    settings = {
        "pictures": [sha256(pattern.codes.tobytes()).hexdigest() for pattern in shown.patterns],
        "exposures_s": bracket.exposures_s,
        "repeats": bracket.repeats,
    }
    step = session.step(told_name(shown.step.name, target.sha256), settings=settings, needs=tuple(rests_on(session)))
    if step.done:
        return
    refused = _contradiction(session, shown)
    rows = () if refused else _told(session, step, shown, target)
    step.save_record(EVIDENCE, EvidenceRecord(rests_on=rests_on(session), photographs=rows, refused=refused))
    step.finish()


def _told(session: Session, step: Step, shown: ShownPictures, target: Target) -> tuple[EarlierPhotograph, ...]:
    """Choose the photographs that tell something, and keep what they say."""
    model, bands = load_prior_model(session), transport_priors(session)
    middle, to_levels = len(bands) // 2, 255 / model.level
    search = PictureSearch.in_band(
        bands[middle], model.white_variance[..., middle], model.scene_model.projector.lens.shape
    )
    own = [Photographs.none(band.prior) for band in bands]
    before = _known(session, _current(session)) or own
    rows: list[EarlierPhotograph] = []
    kept: list[Pattern] = []
    for pattern in shown.patterns:
        taken = photographs_of(model, shown.radiometric, bands, step=shown.step, pattern=pattern, bracket=shown.bracket)
        found = search.worth_of(before[middle].and_(own[middle]), taken[middle])
        if found.brings >= search.noise_rms:
            own = _joined(own, taken)
            kept.append(pattern)
            brings = found.brings * to_levels
            rows.append(
                EarlierPhotograph(name=pattern.name, picture=target.name, target_sha256=target.sha256, brings=brings)
            )
    if rows:
        used = replace(shown, patterns=tuple(kept))
        learned = learned_bands(model, bands, _joined(before, own), used, on_step=silent)
        _save(step, own, np.stack([band.uneven for band in learned], axis=-1))
    return tuple(rows)


def _contradiction(session: Session, shown: ShownPictures) -> str:
    """Why a loop's photographs are not of the room as it was measured; empty if they are."""
    model, first = load_model(session), shown.patterns[0]
    measured = merge_exposures(shown.step, first.name, shown.bracket, shown.radiometric)
    predicted = predict(model, shown.radiometric, first.codes)
    usable = model.lit[..., None] & ~measured.saturated
    sigma = np.sqrt(measured.variance + predicted.sigma**2)
    within = float((np.abs(measured.value - predicted.light) <= 3 * sigma)[usable].mean())
    if within >= _LEAST_WITHIN:
        return ""
    return (
        f"{100 * within:.0f} % of the first photograph is within three standard deviations of the prediction, "
        f"{100 * _LEAST_WITHIN:.0f} % are asked for"
    )


def gather_evidence(session: Session, target: Target, on_step: OnStep = silent) -> None:
    """Step `evidence`: what photographs of other pictures tell of the present model; a session without any has none.

    The picture's own do not count: what was computed for it, and the loop that was closed on it, stay done.

    Parameters
    ----------
    session
        Open to write, its model finished.
    target
        That is to be compensated.
    on_step
        Told what was learned, and what does not count.
    """
    records, current = told_records(session), _current(session)
    _say_what_does_not_count(records, current, on_step)
    told = {name: records[name].photographs for name in current}
    used = {
        name: session.finished(name).outputs_sha256
        for name, rows in told.items()
        if rows and rows[0].target_sha256 != target.sha256
    }
    if used or session.is_finished(EVIDENCE):
        step = session.step(EVIDENCE, settings={"told": used}, needs=tuple(rests_on(session)))
        if not step.done:
            rows = tuple(row for name in used for row in records[name].photographs)
            record = EvidenceRecord(rests_on=rests_on(session), photographs=rows)
            step.save_record(EVIDENCE, _gathered(session, step, record, tuple(used)) if used else record)
            step.finish()
    in_use = evidence_in_use(session)
    if in_use is not None:
        on_step(evidence_words(in_use), 1, 1)


def evidence_words(record: EvidenceRecord) -> str:
    """Return what earlier photographs brought, in words."""
    return (
        f"learned from {counted(len(record.photographs), 'photograph')} of "
        f"{counted(len(record.pictures), 'earlier picture')}: predicted error {record.rms_before:.2f} -> "
        f"{record.rms_left:.2f} grey levels"
    )


def _current(session: Session) -> list[str]:
    """Names of the steps whose photographs were read by the present model."""
    now = rests_on(session)
    return [name for name, record in told_records(session).items() if record.rests_on == now]


def _say_what_does_not_count(records: dict[str, EvidenceRecord], current: Sequence[str], on_step: OnStep) -> None:
    n_lost = sum(len(record.photographs) for name, record in records.items() if name not in current)
    if n_lost:
        lost = counted(n_lost, "photograph")
        on_step(f"{lost} of earlier pictures do not count: the model was measured anew since", 1, 1)
    for name in current:
        if records[name].refused:
            on_step(f"what {name} photographed does not count: {records[name].refused}", 1, 1)


def _gathered(session: Session, step: Step, record: EvidenceRecord, names: tuple[str, ...]) -> EvidenceRecord:
    """Put all together, and tell what they bring on usual pictures beyond the model as it was."""
    model, bands = load_prior_model(session), transport_priors(session)
    n_bands, middle = len(bands), len(bands) // 2
    found = told_of_light(session, n_bands, names)
    if found is None:
        return record
    told, uneven = found
    _save(step, told, uneven)
    below = told_of_light(session, n_bands, steps_below(session)[1:])
    before = [Photographs.none(band.prior) for band in bands] if below is None else below[0]
    band, known = bands[middle], _joined(before, told)[middle]
    usual = usual_at_all_places(band, model.scene_model.projector.lens.shape)
    after = learned_band(band, known, model.lit).posterior
    rms = [
        float(np.sqrt(one.variance(usual.lit, usual.own).mean())) * 255 / model.level
        for one in (posterior(after.prior, before[middle]), after)
    ]
    return replace(record, rms_before=rms[0], rms_left=rms[1])


def _known(session: Session, names: Sequence[str]) -> list[Photographs] | None:
    """What step `transport` and the steps of other pictures say in each band; None: nothing."""
    found = told_of_light(session, len(transport_priors(session)), (*steps_below(session)[1:], *names))
    return None if found is None else found[0]


def _joined(first: Sequence[Photographs], others: Sequence[Photographs]) -> list[Photographs]:
    return [band.and_(more) for band, more in zip(first, others, strict=True)]


def _save(step: Step, told: Sequence[Photographs], uneven: FloatArray) -> None:
    save_photographs(step, told)
    step.save_image("uneven", layers("uneven", uneven), folder="maps")
