"""What photographs of a code show of light, exposure and timing that did not stay: the likely cause of a refusal.

None of these is proof that a set cannot be read, and most sets with a little of them can. They are asked once something
does not fit, so that the refusal says what a person would see in the photographs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import compress, pairwise

import cv2
import numpy as np

from calibration.arrays import BoolArray, Float32Array, Frame
from calibration.structured_light.consistency.readings import Slots
from calibration.structured_light.consistency.still import laid_over

_INVERSE = "-inverse"
_PLACES = 60_000
_LEAST_PHOTOGRAPHS = 3
_BRIGHT = 0.3
"""Of the contrast of the brightest twentieth: more is lit."""
_UNLIT, _AROUND = 0.15, 5
"""Of what the liveliest twentieth changes by from photograph to photograph: less is not reached by the projector; and
over so many pixels, of which some lie in stripes that stay."""
_ENOUGH = 0.02
"""Of the picture, that has to be unlit before it tells of light."""
_BRIGHTER, _MOST_BRIGHTER = 0.05, 0.1
"""Share of a level, above noise and JPEG, by which black may be brighter than white, and of the picture."""
_DARKEST = 0.01
"""Of the brightest value: darker places have no level to compare."""
_WANDERS, _BY_STEP = 0.1, 0.7
"""Of the level where the projector does not reach; and of that range, in one step."""
_FEW_BITS = 3
"""Coarsest pictures of an axis, of which any share may be lit."""
_SHARP = 0.6
"""Of the contrast, in which pairs differ whose sum neither blur nor a tone curve changes."""
_GHOST, _WIDE_BITS = 0.06, 5
"""Share of the picture before that a photograph shows as well, and coarsest pictures of an axis that are asked."""
_OFF, _CLEAN, _TORN = 0.3, 0.05, 0.2
"""Of the contrast, by which a pair does not add up to the others' sum; shares of lit places on both sides of a tear."""
_LINES, _LEAST_SIDE = 24, 0.05
"""Bands of lines among which a tear is sought, and share of the lit places that both its sides have."""
_BANDS = (0.03, 0.15)
"""Of the level: standard deviation of a photograph's brightness along its lines; less is a hand, more another picture.
"""
_MOSTLY = 2.0
"""Times as much as across its lines."""
_AT_ENDS, _CREPT_PX = 2, 0.7
"""Pairs at the beginning and at the end, and what lies between them. Of 80 drawn sets that stood still none was said to
have moved (`benchmarks/photographs`, seeds 891000 to 891079)."""


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class _Thinned:
    """Photographs at every so many-th pixel."""

    frames: Mapping[str, Float32Array]
    lit: BoolArray
    unlit: BoolArray
    dark: Float32Array
    """The least that any photograph shows."""
    contrast: Float32Array
    most: float
    """Brightest value of all."""
    step_px: int

    @property
    def pairs(self) -> list[str]:
        """Patterns that have an inverse."""
        return [name for name in self.frames if f"{name}{_INVERSE}" in self.frames]

    def total(self, name: str) -> Float32Array:
        """A pattern and its inverse together."""
        return self.frames[name] + self.frames[f"{name}{_INVERSE}"]

    def sharpness(self, name: str) -> float:
        """Share of the contrast in which a pattern and its inverse differ."""
        apart = np.abs(self.frames[name] - self.frames[f"{name}{_INVERSE}"])
        return float(apart[self.lit].sum() / self.contrast[self.lit].sum())


def signs_of_unsteadiness(frames: Mapping[str, Frame]) -> tuple[str, ...]:
    """Say what in photographs of a Gray code was not steady from one to the next.

    Parameters
    ----------
    frames : mapping of pattern name to (H, W)
        In the order in which they were taken, as far as known, but that inverses are taken to follow their patterns:
        `gray-AXIS-BIT`, with inverses or without, `white` and `black` where there are. [dn]

    Returns
    -------
    tuple of str
        A phrase for each sign, the surest first; photographs are named by their patterns. Empty where nothing shows.
    """
    seen = _thinned(frames)
    if seen is None:
        return ()
    sharp = [name for name in seen.pairs if seen.sharpness(name) > _SHARP]
    even = _even(seen, sharp)
    light = [] if even is None else sorted((_banded(even), _wandering(even)), reverse=True)
    signs = (_automatic(seen), _ghosts(seen), _torn(seen), *(sign for _, sign in light), _crept(seen, sharp))
    return tuple(sign for sign in signs if sign)


def with_sign(frames: Mapping[str, Frame], fault: str) -> str:
    """Put the surest sign of unsteadiness, if there is one, before what does not fit."""
    return "; by that or not, ".join((*signs_of_unsteadiness(frames)[:1], fault))


