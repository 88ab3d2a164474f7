"""What light there is while the projector shows black: the room's and the display's own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.records import Record, Verdict
from rig.self_check.parts.linearity import CameraCurve
from rig.self_check.results import PartResult
from rig.self_check.rig_under_test import RigUnderTest


@dataclass(frozen=True, kw_only=True)
class Darkness(Record):
    """Light while the projector shows black."""

    black_dn: float
    """Median over the lit pixels, above the dark level, the camera's curve undone."""
    share: float
    """Of white."""
    contrast: float
    """White over black."""


def check_darkness(tested: RigUnderTest, curve: CameraCurve) -> PartResult[Darkness]:
    """Light on black against light on white, and the contrast between the two.

    The camera cannot tell room light from the display's black without covering the projector's lens.
    """
    white, black = curve.light(tested.white), curve.light(tested.black)
    light = white - black
    share = float(np.median((black / light)[tested.lit]))
    contrast = float(np.median(white[tested.lit]) / max(float(np.median(black[tested.lit])), 1e-9))
    noise = 1 / np.sqrt(tested.lit.sum())
    measurable = float(np.median(black[tested.lit])) > 3 * noise
    verdicts = (
        Verdict(
            what="room light and the display's black, against white",
            value=100 * share,
            limit=tested.limits.dark_light_percent,
            unit="% of white",
            advice="darken the room; cover the projector's lens: what is left is room light",
        ),
        Verdict(
            what="contrast of white over black on the wall",
            value=contrast if measurable else None,
            unit="to 1",
            advice="" if measurable else "black is too dark to be measured",
        ),
    )
    numbers = Darkness(black_dn=float(np.median(black[tested.lit])), share=share, contrast=contrast)
    return PartResult(verdicts=verdicts, numbers=numbers)
