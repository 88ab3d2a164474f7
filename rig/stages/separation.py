"""Direct and global light by shifted checkers (Nayar et al. 2006): step `separation`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from calibration.light.separation import MARGIN_PX, Separation, separate, separate_by_pattern
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.patterns import Pattern, checker_patterns, flat
from rig.capture.rig import Rig
from rig.files.channels import layers
from rig.session import Session, Step
from rig.stages.correspondence import load_correspondence
from rig.stages.linear_light import Float32Array, RadiometricCalibration, merge_exposures
from rig.stages.photograph import ExposureBracket, photograph
from rig.stages.radiometry import load_radiometric_calibration, measuring_bracket
from rig.terminal import OnStep

_WHITE_REPEATS = 4


def separate_light(rig: Rig, session: Session, on_step: OnStep) -> None:
    """Photograph white and the checkers, and split white into direct and global light."""
    patterns = rig.profile.patterns
    shot = measuring_bracket(rig, session, repeats=1)
    settings = {"exposures_s": shot.exposures_s, "checker": [patterns.checker_size_px, patterns.checker_shifts]}
    step = session.step("separation", settings=settings, needs=("response", "correspondence"))
    if step.done:
        return
    shape = rig.projector.shape
    white_shot = ExposureBracket(shot.exposures_s, _WHITE_REPEATS)
    photograph(rig, session, step, [flat(shape, 255, "white")], white_shot, 1, on_step)
    checkers = list(checker_patterns(shape, patterns.checker_size_px, patterns.checker_shifts))
    photograph(rig, session, step, checkers, shot, len(checkers), on_step)
    radiometric = load_radiometric_calibration(session)
    white = merge_exposures(step, "white", white_shot, radiometric)
    frames = list(_stack(step, [pattern.name for pattern in checkers], shot, radiometric, on_step))
    bright, known = _separated(frames, checkers, white.value, load_correspondence(session), patterns.checker_size_px)
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
    lit = valid & (direct > 0.2 * np.median(direct[valid]))
    step.save_record("separation", {"extremes_over_known_pattern": float(np.median(extremes[lit] / direct[lit]))})
    step.finish()


def _separated(
    frames: list[Float32Array],
    checkers: list[Pattern],
    white: Float32Array,
    correspondence: Correspondence,
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


def _stack(
    step: Step, names: list[str], shot: ExposureBracket, radiometric: RadiometricCalibration, on_step: OnStep
) -> Iterator[Float32Array]:
    for k, name in enumerate(names):
        on_step("separate direct and global", k, len(names))
        yield merge_exposures(step, name, shot, radiometric).value
    on_step("separate direct and global", len(names), len(names))
