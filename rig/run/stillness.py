"""Whether camera, projector and room stood still: white is photographed in most steps, and has to lie on itself."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calibration.arrays import FloatArray
from calibration.structured_light.consistency.displacement import clear_shift_px
from rig.errors import SessionError
from rig.records import Verdict
from rig.session import Session, Step
from rig.stages.correspondence import load_correspondence
from rig.stages.photograph import frame_name
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.stripes.stillness import most_displacement_px

_STEPS = ("gray", "separation", "project")
"""That photograph white; before them a device may move, for curves do not depend on places."""
_WHITES = ("white", "lamp-before", "lamp-after")


@dataclass(frozen=True, slots=True, kw_only=True)
class Displacement:
    """By how much white was displaced from one photograph to a later one, at most."""

    x_px: float
    y_px: float
    before: str
    """The step in which it was photographed ..."""
    after: str
    """... and the one by which it had moved."""

    @property
    def px(self) -> float:
        """Length."""
        return float(np.hypot(self.x_px, self.y_px))


@dataclass(frozen=True, slots=True, eq=False)
class _White:
    """A photograph of projector white."""

    time_s: float
    step: str
    light: FloatArray
    """(H, W) a second of exposure."""
    most: float
    """From here on it is clipped."""


def displacement_of(session: Session) -> Displacement | None:
    """Lay whites of a session's finished steps over each other.

    Each over the one before, for what moves at once, and over the first, for what creeps.

    Returns
    -------
    Displacement or None
        The largest step; None where white was not photographed twice at one size.
    """
    whites = sorted(_whites(session), key=lambda white: white.time_s)
    pairs = [*pairwise(whites), *((whites[0], later) for later in whites[2:])]
    steps = [_between(then, now) for then, now in pairs if then.light.shape == now.light.shape]
    return max(steps, key=lambda step: step.px, default=None)


def stillness_verdicts(session: Session) -> tuple[Verdict, ...]:
    """Return what a finished session is judged by: nothing where white was photographed once only."""
    moved = displacement_of(session)
    if moved is None:
        return ()
    where = f"step {moved.after}" if moved.before == moved.after else f"steps {moved.before} and {moved.after}"
    return (
        Verdict(
            what="standing still: displacement of white between two photographs",
            value=moved.px,
            limit=most_displacement_px(load_correspondence(session)),
            unit="px",
            advice=f"between two photographs of {where} the picture moved by {moved.x_px:+.2f} px to the right and "
            f"{moved.y_px:+.2f} px down: the camera or the projector moved, turned or sank while the session was "
            "photographed, so that its steps do not fit each other; fasten both, and begin a new session",
        ),
    )


def _between(then: _White, now: _White) -> Displacement:
    x_px, y_px = clear_shift_px(now.light, then.light, min(then.most, now.most))
    return Displacement(x_px=x_px, y_px=y_px, before=then.step, after=now.step)


def _whites(session: Session) -> Iterator[_White]:
    radiometric = load_radiometric_calibration(session)
    table = radiometric.table()
    most = float(table[radiometric.saturation_dn].mean())
    for step in _finished(session):
        for name in (frame_name(pattern) for pattern in _WHITES):
            if step.has_frame(name):
                frame = step.load_frame(name)
                light = np.minimum(table[frame.pixels].mean(axis=-1), most) / frame.exposure_s
                yield _White(frame.started_s, step.name, np.asarray(light, np.float64), most / frame.exposure_s)


def _finished(session: Session) -> Iterator[Step]:
    for name in _STEPS:
        try:
            yield session.finished(name)
        except SessionError:
            continue
