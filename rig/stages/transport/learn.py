"""A few more photographs, each of the picture that tells most: step `transport`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from calibration.light.transport.choice import NextPhotograph, Pictures, least_certain, next_photograph
from calibration.light.transport.posterior import Photographs, TransportPosterior, fitted
from calibration.light.transport.prior import TransportPrior
from calibration.structured_light.patterns import Pattern
from rig.capture.rig import Rig
from rig.files.channels import layers
from rig.profile.schema import Profile
from rig.records import JsonObject, json_of
from rig.session import Session, Step
from rig.stages.linear_light import RadiometricCalibration, channel_light, merge_exposures
from rig.stages.model import FittedScene, load_prior_model, transport_priors
from rig.stages.photograph import ExposureBracket, photograph
from rig.stages.prediction import picture_parts
from rig.stages.radiometry import measuring_bracket
from rig.stages.separation import calibration_of_pictures
from rig.stages.transport.held_out import ShownPictures, learned_bands, what_is_left
from rig.stages.transport.learned import BandPrior
from rig.stages.transport.pictures import KnownPicture, fixed_pictures, of_patches, usual_pictures
from rig.stages.transport.places import WORTH
from rig.stages.transport.records import PhotographNote, TransportRecord, save_photographs
from rig.stages.transport.shine import surface_gloss
from rig.terminal import OnStep, silent

FloatArray = NDArray[np.float64]

_ASKED_PLACES = 400
"""SurfacePlaces at which the next picture is chosen; all of them say the same, more slowly."""
_DIRECTIONS = 6
"""Least certain directions that are among the candidates."""
_WHITE_FRAMES = 4
"""Frames of white at each exposure: one photograph has so many times its variance."""
_UNEVEN = 0.001
"""Of the light of a place, the least standard deviation of its mean: what neighbours have in common."""


def transport_settings(session: Session) -> JsonObject:
    """Return what step `transport` depends on."""
    bracket = measuring_bracket(session)
    return {
        "photographs": session.profile.transport.photographs,
        "exposures_s": json_of(bracket.exposures_s),
        "repeats": bracket.repeats,
        "places": "whole pixels, eighty across",
        "held_out": "each photograph in turn",
    }


def transport_frames(profile: Profile) -> int:
    """Return how many frames step `transport` takes at most."""
    patterns = profile.patterns
    return profile.transport.photographs * len(patterns.exposures) * patterns.frames_averaged


def learns_transport(profile: Profile) -> bool:
    """Tell whether a profile asks for the step."""
    return profile.transport.photographs > 0


@dataclass(frozen=True, eq=False, kw_only=True)
class PictureSearch:
    """What a picture is chosen with, or held worth its while: some places of one band."""

    band: BandPrior
    chosen: NDArray[np.intp]
    """SurfacePlaces that are asked."""
    direct: csr_array
    """(places, n pixels) direct light of the chosen ones, as a share of white's."""
    noise_variance: FloatArray
    usual: FloatArray
    """Features of pictures as people show them, for a spread of 1 ..."""
    fixed: list[KnownPicture]
    fixed_seen: FloatArray
    """... and of the pictures that are tried each time."""

    @classmethod
    def in_band(cls, band: BandPrior, white_variance: FloatArray, shape: tuple[int, int]) -> PictureSearch:
        """Prepare for a band, of which white has a variance (H, W)."""
        places = band.places
        chosen = np.unique(np.linspace(0, places.count - 1, _ASKED_PLACES).astype(np.intp))
        means = places.mean_of()
        direct = csr_array(means[chosen] @ band.transport.direct_matrix)
        white = np.maximum(np.asarray(direct.sum(axis=1)), np.finfo(float).tiny)
        pixels = np.bincount(places.of_pixel[places.of_pixel >= 0], minlength=places.count)
        noise = _WHITE_FRAMES * (means @ white_variance.ravel()) / pixels
        prior, fixed, shares = band.prior.at(chosen), fixed_pictures(shape), csr_array(direct / white[:, None])
        images = np.stack([each.image.ravel() for each in fixed], axis=1).astype(np.float64)
        return cls(
            band=band,
            chosen=chosen,
            direct=shares,
            noise_variance=noise[chosen] / WORTH,
            usual=_features(prior, _seen(band, shares, usual_pictures(shape))),
            fixed=fixed,
            fixed_seen=_features(prior, _seen(band, shares, images)),
        )

    def next(self, known: Photographs, shape: tuple[int, int]) -> tuple[KnownPicture, NextPhotograph]:
        """Choose the picture that tells most after some photographs."""
        prior = self.band.prior.at(self.chosen)
        found: TransportPosterior = fitted(prior, known.at(self.chosen), worth=WORTH)
        directions = of_patches(least_certain(found, _DIRECTIONS), self.band.lit, shape)
        images = np.stack([each.image.ravel() for each in directions], axis=1).astype(np.float64)
        more = _features(prior, _seen(self.band, self.direct, images))
        candidates = np.concatenate([self.fixed_seen, more], axis=1)
        best = next_photograph(found, candidates, self.usual, self.noise_variance)
        return [*self.fixed, *directions][best.index], best

    def worth_of(self, known: Photographs, more: Photographs) -> NextPhotograph:
        """Tell what one more photograph brings to some."""
        prior = self.band.prior.at(self.chosen)
        found = fitted(prior, known.at(self.chosen), worth=WORTH)
        one = more.at(self.chosen)
        return next_photograph(found, prior.of_one(one.lit, one.own), self.usual, self.noise_variance)

    @property
    def noise_rms(self) -> float:
        """Of a photograph at a place and those about it."""
        return float(np.sqrt(self.noise_variance.mean()))


