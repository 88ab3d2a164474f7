"""Whether the lamp stood still: light of projector white in each step of a session that photographs it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import BoolArray, Float32Array, FloatArray
from calibration.light.evenness import part_shares
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
_AROUND = (
    *(("response", "lamp-before"), ("response", "lamp-after"), ("separation", "lamp-after")),
    *(("project", "lamp-before"), ("project", "lamp-after")),
)
"""Whites that older sessions do not have."""
_LOOKED_AT = (("response", "whites-of-response"), ("separation", "whites-of-separation"), ("compare", "lamp"))
"""Steps that take even drift out of what they photographed, and their records of it."""
_LIT_SHARE = 0.2
"""Of the brightest hundredth: darker pixels see little of the lamp."""
_PARTS = 8
"""Along each side of the picture."""
_UNEVEN, _LEAST_PERCENT = 0.5, 1.5
"""Of the change of all white, or of so much: a lamp that warms up changes its corners by a tenth more than its middle,
and noise changes parts of small pictures of eight bits by 0.3 %."""


@dataclass(frozen=True)
class LampChange:
    """How projector white changed while a session photographed it."""

    percent: float
    """Brightest over darkest of the frames of white."""
    percent_per_minute: float
    """Slope of the straight line through them as far as it is more than scatter; above 0 gets brighter."""
    here_percent: float = 0.0
    """Brightest over darkest where white changed least, of most parts of the picture ..."""
    there_percent: float = 0.0
    """... and where it changed most."""

    @property
    def is_uneven(self) -> bool:
        """Whether parts of the picture changed far more than others, as they do not for a lamp."""
        return self.there_percent - self.here_percent > _UNEVEN * max(abs(self.percent), _LEAST_PERCENT)


def lamp_change(session: Session) -> LampChange:
    """Compare the frames of white in the steps that photograph it; `response`, `gray` and `separation` are finished."""
    averaged = load_exposure(session).averaged_hz is not None
    times, lights = _whites(session, averaged=averaged)
    judged = np.isfinite(lights).all(axis=0)
    judged &= lights[0] > _LIT_SHARE * np.nanquantile(lights[0], 0.99)
    if not judged.any():
        return LampChange(0.0, 0.0)
    if averaged:
        times = times.reshape(-1, PHASES).mean(axis=1)
        lights = lights.reshape(-1, PHASES, *lights.shape[1:]).mean(axis=1)
    levels = np.array([float(np.mean(light[judged], dtype=np.float64)) for light in lights])
    line = fit_linearity(times - times[0], levels)
    sure = max(abs(line.slope) - 2 * line.slope_sigma, 0.0) * np.sign(line.slope)
    here, there = _by_parts(lights[int(levels.argmax())], lights[int(levels.argmin())], judged)
    return LampChange(
        percent=100 * float(levels.max() / levels.min() - 1),
        percent_per_minute=100 * 60 * float(sure / levels.mean()),
        here_percent=here,
        there_percent=there,
    )


def _whites(session: Session, *, averaged: bool) -> tuple[FloatArray, Float32Array]:
    """(N,) times of the frames of white, and (N, H, W, B) their light in a second of exposure; NaN where clipped."""
    radiometric = load_radiometric_calibration(session)
    table = radiometric.table()
    taken = []
    for step_name, picture, repeats in _WHOLE_PERIODS if averaged else _WHITES:
        step = session.finished(step_name)
        taken += [step.load_frame(frame_name(picture, 0, repeat)) for repeat in range(repeats)]
    for step_name, picture in () if averaged else _AROUND:
        step = session.finished(step_name)
        taken += [step.load_frame(frame_name(picture))] if step.has_frame(frame_name(picture)) else []
    lights = [
        np.where(frame.pixels < radiometric.saturation_dn, table[frame.pixels] / frame.exposure_s, np.nan)
        for frame in taken
    ]
    return np.array([frame.started_s for frame in taken]), np.array(lights, dtype=np.float32)


def _by_parts(brightest: Float32Array, darkest: Float32Array, judged: BoolArray) -> tuple[float, float]:
    """How much brighter a picture (H, W, B) is than another, in per cent, in parts where it is least and most so."""
    bright, dark = (np.where(judged, light, 0.0).sum(axis=-1, dtype=np.float64) for light in (brightest, darkest))
    percent = 100 * (part_shares(bright, dark, np.asarray(judged.any(axis=-1)), parts=_PARTS) - 1)
    return float(np.quantile(percent, 0.1)), float(np.quantile(percent, 0.9))


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
