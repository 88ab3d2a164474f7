"""Whether photographs of a pattern lie between those of black and white: no stripes are brighter than all light."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import compress

import numpy as np

from calibration.arrays import Frame
from calibration.errors import CalibrationError
from calibration.structured_light.consistency.readings import Slots

_BRIGHT = 0.3
"""Of the contrast of the brightest twentieth: darker places are not counted as lit."""
_BEYOND = 0.2
"""Of the median contrast of lit places: noise and JPEG are less, the edge of a thing or a shadow that moved is more."""
_MOST_BEYOND = 0.02
"""Of the lit places. 22 drawn sets without a fault had none at all, two that were bumped 0.12 and 0.18
(`benchmarks/photographs`, seeds 881021, 882001 to 882120 and 883021)."""
_NAMED = 3


def refuse_beyond_white(frames: Mapping[str, Frame]) -> None:
    """Refuse photographs that are brighter than white, or darker than black, where no pattern can be.

    Parameters
    ----------
    frames : mapping of pattern name to (H, W)
        With `white` and `black`; without either nothing is judged. [dn]

    Raises
    ------
    CalibrationError
        If one is at more than a fiftieth of the lit places; the message names the photographs.
    """
    if "white" not in frames or "black" not in frames:
        return
    white, black = frames["white"].astype(np.float32), frames["black"].astype(np.float32)
    contrast = white - black
    lit = contrast > _BRIGHT * max(float(np.quantile(contrast, 0.95)), 0.0)
    if not lit.any():
        return
    reach, n_lit = np.float32(_BEYOND * np.median(contrast[lit])), int(lit.sum())
    above, below = white + reach, black - reach
    shares = {
        name: int(((frame > above) | (frame < below)).sum()) / n_lit
        for name, frame in frames.items()
        if name not in ("white", "black")
    }
    found = [name for name, share in shares.items() if share > _MOST_BEYOND]
    if not found:
        return
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    raise CalibrationError(
        f"{', '.join(found[:_NAMED])}{more}: brighter than white or darker than black, which no stripes are, at places "
        f"as many as {100 * max(shares.values()):.0f} % of those that the projector lights (limit "
        f"{100 * _MOST_BEYOND:g} %): {_SHARPENED if _finest(frames).issuperset(found) else _CHANGED}"
    )


_CHANGED = (
    "camera or object was bumped, or light or exposure changed in between, or white or black is another picture; check "
    "these two, or photograph all again without touching anything, in the same light, automatics off"
)
_SHARPENED = (
    "the camera sharpens edges, or camera or object was bumped before these; switch sharpening and contrast "
    "enhancement off, or leave these stripes out (finest_bit)"
)


def _finest(frames: Mapping[str, Frame]) -> set[str]:
    """Names of the pictures than which no other of the same axis has finer stripes."""
    coded = [name for name in frames if name.startswith("gray-")]
    return set(compress(coded, Slots.of(coded).finest))
