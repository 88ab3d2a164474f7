"""What photographs of closed loops tell of the light: read beside each loop, gathered for the pictures after it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.light.transport.posterior import Photographs, posterior
from rig.files.channels import layers
from rig.session import Session, Step
from rig.stages.linear_light import merge_exposures
from rig.stages.model import load_model, load_prior_model, transport_priors
from rig.stages.prediction import predict
from rig.stages.target import Target
from rig.stages.transport.evidence import (
    EVIDENCE,
    EarlierPicture,
    EvidenceRecord,
    evidence_words,
    gathered_evidence,
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
BoolArray = NDArray[np.bool_]

_LEAST_WITHIN, _LEAST_ALIKE = 0.85, 0.9
"""Of a loop's first photograph within three standard deviations of the prediction, and the least correlation of its
details with the prediction's: with less, the rig is not as it was measured. In simulated rooms, matte and glossy, the
share is 0.94 and more, the correlation 0.95 and more; a matte room's lamp that is 2 % dimmer leaves 0.79 within, a
camera that moved by a pixel a correlation of 0.69 to 0.80."""
_MOST_PICTURES = 32
"""That are used: as many as the photographs of a long `[transport]`, whose regressions take seconds."""
_DETAIL_PX = 4.0
"""Standard deviation of the smoothing that leaves details over: global light, which a model has wrong, is smooth."""


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
    step = session.step(
        told_name(shown.step.name, target.asked_sha256), settings=settings, needs=tuple(rests_on(session))
    )
    if step.done:
        return
    picture = EarlierPicture(
        picture=target.name,
        target_sha256=target.asked_sha256,
        photographs=len(shown.patterns),
        refused=_contradiction(session, shown),
    )
    if not picture.refused:
        picture = _told(session, step, shown, picture)
    step.save_record(EVIDENCE, EvidenceRecord(rests_on=rests_on(session), pictures=(picture,)))
    step.finish()


def _told(session: Session, step: Step, shown: ShownPictures, picture: EarlierPicture) -> EarlierPicture:
    """Keep what the photographs say if it is more than noise."""
    model, bands = load_prior_model(session), transport_priors(session)
    middle, to_levels = len(bands) // 2, 255 / model.level
    shape = model.scene_model.projector.lens.shape
    search = PictureSearch.in_band(bands[middle], model.white_variance[..., middle], shape)
    before = _known(session, picture.target_sha256)
    each = [
        photographs_of(model, shown.radiometric, bands, step=shown.step, pattern=pattern, bracket=shown.bracket)
        for pattern in shown.patterns
    ]
    told = [_mean([captures[b] for captures in each]) for b in range(len(bands))]
    found = search.worth_of(before[middle], told[middle])
    brings, noise = found.brings * to_levels, search.noise_rms * to_levels
    if brings < noise:
        words = f"they would bring {brings:.2f} grey levels, less than the noise of {noise:.2f}"
        return replace(picture, brings=brings, noise=noise, refused=words)
    learned = learned_bands(model, bands, _joined(before, told), shown, on_step=silent)
    _save(step, told, np.stack([band.uneven for band in learned], axis=-1))
    return replace(picture, brings=brings, noise=noise)


def _mean(captures: Sequence[Photographs]) -> Photographs:
    """One photograph of the mean of some pictures: light is linear.

    Its variance is the captures' own, for nearly all of it is theirs in common: the curves' errors, and the places'.
    """
    names = ("lit", "own", "difference", "variance")
    return Photographs(**{name: np.mean([getattr(one, name) for one in captures], axis=0) for name in names})


def _contradiction(session: Session, shown: ShownPictures) -> str:
    """Why a loop's photographs are not of the room as it was measured; empty if they are."""
    model, first = load_model(session), shown.patterns[0]
    measured = merge_exposures(shown.step, first.name, shown.bracket, shown.radiometric)
    predicted = predict(model, shown.radiometric, first.codes)
    usable = model.lit[..., None] & ~measured.saturated
    sigma = np.sqrt(measured.variance + predicted.sigma**2)
    within = float((np.abs(measured.value - predicted.light) <= 3 * sigma)[usable].mean())
    if within < _LEAST_WITHIN:
        return (
            f"{100 * within:.0f} % of the first is within three standard deviations of the prediction, "
            f"{100 * _LEAST_WITHIN:.0f} % are asked for: the light or the rig is not as it was measured; "
            "run `rig recheck`"
        )
    one, other = (_details(light, usable) for light in (measured.value, predicted.light))
    alike = float((one * other).sum() / np.sqrt(max((one**2).sum() * (other**2).sum(), np.finfo(float).tiny)))
    if alike < _LEAST_ALIKE:
        return (
            f"details of the first correlate with the prediction's by {alike:.2f}, {_LEAST_ALIKE:.2f} is asked for: "
            "the camera or the projector moved, or the picture has no details; run `rig recheck`"
        )
    return ""