def _thinned(frames: Mapping[str, Frame]) -> _Thinned | None:
    n_coded = sum(name.startswith("gray-") for name in frames)
    if n_coded < _LEAST_PHOTOGRAPHS or len({frame.shape for frame in frames.values()}) > 1:
        return None
    step = max(1, int(np.sqrt(next(iter(frames.values())).size / _PLACES)))
    few = {name: frames[name][::step, ::step].astype(np.float32) for name in _in_time(frames)}
    stack = np.stack(list(few.values()))
    dark = stack.min(axis=0)
    contrast = stack.max(axis=0) - dark
    bright = float(np.quantile(contrast, 0.95))
    lit = contrast > _BRIGHT * bright
    coded = stack[[name.startswith("gray-") for name in few]]
    # From one photograph to the next: light that comes on once, or fades, is no stripe.
    change = cv2.blur(np.abs(np.diff(coded, axis=0)).mean(axis=0), (_AROUND, _AROUND))
    unlit = (change < _UNLIT * np.quantile(change, 0.95)) & (np.median(stack, axis=0) > _DARKEST * stack.max())
    if not (bright > 0 and lit.any()):
        return None
    return _Thinned(
        frames=few, lit=lit, unlit=unlit, dark=dark, contrast=contrast, most=float(stack.max()), step_px=step
    )


def _in_time(frames: Mapping[str, Frame]) -> list[str]:
    """Names with each inverse after its pattern, as people show them, however they are listed."""
    plain = [name for name in frames if not name.endswith(_INVERSE)]
    return [name for each in plain for name in (each, f"{each}{_INVERSE}") if name in frames]


def _automatic(seen: _Thinned) -> str:
    """More light never makes a place darker."""
    white, black = seen.frames.get("white"), seen.frames.get("black")
    if white is None or black is None:
        return ""
    share = float((black > (1 + _BRIGHTER) * white + _DARKEST * white.max()).mean())
    if share < _MOST_BRIGHTER:
        return ""
    return (
        f"black is brighter than white at {100 * share:.0f} % of the picture: the exposure was automatic, or other "
        "light came on; fix exposure and gain"
    )


def _torn(seen: _Thinned) -> str:
    """A pair that adds up to the others' sum above some line, and does not below it, or the other way round.

    Of wide stripes a whole wrong picture does so, too.
    """
    names = seen.pairs
    if len(names) < _LEAST_PHOTOGRAPHS:
        return ""
    usual = np.median([seen.total(name) for name in names], axis=0)
    for name in _fine(names):
        off = np.abs(seen.total(name) - usual) > _OFF * seen.contrast
        for which, turned in (("line", False), ("column", True)):
            sides = _sides(*((off.T, seen.lit.T) if turned else (off, seen.lit)))
            if sides is not None:
                return (
                    f"{name} and {name}{_INVERSE} add up to the light of all others on one side of a {which} "
                    f"{100 * sides:.0f} % down the picture and not on the other: the projector changed while the "
                    "camera read its lines; wait longer after each pattern"
                )
    return ""


def _sides(off: BoolArray, lit: BoolArray) -> float | None:
    """Where a picture is torn, as a share of its height; None where it is not."""
    halves = np.array_split(np.arange(off.shape[1]), 2)
    counts = np.array(
        [[[_count(one[:, half], rows) for half in halves] for one in (off & lit, lit)] for rows in _bands(len(off))]
    )
    above = np.cumsum(counts, axis=0)
    best, at = 0.0, None
    for k in range(_LINES - 1):
        sides = above[k], above[-1] - above[k]
        if min(side[1].min() for side in sides) < _LEAST_SIDE * above[-1, 1].sum():
            continue
        calm, wild = sorted((side[0] / side[1] for side in sides), key=lambda share: float(share.sum()))
        apart = float(wild.min() - calm.max())
        if calm.max() < _CLEAN and wild.min() > _TORN and apart > best:
            best, at = apart, (k + 1) / _LINES
    return at


def _bands(height: int) -> list[slice]:
    ends = np.linspace(0, height, _LINES + 1).astype(int)
    return [slice(first, max(end, first + 1)) for first, end in pairwise(ends)]


def _count(some: BoolArray, rows: slice) -> int:
    return int(some[rows].sum())


def _ghosts(seen: _Thinned) -> str:
    """A photograph that was exposed while the projector changed shows the picture before as well."""
    shares = [share for axis in ("column", "row") for share in _ghosts_of(seen, axis)]
    share = abs(float(np.median(shares))) if len(shares) >= _LEAST_PHOTOGRAPHS else 0.0
    if share < _GHOST:
        return ""
    return (
        f"photographs also show the pattern before, by {100 * share:.0f} % of the contrast: the projector changed "
        "while they were exposed; wait longer after each pattern"
    )


