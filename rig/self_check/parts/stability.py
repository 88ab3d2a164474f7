"""Whether things stay where they are: the picture's shift between frames, and the light of white through the check."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import Codes, FloatArray
from calibration.radiometry.linearity import fit_linearity
from calibration.structured_light.consistency.displacement import shift_px
from calibration.structured_light.patterns import random_blocks
from rig.records import Record, Verdict
from rig.self_check.results import PartResult
from rig.self_check.rig_under_test import RigUnderTest

_FRAMES = 24
"""Nearly a second of a usual camera: footsteps and fans show."""
_BLOCKS = 40
"""Along the longer side of the picture: large enough to be sharp, small enough to hold still by."""
_REFERENCE_FRAMES = 3
"""Averaged, so that the reference's noise does not move what is compared with it."""


@dataclass(frozen=True, slots=True)
class ReferenceImage:
    """The scene under a picture full of edges, at the beginning of the check."""

    codes: Codes
    image: FloatArray
    """(H, W) digital numbers, noise averaged down."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stability(Record):
    """Where the picture was, and how bright white was, through the check."""

    shifts_px: FloatArray
    """(N, 2) (x, y) of each frame of a series, since the check began."""
    white_times_s: FloatArray
    """(M,) when white was photographed."""
    white_light_dn: FloatArray
    """(M,) its mean over the lit pixels, above black."""


def take_reference_image(tested: RigUnderTest) -> ReferenceImage:
    """Photograph the blocks."""
    codes = random_blocks(tested.picture_shape, _BLOCKS)
    frames = [tested.photograph(codes, "blocks") for _ in range(_REFERENCE_FRAMES)]
    return ReferenceImage(codes, np.asarray(np.mean(frames, axis=0)))


def check_stability(tested: RigUnderTest, reference: ReferenceImage) -> PartResult[Stability]:
    """Vibration within a series, shift and light since the beginning."""
    frames = tested.series(reference.codes, _FRAMES, "blocks")
    shifts = np.array([shift_px(tested.pixels(frame), reference.image) for frame in frames])
    vibration = float(np.sqrt(shifts.var(axis=0).sum()))
    moved = float(np.hypot(*shifts.mean(axis=0)))
    tested.note_white()
    times_s, light = (np.array(values) for values in zip(*tested.white_levels, strict=True))
    change, per_minute = _drift(times_s, light)
    limits = tested.limits
    verdicts = (
        Verdict(
            what="vibration of the picture, rms",
            value=vibration,
            limit=limits.vibration_px,
            unit="px",
            advice="screw camera and projector to something heavy; no fan and no footstep near them",
        ),
        Verdict(
            what="shift of the picture since the beginning",
            value=moved,
            limit=limits.shift_px,
            unit="px",
            advice="let the mounts settle and the lenses warm up; image stabiliser and autofocus off",
        ),
        Verdict(
            what="change of white between first and last frame",
            value=change,
            limit=limits.drift_percent,
            unit="%",
            advice="let the lamp warm up for half an hour; dynamic iris, eco mode and automatic gain off",
        ),
        Verdict(
            what="drift of white",
            value=per_minute,
            limit=limits.drift_percent_per_minute,
            unit="% a minute",
            advice="as above; daylight in the room drifts, too",
        ),
    )
    return PartResult(
        verdicts=verdicts, numbers=Stability(shifts_px=shifts, white_times_s=times_s, white_light_dn=light)
    )


def _drift(times_s: FloatArray, light: FloatArray) -> tuple[float, float]:
    """Change from first to last photograph, and slope over all if it is more than scatter. [%, % a minute]."""
    change = 100 * abs(float(light[-1] / light[0]) - 1)
    line = fit_linearity(times_s - times_s[0], light)
    sure = max(abs(line.slope) - 2 * line.slope_sigma, 0.0)
    return change, 60 * 100 * sure / float(light.mean())