def _details(light: NDArray[np.floating[Any]], usable: BoolArray) -> FloatArray:
    """(H, W, B) light less its mean about each pixel; 0 where it is not usable."""
    known = usable.astype(np.float64)
    total, weight = (
        cv2.GaussianBlur(each, (0, 0), _DETAIL_PX).reshape(light.shape)
        for each in (np.where(usable, light, 0.0), known)
    )
    return np.where(usable, light - total / np.maximum(weight, np.finfo(float).tiny), 0.0)


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
    records = told_records(session)
    now = rests_on(session)
    current = {name: record for name, record in records.items() if record.rests_on == now}
    _say_what_does_not_count(records, current, on_step)
    used = {name: session.finished(name).outputs_sha256 for name in _of_others(current, target.asked_sha256)}
    if used or session.is_finished(EVIDENCE):
        step = session.step(EVIDENCE, settings={"told": used}, needs=tuple(now))
        if not step.done:
            pictures = tuple(current[name].pictures[0] for name in used)
            record = EvidenceRecord(rests_on=now, pictures=pictures)
            step.save_record(EVIDENCE, _gathered(session, step, record, tuple(used)) if used else record)
            step.finish()
    found = gathered_evidence(session)
    if found is not None:
        on_step(evidence_words(found), 1, 1)


def _of_others(current: Mapping[str, EvidenceRecord], target_sha256: str) -> list[str]:
    """Names of the steps of other pictures that count, the latest; of each picture that of the newest loop."""
    newest = {record.pictures[0].target_sha256: name for name, record in current.items() if record.counts}
    return [name for sha, name in newest.items() if sha != target_sha256][-_MOST_PICTURES:]


def _say_what_does_not_count(
    records: Mapping[str, EvidenceRecord], current: Mapping[str, EvidenceRecord], on_step: OnStep
) -> None:
    n_lost = sum(record.photographs for name, record in records.items() if name not in current)
    if n_lost:
        lost = counted(n_lost, "photograph")
        on_step(f"{lost} of earlier pictures do not count: the rig or its model was measured anew since", 1, 1)
    for picture in (record.pictures[0] for record in current.values()):
        if picture.refused:
            shot = counted(picture.photographs, "photograph")
            on_step(f"{shot} of {picture.picture} do not count: {picture.refused}", 1, 1)


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
    contradict = (
        "with them the model's error is expected to be {:.2f} grey levels, {:.2f} without: they contradict each other"
    )
    refused = "" if rms[1] < rms[0] else contradict.format(rms[1], rms[0])
    return replace(record, rms_before=rms[0], rms_left=rms[1], refused=refused)


def _known(session: Session, target_sha256: str) -> list[Photographs]:
    """What step `transport` and the steps of other pictures say in each band."""
    now, bands = rests_on(session), transport_priors(session)
    current = {name: one for name, one in told_records(session).items() if one.rests_on == now}
    steps = (*steps_below(session)[1:], *_of_others(current, target_sha256))
    found = told_of_light(session, len(bands), steps)
    return [Photographs.none(band.prior) for band in bands] if found is None else found[0]


def _joined(first: Sequence[Photographs], others: Sequence[Photographs]) -> list[Photographs]:
    return [band.and_(more) for band, more in zip(first, others, strict=True)]


def _save(step: Step, told: Sequence[Photographs], uneven: FloatArray) -> None:
    save_photographs(step, told)
    step.save_image("uneven", layers("uneven", uneven), folder="maps")
