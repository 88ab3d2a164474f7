"""A code's pictures are photographed, and once more with wider stripes where the lenses blur its own away.

A session and `rig check` do it alike, so that both read what there is to read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray
from calibration.errors import CalibrationError
from calibration.radiometry.response import Response
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.fewer_lights import filled_in, lights_for, with_lights
from calibration.structured_light.patterns import Pattern, flat
from calibration.structured_light.stripe_width import blur_patterns
from rig.files.channels import one_or_all
from rig.profile.schema import Profile
from rig.records import Verdict
from rig.stages.linear_light import Codes, RadiometricCalibration, channel_codes
from rig.stages.stripes.reading import INVERSE, has_inverses, in_dn, read_code
from rig.stages.stripes.width import ShownCode, as_named, spoilt, stripe_blur, times_wanted
from rig.terminal import OnStep

_DIRECT = 2.0
"""Noise limits by which a pattern and its inverse differ at the median where the projector's own light is seen."""
_PARTS, _MORE_PARTS = 2, 4
"""In which the rest of the projector's picture is lit then; more where less than half of the lit pixels was read."""
_EXTREMES = (0, 255)
"""Codes that are shown as they are: black and white."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CodePhotographs:
    """How a code's pictures are photographed, and read again."""

    profile: Profile
    radiometric: RadiometricCalibration
    """Of the camera; its projector's curve is not asked."""
    take: Callable[[Iterable[Pattern]], None]
    """Photographs pictures whose codes are linear light."""
    frame: Callable[[str], NDArray[np.uint16]]
    """Gives the (H, W, B) photograph that was taken under a name. [dn]"""

    def of(self, shown: ShownCode, part: int | None = None) -> Callable[[str], NDArray[np.uint16]]:
        """Return what gives a pattern's photograph: with all lights on, or of a part with fewer."""
        return lambda name: self.frame(shown.taken_as(name, part))

    def read(self, shown: ShownCode, part: int | None = None) -> Correspondence:
        """Decode what was photographed."""
        return read_code(shown.code, self.of(shown, part), self.profile.projector.shape, self.radiometric)


def photograph_code(by: CodePhotographs, on_step: OnStep) -> ShownCode | None:
    """Photograph white, black, and the patterns of the code; these with wider stripes, too, where they are too fine.

    Returns
    -------
    ShownCode or None
        As it was shown last, if much was open after the first time; None where all is well, or nothing can be read.
    """
    shape, named = by.profile.projector.shape, as_named(by.profile)
    by.take((flat(shape, 255, "white"), flat(shape, 0, "black")))
    by.take(named.code.patterns(shape))
    found = _spoilt_reading(by, named)
    if found is None:
        return None
    by.take(blur_patterns(shape))
    blur = stripe_blur(by.frame, by.profile, by.radiometric)
    times = times_wanted(named.code, found, blur)
    if times == 1:
        return named
    on_step(f"stripes {times} times as wide, for the picture is blurred by {blur.sigma_px:.1f} px", 1, 1)
    wider = as_named(by.profile, times)
    by.take(wider.renamed(wider.code.patterns(shape)))
    return wider


def _spoilt_reading(by: CodePhotographs, shown: ShownCode) -> Correspondence | None:
    """What the code reads where many of the pixels that have to be lit stay open; else None."""
    try:
        found = by.read(shown)
    except CalibrationError:
        return None  # who decodes says what is wrong
    direct = _direct_light(by, shown)
    return found if spoilt(found, found.reason != PixelReason.DARK if direct is None else direct) else None


def photograph_in_parts(by: CodePhotographs, shown: ShownCode) -> int:
    """Show the code again on the pixels that are still open alone, part by part, where light of other walls spoilt it.

    Returns
    -------
    int
        Parts; 0 where little is spoilt.
    """
    shape, white = by.profile.projector.shape, flat(by.profile.projector.shape, 255, "white")
    parts = _lights_again(by, shown)
    for part, lights in enumerate(parts):
        again = with_lights(chain((white,), shown.code.patterns(shape)), lights)
        by.take(Pattern(shown.taken_as(pattern.name, part), pattern.codes) for pattern in again)
    return len(parts)


