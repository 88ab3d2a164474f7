"""Whether camera and projector stood still among a code's pictures: what is white later has to lie on white.

White is photographed before the patterns. A pattern and its inverse make white again, so that each pair of them tells;
after patterns without inverses white is photographed once more. Stripes before and after a movement are of two places,
and what is made of them is wrong somewhere: walls that are not square, a map that folds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.light.blur import stretch
from calibration.structured_light.consistency.displacement import clear_shift_px
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.patterns import flat
from rig.errors import SessionError
from rig.stages.stripes.reading import INVERSE, FrameReading, has_inverses, in_light
from rig.stages.stripes.showing import CodePhotographs
from rig.stages.stripes.width import ShownCode, as_named

_MOST_PX = 0.5
"""Of the camera or of the projector, whichever pixels are larger: on ci-tiny a camera that moved by 0.32 px among the
checkers left direct light within 0.4 %, by 2.2 px 4 % off."""

_AFTER = "white-after"


def most_displacement_px(correspondence: Correspondence) -> float:
    """Return by how many camera pixels a picture may be displaced while it is photographed."""
    squares = stretch(correspondence).sum(axis=-1) / 2
    width_px = float(np.median(squares[squares > 0]) ** -0.5) if (squares > 0).any() else 1.0
    return _MOST_PX * max(1.0, width_px)


def photograph_white_after(by: CodePhotographs) -> None:
    """Photograph white once more, after patterns without inverses: these do not tell whether they were displaced."""
    shape = by.profile.projector.shape
    if whites_after(as_named(by.profile).code.pattern_names(shape)):
        by.take((flat(shape, 255, _AFTER),))


def whites_after(patterns: Sequence[str]) -> int:
    """Return how many frames that takes, by the names of a code's patterns."""
    return int(not has_inverses(patterns))


def read_standing(by: CodePhotographs, shown: ShownCode) -> Correspondence:
    """Decode a code's photographs, of which none may be displaced.

    Raises
    ------
    CalibrationError
        As :func:`rig.stages.stripes.reading.read_code`; or if the camera, the projector or the room moved.
    """
    try:
        found = by.read(shown)
    except CalibrationError:
        _refuse_movement(by, shown, _MOST_PX)
        raise
    _refuse_movement(by, shown, most_displacement_px(found))
    return found


def _refuse_movement(by: CodePhotographs, shown: ShownCode, most_px: float) -> None:
    """Look at what was white last, and where that is displaced for the first that is: what moves stays where it is."""
    whites = _Whites(by, shown)
    last = len(whites.names) - 1
    x_px, y_px = whites.displacement_px(last)
    if np.hypot(x_px, y_px) <= most_px:
        return
    before, after = 0, last
    while after - before > 1:
        middle = (before + after) // 2
        moved = np.hypot(*whites.displacement_px(middle)) > most_px
        before, after = (before, middle) if moved else (middle, after)
    raise CalibrationError(
        f"the picture moved by {x_px:+.1f} px to the right and {y_px:+.1f} px down between {whites.names[before]} and "
        f"{whites.names[after]}, the limit is {most_px:.1f} px: the camera or the projector moved, turned or sank "
        "while the stripes were photographed, so that these do not fit each other; fasten both, and begin a new session"
    )


class _Whites:
    """White, and what else is white among the photographs of a code, in the order in which they were taken."""

    def __init__(self, by: CodePhotographs, shown: ShownCode) -> None:
        self._by, self._frame = by, by.of(shown)
        self._reading: FrameReading = in_light((by.frame("white"), by.frame("black")), by.radiometric)
        patterns = shown.code.pattern_names(by.profile.projector.shape)
        pairs = [name for name in patterns if not name.endswith(INVERSE)]
        self.names = ("white", *(pairs if has_inverses(patterns) else self._after()))

    def displacement_px(self, index: int) -> tuple[float, float]:
        """To the right and down, against white."""
        white = self._reading.white.astype(np.float64)
        return clear_shift_px(self._light(self.names[index]), white, self._reading.saturation)

    def _after(self) -> tuple[str, ...]:
        """White after the patterns; sessions of earlier versions have none."""
        try:
            self._by.frame(_AFTER)
        except SessionError:
            return ()
        return (_AFTER,)

    def _light(self, name: str) -> FloatArray:
        read = self._reading.read
        if name in ("white", _AFTER):
            return read(self._by.frame(name)).astype(np.float64)
        both = (read(self._frame(one)).astype(np.float64) for one in (name, f"{name}{INVERSE}"))
        return np.asarray(sum(both) - self._reading.black)
