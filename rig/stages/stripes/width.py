"""Stripes that the lenses blur away are shown again, as wide as the measured contrast asks for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration import StructuredLightCode
from calibration.arrays import BoolArray, Frame
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.patterns import Pattern
from calibration.structured_light.stripe_width import StripeBlur, blur_of_stripes, blur_patterns, times_as_wide
from calibration.structured_light.wider import widened
from rig.plug_ins import find_code
from rig.profile.schema import Profile
from rig.session import Session, Step
from rig.stages.linear_light import RadiometricCalibration
from rig.stages.photograph import frame_name
from rig.stages.stripes.reading import in_light

MOST_SPOILT = 0.05
"""Of the pixels with direct light that have no projector pixel: from here on they are photographed again."""
_MOST_TIMES = 8
_FLATS = ("white", "black")


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownCode:
    """A session's code as it was shown."""

    code: StructuredLightCode
    """With stripes as wide as they were."""
    times: int
    """As wide as those of the code that the profile names."""

    def taken_as(self, pattern: str, part: int | None = None) -> str:
        """Name under which a pattern's photograph was taken: of all lights, or of a part of them (black stays)."""
        wide = f"-wide-{self.times}" if self.times > 1 and pattern not in _FLATS else ""
        again = "" if part is None or pattern == "black" else f"-again-{part}"
        return f"{pattern}{wide}{again}"

    def renamed(self, patterns: Iterable[Pattern]) -> Iterable[Pattern]:
        """Patterns under the names of their photographs."""
        return (Pattern(self.taken_as(pattern.name), pattern.codes) for pattern in patterns)


def as_named(profile: Profile, times: int = 1) -> ShownCode:
    """Return the code that the profile names, with stripes so many times as wide."""
    return ShownCode(code=widened(find_code(profile.patterns.code), times), times=times)


def shown_code(session: Session, gray: Step) -> ShownCode:
    """Return the code with the widest stripes that step `gray` has photographs of."""
    shape = session.profile.projector.shape
    for times in range(_MOST_TIMES, 1, -1):
        wider = as_named(session.profile, times)
        if gray.has_frame(frame_name(wider.taken_as(wider.code.pattern_names(shape)[-1]))):
            return wider
    return as_named(session.profile)


def spoilt(found: Correspondence, lit: BoolArray) -> bool:
    """Whether so many of the pixels that the projector lights were not read that they are worth photographs more."""
    open_ = lit & ~found.valid & ~np.isin(found.reason, (PixelReason.DARK, PixelReason.SATURATED))
    return bool(open_.sum() > MOST_SPOILT * lit.sum())


def stripe_blur(
    frame: Callable[[str], NDArray[np.uint16]], profile: Profile, light: RadiometricCalibration
) -> StripeBlur:
    """Measure how blurred stripes are, from the photographs of :func:`blur_patterns`."""
    reading = in_light((frame("white"), frame("black")), light)
    names = [pattern.name for pattern in blur_patterns(profile.projector.shape)]
    frames: Mapping[str, Frame] = {name: reading.read(frame(name)) for name in names}
    return blur_of_stripes(frames, reading.white, reading.black, reading.noise_limit)


def times_wanted(code: StructuredLightCode, found: Correspondence, blur: StripeBlur) -> int:
    """Choose how many times as wide stripes have to be for what was not read; 1 where blur is not the cause."""
    return times_as_wide(code, blur.sigma_px) if spoilt(found, blur.lit) else 1