def _seen(band: BandPrior, direct: csr_array, images: FloatArray) -> Pictures:
    return Pictures(lit=band.lit.shares(images), own=np.asarray((direct @ images).T))


def _features(prior: TransportPrior, pictures: Pictures) -> FloatArray:
    return prior.of_one(pictures.lit, pictures.own)


def usual_at_all_places(band: BandPrior, shape: tuple[int, int]) -> Pictures:
    """Return pictures as people show them, as all places of a band see them."""
    direct = csr_array(band.places.mean_of() @ band.transport.direct_matrix)
    white = np.maximum(np.asarray(direct.sum(axis=1)), np.finfo(float).tiny)
    return _seen(band, csr_array(direct / white[:, None]), usual_pictures(shape))


def learn_transport(rig: Rig, session: Session, step: Step, on_step: OnStep) -> None:
    """Step `transport`: photograph what tells most, until that is less than the noise or there are enough."""
    model, radiometric = load_prior_model(session), calibration_of_pictures(session)
    most, bracket = session.profile.transport.photographs, measuring_bracket(session)
    bands, shape = transport_priors(session), rig.projector.shape
    middle = len(bands) // 2
    search = PictureSearch.in_band(bands[middle], model.white_variance[..., middle], shape)
    known = [Photographs.none(band.prior) for band in bands]
    notes: list[PhotographNote] = []
    patterns: list[Pattern] = []
    to_levels = 255 / model.level
    while True:
        on_step("photograph what tells most of the light", len(notes), most)
        picture, best = search.next(known[middle], shape)
        if len(notes) == most or best.brings < search.noise_rms:
            break
        pattern = Pattern(f"transport-{len(notes):02d}", np.where(picture.image, 255, 0).astype(np.uint8))
        photograph(rig, session, step, [pattern], bracket=bracket, n_patterns=1, on_step=silent)
        taken = photographs_of(model, radiometric, bands, step=step, pattern=pattern, bracket=bracket)
        patterns.append(pattern)
        known = [before.and_(more) for before, more in zip(known, taken, strict=True)]
        notes.append(_note(pattern.name, picture, best, to_levels))
    on_step("photograph what tells most of the light", most, most)
    save_photographs(step, known)
    shown = ShownPictures(step=step, bracket=bracket, radiometric=radiometric, patterns=tuple(patterns))
    learned = learned_bands(model, bands, known, shown, on_step=on_step)
    step.save_image("uneven", layers("uneven", np.stack([band.uneven for band in learned], axis=-1)), folder="maps")
    left = what_is_left(learned[middle], known[middle], usual_at_all_places(bands[middle], shape))
    step.save_record(
        "transport",
        TransportRecord(
            photographs=tuple(notes),
            another_brings=best.brings * to_levels,
            noise_of_place=search.noise_rms * to_levels,
            rms_left=left.usual_rms * to_levels,
            left_out_rms=left.left_out_rms * to_levels,
            left_out_expected=left.left_out_expected * to_levels,
            gloss=surface_gloss(bands[middle], known[middle]) if notes else (),
        ),
    )


def _note(name: str, picture: KnownPicture, best: NextPhotograph, to_levels: float) -> PhotographNote:
    return PhotographNote(
        name=name,
        kind=picture.kind,
        lit_share=float(picture.image.mean()),
        brings=best.brings * to_levels,
        rms_before=best.rms_now * to_levels,
    )


def photographs_of(
    model: FittedScene,
    radiometric: RadiometricCalibration,
    bands: tuple[BandPrior, ...],
    *,
    step: Step,
    pattern: Pattern,
    bracket: ExposureBracket,
) -> list[Photographs]:
    """What one photograph says in each band."""
    measured = merge_exposures(step, pattern.name, bracket, radiometric)
    light = channel_light(radiometric.projector, pattern.codes).reshape(-1, model.channels).astype(np.float64)
    mixing = model.room.mixing
    mixed = (light @ mixing.T) / mixing.sum(axis=1)
    found = []
    for b, band in enumerate(bands):
        parts = picture_parts(model, radiometric, band=b, light=mixed[:, b])
        variance = measured.variance[..., b] + parts.variance + parts.moved_by(model.uncertainty.split[..., b]) ** 2
        usable = ~measured.saturated[..., b] & (variance > 0)
        weight = np.where(usable, 1 / np.where(usable, variance, 1.0), 0.0)
        means = band.places.mean_of(weight)
        off = means @ (measured.value[..., b] - parts.value).ravel()
        own = (means @ parts.direct.ravel()) / np.maximum(means @ parts.white_direct.ravel(), np.finfo(float).tiny)
        spread = np.asarray(means.power(2) @ variance.ravel()) + (_UNEVEN * (means @ parts.value.ravel())) ** 2
        spread = np.where(np.asarray(means.sum(axis=1)) > 0, spread, np.inf)
        found.append(
            Photographs(
                lit=band.lit.shares(mixed[:, b : b + 1]),
                own=own[None],
                difference=off[None],
                variance=np.maximum(spread, np.finfo(float).tiny)[None],
            )
        )
    return found
