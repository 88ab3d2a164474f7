"""Whether light adds up: red, green and blue against white, and two halves against the whole.

Both are judged in linear light, the camera's curve undone, so that they speak of the display and of what is automatic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import Codes, FloatArray
from calibration.structured_light.patterns import WHITE, left_half, primary
from rig.files.channels import PRIMARIES
from rig.records import Record, Verdict
from rig.self_check.parts.linearity import CameraCurve
from rig.self_check.results import PartResult
from rig.self_check.rig_under_test import RigUnderTest

_REPEATS = 2
"""Of each picture: noise of the median over all lit pixels is far below the limit then."""


@dataclass(frozen=True, kw_only=True)
class Additivity(Record):
    """Sums of light over the whole."""

    white_over_colours: float
    """White over red + green + blue."""
    halves_over_whole: float
    """Left half + right half over white."""


def check_additivity(tested: RigUnderTest, curve: CameraCurve) -> PartResult[Additivity]:
    """White over the sum of its colours; halves over the whole."""
    colours = _white_over_colours(tested, curve)
    halves = _halves_over_whole(tested, curve)
    limits = tested.limits
    verdicts = (
        Verdict(what="white against red + green + blue", value=100 * (colours - 1), unit="%"),
        Verdict(
            what="additivity: red + green + blue off white",
            value=100 * abs(colours - 1),
            limit=limits.additivity_percent,
            unit="%",
            advice="a white segment or brilliant colour: choose another picture mode (sRGB, photo); dynamic contrast "
            "and eco off",
        ),
        Verdict(
            what="superposition: left half + right half off white",
            value=100 * abs(halves - 1),
            limit=limits.superposition_percent,
            unit="%",
            advice="dynamic contrast or iris of the projector, or something automatic of the camera is on",
        ),
    )
    numbers = Additivity(white_over_colours=colours, halves_over_whole=halves)
    return PartResult(verdicts=verdicts, numbers=numbers)


def _light(tested: RigUnderTest, curve: CameraCurve, picture: int | Codes, name: str) -> FloatArray:
    """(H, W) linear light; all channels together on a colour camera."""
    frames = [tested.shoot(picture, name).pixels.astype(np.float64) for _ in range(_REPEATS)]
    return np.asarray(curve.light(np.mean(frames, axis=0)).mean(axis=2))


def _white_over_colours(tested: RigUnderTest, curve: CameraCurve) -> float:
    colours = []
    for channel, name in enumerate(PRIMARIES[3]):
        colours.append(_light(tested, curve, primary(tested.picture_shape, channel, name).codes, name))
    white, black = (_light(tested, curve, code, name) for code, name in ((255, "white"), (0, "black")))
    return float(np.median(((white - black) / (sum(colours) - 3 * black))[tested.lit]))


def _halves_over_whole(tested: RigUnderTest, curve: CameraCurve) -> float:
    left = left_half(tested.picture_shape)
    white, black = (_light(tested, curve, code, name) for code, name in ((255, "white"), (0, "black")))
    halves = _light(tested, curve, left, "left-half") + _light(tested, curve, WHITE - left, "right-half")
    return float(np.median(((halves - 2 * black) / (white - black))[tested.lit]))
