"""Whether light adds up: red, green and blue against white, and two halves against the whole.

Both are judged in linear light, the camera's curve undone, so that they speak of the display and of what is automatic.
"""

from __future__ import annotations

import numpy as np

from rig.devices.protocols import Codes
from rig.self_check.parts.linearity import Linear
from rig.self_check.rig_under_test import FloatArray, RigUnderTest
from rig.self_check.rows import Measured, Row

_REPEATS = 2


def check_additivity(subject: RigUnderTest, linear: Linear) -> Measured:
    """White over the sum of its colours; halves over the whole."""
    colours = _white_over_colours(subject, linear)
    halves = _halves_over_whole(subject, linear)
    limits = subject.limits
    rows = (
        Row("white against red + green + blue", 100 * (colours - 1), "%"),
        Row("additivity: red + green + blue off white", 100 * abs(colours - 1), "%", limits.additivity_percent,
            advice="a white segment or brilliant colour: choose another picture mode (sRGB, photo); dynamic contrast "
            "and eco off"),
        Row("superposition: left half + right half off white", 100 * abs(halves - 1), "%", limits.superposition_percent,
            advice="dynamic contrast or iris of the projector, or something automatic of the camera is on"),
    )  # fmt: skip
    return Measured(rows, {}, {"white_over_colours": colours, "halves_over_whole": halves})


def _light(subject: RigUnderTest, linear: Linear, picture: int | Codes, name: str) -> FloatArray:
    """(H, W) linear light; all channels together on a colour camera."""
    frames = [subject.shoot(picture, name).pixels.astype(np.float64) for _ in range(_REPEATS)]
    return np.asarray(linear.light(np.mean(frames, axis=0)).mean(axis=2))


def _white_over_colours(subject: RigUnderTest, linear: Linear) -> float:
    colours = []
    for channel, name in enumerate(("red", "green", "blue")):
        codes = np.zeros((*subject.rig.projector.shape, 3), np.uint8)
        codes[..., channel] = 255
        colours.append(_light(subject, linear, codes, name))
    white, black = (_light(subject, linear, code, name) for code, name in ((255, "white"), (0, "black")))
    return float(np.median(((white - black) / (sum(colours) - 3 * black))[subject.lit]))


def _halves_over_whole(subject: RigUnderTest, linear: Linear) -> float:
    left = subject.codes_of(0)
    left[:, : left.shape[1] // 2] = 255
    white, black = (_light(subject, linear, code, name) for code, name in ((255, "white"), (0, "black")))
    halves = _light(subject, linear, left, "left-half") + _light(subject, linear, 255 - left, "right-half")
    return float(np.median(((halves - 2 * black) / (white - black))[subject.lit]))
