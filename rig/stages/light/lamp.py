"""How bright the lamp was while pictures were photographed, by white before and after them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calibration.structured_light.patterns import Pattern, flat
from rig.errors import NotRecorded
from rig.records import Record
from rig.session import Step
from rig.stages.linear_light import LightImage, RadiometricCalibration, merge_exposures, merge_raw_exposures
from rig.stages.photograph import ExposureBracket, frame_name
from rig.terminal import OnStep

_BEFORE, _AFTER = "lamp-before", "lamp-after"
_SIGMAS, _LEAST_CHANGE = 4.0, 5e-4
"""From so many of its own deviations on, and from so much of white, a change is a lamp's: an eighth of a grey level."""
_PARTS = 16
"""Of the picture, whose ratios of white tell by their scatter how well the ratio of all is known."""
_LIT_SHARE = 0.2
"""Of the brightest hundredth: darker pixels see little of the lamp."""


@dataclass(frozen=True, kw_only=True)
class LampRecord(Record):
    """Light of white while pictures were photographed, over that of the white that the model is of."""

    times_s: tuple[float, ...]
    shares: tuple[float, ...]
    """Before, perhaps amid, and after the pictures; 1 where no change stands out of its noise."""

    @property
    def left(self) -> float | None:
        """Most of white that is left where even drift is taken out: what changed from one look to the next.

        So much where it changed all at once, just beside a look; nothing where it changed evenly. None where nobody
        looked.
        """
        if self.times_s[-1] <= self.times_s[0]:
            return None
        return float(np.abs(np.diff(self.shares)).max())

    def at(self, time_s: float) -> float:
        """Return the share at a time; 1 before the first and after the last, for nobody knows what the lamp did."""
        inside = self.times_s[0] <= time_s <= self.times_s[-1]
        return float(np.interp(time_s, self.times_s, self.shares)) if inside else 1.0


_STEADY = LampRecord(times_s=(0.0, 0.0), shares=(1.0, 1.0))
"""What nobody looked at."""


N_WHITES = 2
"""Of :func:`take_between_whites`."""


def take_between_whites(
    take: Callable[[Sequence[Pattern]], None], patterns: Sequence[Pattern], shape: tuple[int, int], on_step: OnStep
) -> None:
    """Photograph patterns between two whites; a recording of before there were any gives the patterns alone."""
    before, after = flat(shape, 255, _BEFORE), flat(shape, 255, _AFTER)
    take([before, *patterns, after] if _is_taken(partial(take, [before]), on_step) else patterns)


def take_before_white(
    take: Callable[[Sequence[Pattern]], None], patterns: Sequence[Pattern], shape: tuple[int, int], on_step: OnStep
) -> None:
    """Photograph patterns, then white; a recording of before there was one gives the patterns alone."""
    take(patterns)
    _is_taken(partial(take, [*patterns, flat(shape, 255, _AFTER)]), on_step)


def _is_taken(take: Callable[[], None], on_step: OnStep) -> bool:
    """Take what a recording may not have; tell, and say so, where it has not."""
    try:
        take()
    except NotRecorded:
        on_step("the recording has no white around its pictures: a drift of the lamp is left in them", 1, 1)
        return False
    return True


def lamp_of(step: Step, bracket: ExposureBracket, radiometric: RadiometricCalibration, white: LightImage) -> LampRecord:
    """Return what the whites of a step say, held against the white (H, W, B) that the model is of.

    A step that was replayed from a recording without whites says nothing: its pictures stay as they are.
    """
    if not step.has_frame(frame_name(_AFTER)):
        return _STEADY
    shares = [lamp_share(merge_exposures(step, name, bracket, radiometric), white) for name in (_BEFORE, _AFTER)]
    before_s, after_s = (time_of(step, name, bracket) for name in (_BEFORE, _AFTER))
    return LampRecord(times_s=(before_s, after_s), shares=(shares[0], shares[1]))


def lamp_since(
    step: Step, bracket: ExposureBracket, radiometric: RadiometricCalibration, began: tuple[LightImage, float]
) -> LampRecord:
    """Return what :func:`take_before_white` says, held against the white that the step began with, and its time.

    Both are as they were seen: of a mosaic one number a pixel.
    """
    if not step.has_frame(frame_name(_AFTER)):
        return _STEADY
    share = lamp_share(merge_raw_exposures(step, _AFTER, bracket, radiometric), began[0])
    return LampRecord(times_s=(began[1], time_of(step, _AFTER, bracket)), shares=(1.0, share))


def lamp_around(
    step: Step, bracket: ExposureBracket, radiometric: RadiometricCalibration, amid: tuple[LightImage, float]
) -> LampRecord:
    """Return what the whites of :func:`take_between_whites` say beside a white amid the pictures, and its time."""
    if not step.has_frame(frame_name(_AFTER)):
        return _STEADY
    ends = lamp_of(step, bracket, radiometric, amid[0])
    (before_s, after_s), (before, after) = ends.times_s, ends.shares
    return LampRecord(times_s=(before_s, amid[1], after_s), shares=(before, 1.0, after))


def time_of(step: Step, pattern: str, bracket: ExposureBracket) -> float:
    """Return the mean time of a pattern's frames."""
    names = [frame_name(pattern, k, r) for k in range(len(bracket.exposures_s)) for r in range(bracket.repeats)]
    return float(np.mean([step.load_frame(name).started_s for name in names]))


def lamp_share(now: LightImage, then: LightImage) -> float:
    """Return the light of white over that of an earlier white, (H, W, B) each; 1 where no change is more than noise."""
    light, before = now.value.mean(axis=-1), then.value.mean(axis=-1)
    lit = ~now.any_saturated & ~then.any_saturated & (before > _LIT_SHARE * np.quantile(before, 0.99))
    rows = np.array_split(np.flatnonzero(lit), _PARTS)
    if len(rows[-1]) == 0:
        return 1.0
    parts = np.array([light.ravel()[part].sum() / before.ravel()[part].sum() for part in rows])
    sigma = float(parts.std(ddof=1) / np.sqrt(_PARTS))
    share = float(light[lit].sum() / before[lit].sum())
    return share if abs(share - 1) > max(_SIGMAS * sigma, _LEAST_CHANGE) else 1.0


def without_drift(image: LightImage, share: float) -> LightImage:
    """Return the light that the lamp would have made had it been as bright as for the model's white."""
    if share == 1.0:
        return image
    scale = np.float32(1 / share)
    return replace(image, value=image.value * scale, variance=image.variance * scale**2)
