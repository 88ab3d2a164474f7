"""Direct and global light by shifted checkers (Nayar et al. 2006): step `separation`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.light.separation import MARGIN_PX, Separation, separate, separate_by_pattern
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.patterns import Pattern, checker_patterns, flat
from rig.capture.rig import Rig
from rig.files.channels import layers
from rig.profile.schema import Profile
from rig.records import JsonObject, Record, json_of
from rig.session import Session, Step
from rig.stages.correspondence import load_correspondence
from rig.stages.linear_light import Float32Array, LightImage, merge_exposures
from rig.stages.photograph import ExposureBracket, photograph
from rig.stages.radiometry import load_radiometric_calibration, measuring_bracket
from rig.terminal import OnStep

_WHITE_REPEATS = 4
"""Frames of white at each exposure: the model is made from them, and their noise stays in it."""
_LIT_SHARE = 0.2
"""Of the median direct light: pixels above it tell how well the two ways to separate agree."""


@dataclass(frozen=True, kw_only=True)
class SeparationRecord(Record):
    """What step `separation` found, beside its images."""

    extremes_over_known_pattern: float
    """Median direct light by the brightest and darkest frames over that by the known pattern."""


def separation_settings(session: Session) -> JsonObject:
    """Return what step `separation` depends on."""
    patterns = session.profile.patterns
    return {
        "exposures_s": json_of(measuring_bracket(session).exposures_s),
        "checker": [patterns.checker_size_px, patterns.checker_shifts],
    }


def separation_frames(profile: Profile) -> int:
    """Return how many frames step `separation` takes."""
    return (_WHITE_REPEATS + profile.patterns.checker_shifts) * len(profile.patterns.exposures)


def separate_light(rig: Rig, session: Session, step: Step, on_step: OnStep) -> None:
    """Step `separation`: photograph white and the checkers, and split white into direct and global light."""
    shape, size_px = rig.projector.shape, rig.profile.patterns.checker_size_px
    bracket = measuring_bracket(session, repeats=1)
    white_bracket = ExposureBracket(bracket.exposures_s, _WHITE_REPEATS)
    checkers = list(checker_patterns(shape, size_px, rig.profile.patterns.checker_shifts))
    for patterns, how in (([flat(shape, 255, "white")], white_bracket), (checkers, bracket)):
        photograph(rig, session, step, patterns, bracket=how, n_patterns=len(patterns), on_step=on_step)
    radiometric = load_radiometric_calibration(session)
    white = merge_exposures(step, "white", white_bracket, radiometric)
    names = [pattern.name for pattern in checkers]
    frames = [merge_exposures(step, name, bracket, radiometric).value for name in _told(names, on_step)]
    bright, known = _separated(frames, checkers, white.value, load_correspondence(session), checker_size_px=size_px)
    _save(step, white, bright, known)


def _told(names: Sequence[str], on_step: OnStep) -> Iterator[str]:
    """Go through names, and tell how far."""
    for k, name in enumerate(names):
        on_step("separate direct and global", k, len(names))
        yield name
    on_step("separate direct and global", len(names), len(names))


def _save(step: Step, white: LightImage, bright: Separation, known: Separation) -> None:
    """Keep the light by the known pattern, and where that is not valid, by the brightest and darkest frames."""
    valid = known.valid.all(axis=-1)
    step.save_image(
        "separation",
        {
            **layers("direct", np.where(known.valid, known.direct, bright.direct)),
            **layers("global", np.where(known.valid, known.global_, bright.global_)),
            **layers("white", white.value),
            **layers("white_variance", white.variance),
            "valid": (valid & ~white.any_saturated).astype(np.float32),
        },
        folder="maps",
    )
    extremes, direct = (found.direct.mean(axis=-1) for found in (bright, known))
    lit = valid & (direct > _LIT_SHARE * np.median(direct[valid]))
    agreement = float(np.median(extremes[lit] / direct[lit]))
    step.save_record("separation", SeparationRecord(extremes_over_known_pattern=agreement))


def _separated(
    frames: list[Float32Array],
    checkers: list[Pattern],
    white: Float32Array,
    correspondence: Correspondence,
    *,
    checker_size_px: int,
) -> tuple[Separation, Separation]:
    """By the brightest and darkest frames, and by the known pattern; (H, W, B) each."""
    margin_px = min(MARGIN_PX, (checker_size_px - 1) // 3)
    codes = [pattern.codes for pattern in checkers]
    found = []
    for b in range(white.shape[-1]):
        band = [np.ascontiguousarray(frame[..., b]) for frame in frames]
        white_b = np.ascontiguousarray(white[..., b])
        known = separate_by_pattern(band, codes, correspondence, white=white_b, margin_px=margin_px)
        found.append((separate(band, white=white_b), known))
    bright, known = (_joined(parts) for parts in zip(*found, strict=True))
    return bright, known


def _joined(bands: Sequence[Separation]) -> Separation:
    return Separation(
        np.stack([band.direct for band in bands], axis=-1),
        np.stack([band.global_ for band in bands], axis=-1),
        np.stack([band.valid for band in bands], axis=-1),
    )
