"""What light there is while the projector shows black: the room's and the display's own."""

from __future__ import annotations

import numpy as np

from rig.self_check.rig_under_test import RigUnderTest
from rig.self_check.rows import Measured, Row


def check_darkness(subject: RigUnderTest) -> Measured:
    """Light on black against light on white, and the contrast between the two.

    The camera cannot tell room light from the display's black without covering the projector's lens.
    """
    white = subject.white - subject.offset_dn
    black = subject.black - subject.offset_dn
    light = white - black
    share = float(np.median((black / light)[subject.lit]))
    contrast = float(np.median(white[subject.lit]) / max(float(np.median(black[subject.lit])), 1e-9))
    noise = 1 / np.sqrt(subject.lit.sum())
    measurable = float(np.median(black[subject.lit])) > 3 * noise
    rows = (
        Row("room light and the display's black, against white", 100 * share, "% of white",
            subject.limits.dark_light_percent,
            advice="darken the room; cover the projector's lens: what is left is room light"),
        Row("contrast of white over black on the wall", contrast if measurable else None, "to 1",
            advice="" if measurable else "black is too dark to be measured"),
    )  # fmt: skip
    return Measured(rows, {}, {"black_dn": float(np.median(black[subject.lit])), "share": share, "contrast": contrast})
