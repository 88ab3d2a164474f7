"""Whether the lamp stood still: light of projector white in each step of a session that photographs it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.radiometry.flicker import PHASES
from calibration.radiometry.linearity import fit_linearity
from rig.errors import SessionError
from rig.session import Session
from rig.stages.light.exposure import load_exposure
from rig.stages.light.lamp import LampRecord
from rig.stages.photograph import frame_name
from rig.stages.radiometry import load_radiometric_calibration

_WHITES = (("response", "level-255", 1), ("gray", "white", 1), ("separation", "white", 4))
"""Step, picture and frames at the reference exposure."""
_WHOLE_PERIODS = (("response", "level-255", PHASES), ("separation", "white", 2 * PHASES))
"""The same where frames are averaged over the period of room light."""
_LOOKED_AT = (("response", "whites-of-response"), ("separation", "whites-of-separation"), ("compare", "lamp"))
"""Steps that take even drift out of what they photographed, and their records of it."""
_LIT_SHARE = 0.2
"""Of the brightest hundredth: darker pixels see little of the lamp."""


@dataclass(frozen=True)
class LampChange:
    """How projector white changed while a session photographed it."""

    percent: float
    """Brightest over darkest of the frames of white."""
    percent_per_minute: float
    """Slope of the straight line through them as far as it is more than scatter; above 0 gets brighter."""


def lamp_change(session: Session) -> LampChange:
    """Compare the frames of white in the steps `response`, `gray` and `separation`, which are finished."""
    radiometric = load_radiometric_calibration(session)
    table = radiometric.table()
    times_s, lights = [], []
    averaged = load_exposure(session).averaged_hz is not None
    for step_name, picture, repeats in _WHOLE_PERIODS if averaged else _WHITES:
        step = session.finished(step_name)
        for frame in (step.load_frame(frame_name(picture, 0, repeat)) for repeat in range(repeats)):
            times_s.append(frame.started_s)
            lights.append(np.where(frame.pixels < radiometric.saturation_dn, table[frame.pixels], np.nan))
    judged = np.isfinite(lights).all(axis=0)
    judged &= lights[0] > _LIT_SHARE * np.nanquantile(lights[0], 0.99)
    if not judged.any():
        return LampChange(0.0, 0.0)
    levels = np.array([float(np.mean(light[judged], dtype=np.float64)) for light in lights])
    times = np.array(times_s) - times_s[0]
    if averaged:
        levels, times = levels.reshape(-1, PHASES).mean(axis=1), times.reshape(-1, PHASES).mean(axis=1)
    line = fit_linearity(times, levels)
    sure = max(abs(line.slope) - 2 * line.slope_sigma, 0.0) * np.sign(line.slope)
    return LampChange(100 * float(levels.max() / levels.min() - 1), 100 * 60 * float(sure / levels.mean()))


def drift_left_percent(session: Session) -> float | None:
    """Return the most of white that a drift of the lamp may have left in the light of a session's finished steps.

    None where a step has no white around its pictures: of older versions, or replayed from a recording of one.
    """
    left = [_left(session, step, record) for step, record in _LOOKED_AT]
    known = [share for share in left if share is not None]
    return 100 * max(known) if len(known) == len(left) else None


def _left(session: Session, step: str, record: str) -> float | None:
    try:
        return session.finished(step).load_record(record, LampRecord).left
    except SessionError:
        return None