def _ghosts_of(seen: _Thinned, axis: str) -> list[float]:
    """How much brighter the dark stripes of each wide pattern are where the one before, or its inverse, is lit."""
    names = sorted((n for n in seen.frames if n.startswith(f"gray-{axis}-") and not n.endswith(_INVERSE)), reverse=True)
    dark, contrast = seen.dark[seen.lit], seen.contrast[seen.lit]
    shares = [(seen.frames[name][seen.lit] - dark) / contrast for name in names[: _WIDE_BITS + 1]]
    found = []
    for there, here in pairwise(shares):
        groups = [here[(here < 0.5) & side] for side in (there > 0.5, there < 0.5)]
        if min(len(group) for group in groups) > _LEAST_SIDE * len(here):
            found.append(float(np.median(groups[0]) - np.median(groups[1])))
    return found


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class _EvenPictures:
    """What looks the same in all photographs that were taken in the same light, whatever stripes they show."""

    names: list[str]
    ratio: Float32Array
    """(N, H, W) of each to the median of all."""
    told: BoolArray
    """(H, W) where that means something."""


def _even(seen: _Thinned, sharp: list[str]) -> _EvenPictures | None:
    """Sums of sharp pairs, else single photographs of fine stripes where the projector does not reach."""
    if len(sharp) >= _LEAST_PHOTOGRAPHS:
        names, pictures, where = sharp, [seen.total(name) for name in sharp], np.ones_like(seen.unlit)
    else:
        names = _fine(seen.frames)
        pictures, where = [seen.frames[name] for name in names], seen.unlit
    if len(names) < _LEAST_PHOTOGRAPHS:
        return None
    usual = np.median(pictures, axis=0)
    told = where & (usual > _DARKEST * seen.most)
    if told.mean() < _ENOUGH:
        return None
    ratio = np.asarray(np.stack(pictures) / np.where(told, usual, 1), dtype=np.float32)
    return _EvenPictures(names=names, ratio=ratio, told=told)


def _wandering(even: _EvenPictures) -> tuple[float, str]:
    """By how much, and in words: in steady light all of these are equally bright."""
    names, levels = even.names, np.median(even.ratio[:, even.told], axis=1)
    if levels.min() < _DARKEST:
        return 0.0, ""
    size = float(levels.max() / levels.min() - 1)
    if size < _WANDERS:
        return 0.0, ""
    steps = np.diff(levels)
    k = int(np.abs(steps).argmax())
    if abs(steps[k]) > _BY_STEP * (levels.max() - levels.min()):
        brighter, by = ("brighter", size) if steps[k] > 0 else ("darker", size / (1 + size))
        return size, (
            f"photographs are {100 * by:.0f} % {brighter} from {names[k + 1]} on, stripes or not: other light, or "
            "the exposure, changed"
        )
    return size, (
        f"photographs differ in brightness by {100 * size:.0f} %, stripes or not, {names[int(levels.argmin())]} is "
        f"darkest and {names[int(levels.argmax())]} brightest: the exposure was automatic, or lamp or daylight changed"
    )


def _fine(names: Iterable[str]) -> list[str]:
    """Names of the pictures of which half the light is shown, whatever part of them is in view."""
    coded = [name for name in names if name.startswith("gray-")]
    slots = Slots.of(coded)
    bit = np.array(slots.bit)
    coarsest = np.where(slots.same_axis, bit, 0).max(axis=1)
    return list(compress(coded, bit <= coarsest - _FEW_BITS))


def _banded(even: _EvenPictures) -> tuple[float, str]:
    """By how much, and in words: a rolling shutter writes a flicker into the lines of most photographs.

    It does so along the lines only.
    """
    along = [_profile(one, even.told) for one in even.ratio]
    across = [_profile(one.T, even.told.T) for one in even.ratio]
    if np.median(along) < np.median(across):
        along, across = across, along
    size = float(np.median(along))
    if not (_BANDS[0] < size < _BANDS[1] and size > _MOSTLY * np.median(across)):
        return 0.0, ""
    return 2 * size, (
        f"the brightness of photographs changes by {200 * size:.0f} % along their lines, of each otherwise: light that "
        "flickers faster than the camera reads; expose for whole periods of the mains and of the projector"
    )


def _profile(ratio: Float32Array, told: BoolArray) -> float:
    """Standard deviation of a photograph's brightness along its lines."""
    bands = [ratio[rows][told[rows]] for rows in _bands(len(ratio))]
    lines = [float(np.median(band)) for band in bands if len(band) > _LINES]
    return float(np.std(lines)) if len(lines) > 2 else 0.0


def _crept(seen: _Thinned, sharp: list[str]) -> str:
    """A camera that sinks moves by little from one photograph to the next."""
    if len(sharp) < 2 * _AT_ENDS:
        return ""
    ends = sharp[:_AT_ENDS], sharp[-_AT_ENDS:]
    first, last = (np.sum([seen.total(name) for name in some], axis=0) for some in ends)
    laid = laid_over(first, last)
    if laid.length < _CREPT_PX / seen.step_px:
        return ""
    return (
        f"the picture moves by {laid.length * seen.step_px:.1f} px from {sharp[0]} to {sharp[-1]}, little by little: "
        "camera or object sank or was pushed; fasten both"
    )
