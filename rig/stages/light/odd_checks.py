"""Pictures of checks that are not what the others make of them: a few are left out, more end the step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.arrays import BoolArray
from calibration.errors import CalibrationError
from calibration.light.cross_check import CrossCheck
from rig.terminal.line import first_of

_MOST_OFF_PERCENT, _MOST_RMS_RATIO = 3.0, 2.5
"""Of direct light, and times the middle picture of checks. On 13 random rigs pictures were off by at most 0.1 %, and
left at most 1.1 times as much; with somebody in some of them 15 %, 5.6 times; with light switched on 6 to 10 %."""
_MOST_LEFT_OUT = 5
"""One of so many pictures at most: the others have to tell which are odd."""
_LISTED = 4


def odd_among(crossed: CrossCheck | None) -> BoolArray:
    """(K,) pictures of checks that are not what the others make of them; none where nothing was compared."""
    if crossed is None:
        return np.zeros(0, dtype=bool)
    return np.asarray((np.abs(crossed.off_percent) > _MOST_OFF_PERCENT) | (crossed.rms_ratio > _MOST_RMS_RATIO))


def are_few(odd: BoolArray) -> bool:
    """Whether enough pictures are left without these."""
    return bool(np.count_nonzero(odd) * _MOST_LEFT_OUT <= len(odd))


def refuse_odd(crossed: CrossCheck | None, names: Sequence[str]) -> None:
    """Refuse pictures of which some are odd: more than may be left out, or odd without those, too.

    Raises
    ------
    CalibrationError
        With their names, the worst one's figures, and what to do.
    """
    odd = odd_among(crossed)
    if crossed is None or not odd.any():
        return
    worst = int(np.argmax(np.where(odd, np.abs(crossed.off_percent), 0.0)))
    which = [name for name, is_odd in zip(names, odd, strict=True) if is_odd]
    raise CalibrationError(
        f"{len(which)} of {len(names)} pictures of checks are not what the others make of them ({first_names(which)}): "
        f"{names[worst]} is {crossed.off_percent[worst]:+.1f} % of direct light off (limit {_MOST_OFF_PERCENT:g} %), "
        f"and leaves {crossed.rms_ratio[worst]:.1f} times as much as the middle one (limit {_MOST_RMS_RATIO:g}); "
        f"one in {_MOST_LEFT_OUT} could be left out, if the others agree. "
        "Somebody or something stood in the light or before the camera, light in the room was switched or let in, a "
        "device moved, or the camera set its focus, zoom or gain by itself while they were photographed: keep "
        "everything as it is, switch everything automatic off, and begin a new session"
    )


def first_names(names: Sequence[str]) -> str:
    """Return the first few of them, and how many more there are."""
    return ", ".join(first_of(names, _LISTED))
