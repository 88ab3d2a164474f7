"""Direct and global light by shifted checkers (Nayar et al. 2006): step `separation`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calibration.patterns import checker_patterns, flat
from calibration.separation import MARGIN_PX, separate, separate_by_pattern
from rig.pair import Rig
from rig.session import Session, Step
from rig.terminal import OnStep
from rig.workflows.calibrate import load_correspondence
from rig.workflows.capture import Shot, photograph
from rig.workflows.light import Float32Array, Photometry, light_of
from rig.workflows.photometric import load_photometry, measuring_shot

_WHITE_REPEATS = 4


def separate_light(rig: Rig, session: Session, on_step: OnStep) -> None:
    """Photograph white and the checkers, and split white into direct and global light."""
    patterns = rig.profile.patterns
    shot = measuring_shot(rig, session, repeats=1)
    settings = {"exposures_s": shot.exposures_s, "checker": [patterns.checker_size_px, patterns.checker_shifts]}
    step = session.step("separation", settings=settings, needs=("response", "correspondence"))
    if step.done:
        return
    shape = rig.projector.shape
    white_shot = Shot(shot.exposures_s, _WHITE_REPEATS)
    photograph(rig, session, step, [flat(shape, 255, "white")], white_shot, 1, on_step)
    checkers = list(checker_patterns(shape, patterns.checker_size_px, patterns.checker_shifts))
    photograph(rig, session, step, checkers, shot, len(checkers), on_step)
    photometry = load_photometry(session)
    white = light_of(step, "white", white_shot, photometry)
    frames = list(_stack(step, [pattern.name for pattern in checkers], shot, photometry, on_step))
    correspondence = load_correspondence(session)
    bright = separate(frames, white=white.value)
    known = separate_by_pattern(
        frames,
        [pattern.codes for pattern in checkers],
        correspondence,
        white=white.value,
        margin_px=min(MARGIN_PX, (patterns.checker_size_px - 1) // 3),
    )
    step.save_image(
        "separation",
        {
            "direct": np.where(known.valid, known.direct, bright.direct),
            "global": np.where(known.valid, known.global_, bright.global_),
            "white": white.value,
            "white_variance": white.variance,
            "valid": (known.valid & ~white.saturated).astype(np.float32),
        },
        folder="maps",
    )
    lit = known.valid & (known.direct > 0.2 * np.median(known.direct[known.valid]))
    step.save_record(
        "separation",
        {
            "extremes_over_known_pattern": float(np.median(bright.direct[lit] / known.direct[lit])),
        },
    )
    step.finish()


def _stack(step: Step, names: list[str], shot: Shot, photometry: Photometry, on_step: OnStep) -> Iterator[Float32Array]:
    for k, name in enumerate(names):
        on_step("separate direct and global", k, len(names))
        yield light_of(step, name, shot, photometry).value
    on_step("separate direct and global", len(names), len(names))
