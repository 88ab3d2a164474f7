"""What is wrong with the photographs of a pose, before they are read: their order, movement, light that changed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calibration.errors import CalibrationError
from calibration.lenses.detection import Detection
from calibration.structured_light.consistency.check import check_gray_frames
from calibration.structured_light.consistency.still import movements
from calibration.structured_light.consistency.unsteady import with_sign
from rig.devices.replay.photographs import Photograph
from rig.terminal.line import first_of

_SUM_CHANGE = 0.1
"""Of the light of a pattern and its inverse together, from pair to pair: more is an exposure that changed."""
_FINE_BITS = 3
"""Of a Gray code: a camera's tone curve makes blurred fine stripes brighter than coarse ones, by up to a half."""
_NAMED = 4
"""Photographs that a message names."""


def fault_of_photographs(pictures: Mapping[str, Photograph], found: Detection, *, limit_dn: float, code: str) -> str:
    """Return what is wrong with the photographs of a pose, and what to do; empty: nothing.

    Parameters
    ----------
    pictures : mapping of pattern name to (H, W)
        As they are named. [dn]
    found
        The board in them.
    limit_dn : float
        By which a pattern and its inverse have to differ.
    code
        That the projector showed.
    """
    order = _other_order(pictures, limit_dn) if code == "gray" else ""
    if order:
        return order
    fault = _moved(pictures) or _changed_light(pictures, found)
    return with_sign(pictures, fault) if fault else ""


def _other_order(pictures: Mapping[str, Photograph], limit_dn: float) -> str:
    """Which photographs are not what they are called."""
    coded = {name: picture for name, picture in pictures.items() if name.startswith("gray-")}
    try:
        checked = check_gray_frames(coded, 2 * limit_dn)
    except CalibrationError as error:
        return with_sign(pictures, str(error))
    if checked.as_named:
        return ""
    changed = [f"{name} shows {pattern}" for pattern, name in checked.readings[0].items() if name != pattern]
    return (
        f"the photographs are not what they are called: {', '.join(first_of(changed, _NAMED))}, as it seems; give them "
        "their right names, or photograph this pose again"
    )


def _moved(pictures: Mapping[str, Photograph]) -> str:
    """Between which photographs of a view the camera, or the board, moved."""
    names = [name for name in pictures if f"{name}-inverse" in pictures]
    # The widest stripes first: their pairs add up to the board whatever the blur.
    names.sort(key=lambda name: [part if not part.isdigit() else f"{99 - int(part):02d}" for part in name.split("-")])
    found = movements([(pictures[name], pictures[f"{name}-inverse"]) for name in names])
    if not found:
        return ""
    worst = max(found, key=lambda movement: movement.step_px)
    taken = [name for one in names for name in (one, f"{one}-inverse")]
    return (
        f"the picture moves by {worst.step_px:.0f} px between {taken[worst.before]} and {taken[worst.after]}: board or "
        "camera was touched; photograph this pose again with both standing firm"
    )


def _changed_light(pictures: Mapping[str, Photograph], found: Detection) -> str:
    """Which pair of a pattern and its inverse has another amount of light than the others."""
    fine = tuple(f"gray-{axis}-{bit:02d}" for axis in ("column", "row") for bit in range(_FINE_BITS))
    pairs = [name for name in pictures if f"{name}-inverse" in pictures and name not in fine]
    if len(pairs) < 3:
        return ""
    left, top = np.maximum(np.floor(found.xy_px.min(axis=0)), 0).astype(int)
    right, bottom = np.ceil(found.xy_px.max(axis=0)).astype(int) + 1
    window = np.s_[top:bottom, left:right]
    sums = {
        name: float(
            pictures[name][window].mean(dtype=np.float64) + pictures[f"{name}-inverse"][window].mean(dtype=np.float64)
        )
        for name in pairs
    }
    usual = float(np.median(list(sums.values())))
    worst = max(sums, key=lambda name: abs(sums[name] - usual))
    change = sums[worst] / max(usual, 1e-9) - 1
    if abs(change) <= _SUM_CHANGE:
        return ""
    return (
        f"the light of {worst} and its inverse is {100 * change:+.0f} % off the other pairs', the limit is "
        f"{100 * _SUM_CHANGE:.0f} %: switch the camera's automatics off (exposure, gain, white balance), and the "
        "projector's dynamic contrast"
    )