def read_in_parts(by: CodePhotographs, first: Correspondence, shown: ShownCode) -> Correspondence:
    """Fill in what the pictures of :func:`photograph_in_parts` say."""
    found = first
    for part, lights in enumerate(lights_for(first, _parts(first))):
        found = filled_in(found, by.read(shown, part), lights)
    return found


def _lights_again(by: CodePhotographs, shown: ShownCode) -> list[BoolArray]:
    """Projector pixels to light when the patterns are shown again, part by part; none where little is spoilt."""
    by = replace(by, frame=cache(by.frame))
    direct = _direct_light(by, shown)
    if direct is None:
        return []
    try:
        first = by.read(shown)
    except CalibrationError:
        return []  # who decodes says what is wrong
    return lights_for(first, _parts(first)) if spoilt(first, direct) else []


def _parts(first: Correspondence) -> int:
    lit = first.reason != PixelReason.DARK
    return _PARTS if 2 * first.valid.sum() >= lit.sum() else _MORE_PARTS


def _direct_light(by: CodePhotographs, shown: ShownCode) -> BoolArray | None:
    """(H, W) pixels that the projector lights itself: there patterns differ from their inverses by more than noise.

    What comes from other walls is much the same for a pattern of stripes and for its inverse. None for codes without
    inverses.
    """
    names, frame = shown.code.pattern_names(by.profile.projector.shape), by.of(shown)
    if not has_inverses(names):
        return None
    reading = in_dn((frame("white"), frame("black")), by.radiometric)
    pairs = [name for name in names if f"{name}{INVERSE}" in names]
    change = [
        np.abs(np.subtract(reading.read(frame(name)), reading.read(frame(f"{name}{INVERSE}")), dtype=np.float32))
        for name in pairs
    ]
    return np.asarray(np.median(change, axis=0) > _DIRECT * np.asarray(reading.noise_limit))


def as_light(patterns: Iterable[Pattern], curves: Callable[[], Sequence[Response]]) -> Iterator[Pattern]:
    """Yield patterns in the codes that make their light on a projector: a code's grey levels are linear light.

    Parameters
    ----------
    patterns
        Their codes are linear light, 255 is white.
    curves
        Gives the projector's response by channel; asked only once a pattern has grey levels.
    """
    table: Codes | None = None
    for pattern in patterns:
        if np.isin(pattern.codes, _EXTREMES).all():
            yield pattern
            continue
        if table is None:
            table = _code_of_light(curves())
        yield Pattern(pattern.name, one_or_all(table[np.atleast_3d(pattern.codes), np.arange(table.shape[1])]))


def _code_of_light(projector: Sequence[Response]) -> Codes:
    """(256, channels) codes that make 0 … 255 parts of white's light."""
    levels = np.broadcast_to(np.arange(256)[:, None, None] / 255, (256, 1, len(projector)))
    return channel_codes(projector, levels, seed=None).reshape(256, -1)


def out_of_focus(times: int) -> str:
    """Say what wider stripes mean and what to do, as the end of a message; empty where the code's own were read.

    Parameters
    ----------
    times
        As wide as they were shown.
    """
    if times == 1:
        return ""
    return (
        f"the picture is out of focus for its code: the stripes could only be read {times} times as wide, and places "
        'are that much rougher; focus the projector on the walls, then the camera; code = "long-run" has stripes that '
        "bear more blur than those of xor-02 or xor-04"
    )


@contextmanager
def blaming_focus(times: int) -> Iterator[None]:
    """Name focus in what geometry is refused for, where stripes had to be wider: rough places look like bent walls.

    Parameters
    ----------
    times
        As wide as they were shown.

    Raises
    ------
    CalibrationError
        What was raised, after the likelier cause.
    """
    try:
        yield
    except CalibrationError as error:
        if times == 1:
            raise
        blamed = CalibrationError(f"{out_of_focus(times)}. With places as they are: {error}")
        for note in getattr(error, "__notes__", ()):
            blamed.add_note(note)
        raise blamed from error


def focus_verdicts(times: int) -> tuple[Verdict, ...]:
    """Return how wide stripes had to be, and what to do; nothing in focus. What it costs has limits of its own."""
    if times == 1:
        return ()
    what = "stripes of the code, wider than usual"
    return (Verdict(what=what, value=float(times), unit="times", advice=out_of_focus(times)),)
