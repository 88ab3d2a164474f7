"""Whether photographs of a Gray code are what they are called, from the photographs themselves.

Whoever photographs a code by hand exchanges files, copies one twice, knocks against the tripod. A decoder then finds
positions all the same, wrong ones. The pictures know better: a pattern and its inverse add up to white and black, a
still scene looks the same in all such sums, and the edges of coarse stripes lie where the finer pictures stand still.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.arrays import BoolArray, Float32Array, FloatArray, Frame
from calibration.errors import CalibrationError
from calibration.structured_light.consistency.bounds import refuse_beyond_white
from calibration.structured_light.consistency.edges import (
    BLURRED,
    LinePlaces,
    Stripes,
    complement_error,
    fine_correlation,
    normalised,
    places_on_lines,
    repetition_error,
    stripes_of,
)
from calibration.structured_light.consistency.readings import (
    Evidence,
    PictureOrder,
    Slots,
    as_named,
    consistent_readings,
    evidence_of,
)
from calibration.structured_light.consistency.still import Movement, exposure_gains, exposure_gains_alone, movements

_INVERSE = "-inverse"
_LEAST_PLACES = 200
_NO_COMPLEMENT = 0.02
"""Share of places where two photographs do not add up; on a real scan pairs had 0.000 to 0.014, others 0.03 to 0.7."""
_BLURRED_PAIR, _BLURRED_LEAD = -0.1, 0.05
"""Correlation of the changes of blurred fine stripes with those of their inverse, and its lead over any other
photograph's; on a real scan −0.5 and 0.4."""
_GONE = 0.1
"""Of white minus mean, the finest stripes of photographs without inverses: below, what is left is mostly noise. In a
drawn set (seed 802) whose camera pixels are as large as two of the projector's they had 0.05."""
_MOIRE = 0.15
"""The same with inverses, where no order explains the stripes otherwise: in drawn set 884142 a camera's pixel is as
large as two of the projector's, and finest stripes of 0.03 to 0.04 are moiré, which tells nothing; a telephone's
smoothing leaves 0.07 to 0.11 that lie otherwise (rough sets 18070, 18106). A real scan's have less by JPEG 20, and
still tell."""
_RARELY = 0.03
"""Of the places, on the other side of a coarse stripe's edge: the last rows of a projector with few more than a power
of two, two or three camera pixels wide, within which blurred pictures do not show what they are."""
_MOST_SHARED = 0.05
"""Of the edges of the finer of two pictures. Of 17 drawn sets without inverses one had 0.02, the others none; where one
photograph was torn 12 of them had 0.08 to 0.66 (`benchmarks/photographs`, seeds 892000 to 892058)."""
_REPEATED = 0.02
_SAME_CHANGES, _COPY = 0.3, 0.5
_EQUAL = 0.05
"""Of the contrast: noise and a good JPEG leave copies nearer to each other; half of an exposure is a quarter of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotographOrder:
    """What the photographs of a Gray code are, as far as they show it."""

    as_named: bool
    """Whether they may be what they are called."""
    readings: tuple[Mapping[str, str], ...]
    """Pattern to the name under which its photograph was given, for each way to take the photographs that none of
    them contradicts; the one that changes the least comes first. Several differ in what the view does not show: the
    coarsest stripes' side, columns for rows."""
    gains: Mapping[str, float]
    """Exposure of photographs that differ from the rest, by given name. [1]"""
    unresolved: tuple[str, ...]
    """Patterns whose stripes are too blurred to tell anything."""
    undersampled: tuple[str, ...]
    """Patterns that only their names place: the camera has fewer than three pixels to a bright and a dark stripe."""


def check_gray_frames(frames: Mapping[str, Frame], limit: float) -> PhotographOrder:
    """Find out whether photographs of a binary-reflected Gray code are what they are called.

    Parameters
    ----------
    frames : mapping of pattern name to (H, W)
        As :func:`~calibration.structured_light.gray.gray_code_patterns` names them, with all inverses or none. [dn]
    limit : float
        Least difference of the brightest and the darkest photograph at a lit place. [dn]

    Returns
    -------
    PhotographOrder

    Raises
    ------
    CalibrationError
        If a photograph repeats another, in whole or in part, or is the inverse of none; the camera moved, or no order
        explains the stripes; or one without inverses is brighter than white. The message names the photographs by
        their patterns.
    """
    names = [name for name in frames if name.startswith("gray-")]
    index = {name: k for k, name in enumerate(names)}
    patterns = [name for name in names if not name.endswith(_INVERSE)]
    complete = any(name.endswith(_INVERSE) for name in names)
    places = places_on_lines([frames[name] for name in names], limit)
    if places.middle.shape[1] < _LEAST_PLACES:
        return _nothing_to_tell(names)
    named: list[tuple[int, int | None]] = [(index[name], index.get(name + _INVERSE)) for name in patterns]
    pairs = [(a, b) for a, b in named if b is not None]
    gains = _gains(places, pairs) if complete else exposure_gains_alone(places.middle)
    seen = normalised(places, gains, complete=complete)
    shown = [_evened(frames[name], float(gain)) for name, gain in zip(names, gains, strict=True)]
    if complete:
        pairs = _matched(seen, pairs, shown, names)
        _refuse_movement([(shown[a], shown[b]) for a, b in pairs], pairs, names)
    else:
        refuse_beyond_white({**frames, **dict(zip(names, shown, strict=True))})
    pictures: Sequence[tuple[int, int | None]] = pairs if complete else named
    stripes, slots = stripes_of(seen, pictures), Slots.of(patterns)
    _refuse_shared_edges(stripes, slots, [names[a] for a, _ in pictures])
    judged = _judged(stripes, slots, _alike(seen, pictures), gone=0.0 if complete else _GONE)
    readings = judged.readings
    if not complete:
        readings = tuple(reading for reading in readings if min(reading.sign) > 0)
    if not readings:
        raise CalibrationError(_unexplained(judged.evidence, [names[a] for a, _ in pictures]))
    return PhotographOrder(
        as_named=list(pictures) == named and readings[0] == as_named(judged.evidence.slots),
        readings=tuple(_by_name(reading, patterns, pictures, names) for reading in readings),
        gains={name: float(gain) for name, gain in zip(names, gains, strict=True) if gain != 1},
        unresolved=tuple(patterns[k] for k in np.flatnonzero(judged.blurred)),
        undersampled=tuple(patterns[k] for k in np.flatnonzero(judged.undersampled & ~judged.blurred)),
    )


def _evened(frame: Frame, gain: float) -> Frame:
    """A photograph as the others' exposure would have had it: stripes that do not add up look like movement."""
    return frame if gain == 1 else np.asarray(frame / np.float32(gain), dtype=np.float32)


def _nothing_to_tell(names: Sequence[str]) -> PhotographOrder:
    """For photographs in which nothing is lit: what follows will say so."""
    return PhotographOrder(
        as_named=True, readings=({name: name for name in names},), gains={}, unresolved=(), undersampled=()
    )


def _gains(places: LinePlaces, pairs: Sequence[tuple[int, int]]) -> FloatArray:
    """(N,) exposures; 1 for copies of other photographs, which are not the pattern at any exposure."""
    gains = exposure_gains(places.middle, pairs)
    if (gains != 1).any():
        together = fine_correlation(places) - np.eye(len(gains))
        copies = (together > _COPY) & _equal(places.middle)
        gains[copies.any(axis=1)] = 1
    return gains


def _equal(values: Float32Array) -> BoolArray:
    """(N, N) whether photographs are the same picture at the same exposure."""
    contrast = float((values.max(axis=0) - values.min(axis=0)).mean())
    apart = np.array([np.abs(values - one).mean(axis=1) for one in values])
    return np.asarray(apart < _EQUAL * contrast)


def _refuse_shared_edges(stripes: Stripes, slots: Slots, names: Sequence[str]) -> None:
    """From one position to the next one bit changes: no two pictures of an axis have an edge in one place."""
    shared = np.where(slots.same_axis, stripes.shared, 0)
    a, b = (int(k) for k in np.unravel_index(shared.argmax(), shared.shape))
    if shared[a, b] > _MOST_SHARED:
        raise CalibrationError(
            f"{names[a]} and {names[b]} have {100 * shared[a, b]:.0f} % of their edges in the same places (limit "
            f"{100 * _MOST_SHARED:g} %), as no two pictures of a Gray code do: one is a copy of the other, or both "
            "show a part of the same picture, since the projector changed while the camera read its lines; photograph "
            "both again, longer after the pattern was shown"
        )


def _alike(seen: LinePlaces, pictures: Sequence[tuple[int, int | None]]) -> BoolArray:
    """(U,) pictures whose inverse does not change in the opposite direction: blurred ones where stripes are faint."""
    together = fine_correlation(seen)
    return np.array([b is not None and bool(together[a, b] > _BLURRED_PAIR) for a, b in pictures])


@dataclass(frozen=True, slots=True)
class _Judged:
    """What pictures say of their order."""

    evidence: Evidence
    readings: tuple[PictureOrder, ...]
    blurred: BoolArray
    """(U,) pictures that are too blurred to give evidence."""
    undersampled: BoolArray
    """(U,) pictures that were left out since the camera's pixels are too large for them."""


def _judged(stripes: Stripes, slots: Slots, alike: BoolArray, *, gone: float) -> _Judged:
    """Seek orders by all pictures, then by those alone whose stripes the camera's pixels resolve.

    Finest stripes of which less than `gone` is left give no evidence.
    """
    start = as_named(slots)
    for least, undersampled in ((gone, np.zeros_like(alike)), (max(gone, _MOIRE), stripes.undersampled)):
        blurred = (alike | (slots.finest & (stripes.amplitude < least))) & (stripes.amplitude < BLURRED)
        evidence = _evidence(stripes, slots, blurred | undersampled)
        readings = consistent_readings(evidence, start)
        if readings:
            break
    return _Judged(evidence, readings, blurred, undersampled)


def _evidence(stripes: Stripes, slots: Slots, silent: BoolArray) -> Evidence:
    """Evidence about the order, without that of some pictures."""
    at_edges = stripes.at_edges.copy()
    at_edges[silent] = np.nan
    at_edges[:, silent] = np.nan
    lit = (stripes.middle > 0).mean(axis=1)
    few = np.minimum(lit, 1 - lit) < _RARELY
    at_edges[np.ix_(few, stripes.amplitude < BLURRED)] = np.nan
    return evidence_of(replace(stripes, at_edges=at_edges), slots)


def _matched(
    seen: LinePlaces, named: Sequence[tuple[int, int]], frames: Sequence[Frame], names: Sequence[str]
) -> list[tuple[int, int]]:
    """Pairs that are complements: as named where these are, other ones of the photographs that are left."""
    together = fine_correlation(seen)
    good = [_complementary(seen, together, pair) for pair in named]
    open_ = [k for pair, is_good in zip(named, good, strict=True) if not is_good for k in pair]
    if not open_:
        return list(named)
    partner = {a: _partner(seen, together, a, open_) for a in open_}
    lonely = [a for a in open_ if partner.get(partner[a]) != a]
    if lonely:
        kept = [pair for pair, is_good in zip(named, good, strict=True) if is_good]
        _refuse_movement([(frames[a], frames[b]) for a, b in kept], kept, names)
        raise CalibrationError(_without_complement(seen, lonely, named, names))
    return _rematched(named, good, partner)


def _rematched(
    named: Sequence[tuple[int, int]], good: Sequence[bool], partner: Mapping[int, int]
) -> list[tuple[int, int]]:
    """Pairs as named where they are good, else found ones, in a slot that names one of the two where there is one."""
    free, result = set(partner), []
    for (a, b), is_good in zip(named, good, strict=True):
        if not is_good:
            a = next((k for k in (a, b) if k in free), min(free, default=a))
            b = partner[a]
            free -= {a, b}
        result.append((a, b))
    return result


def _complementary(seen: LinePlaces, together: FloatArray, pair: tuple[int, int]) -> bool:
    """Whether two photographs add up to white and black, change in opposite directions, or are too blurred to tell."""
    a, b = pair
    strongest = min(_strongest_other(together, a, b), _strongest_other(together, b, a))
    if together[a, b] < _BLURRED_PAIR and together[a, b] < strongest - _BLURRED_LEAD:
        return True
    if np.abs(seen.middle[[a, b]]).mean(axis=1).max() < BLURRED:
        return abs(float(together[a, b])) < -_BLURRED_PAIR and strongest > 2 * _BLURRED_PAIR
    return complement_error(seen, a, b) < _NO_COMPLEMENT


def _strongest_other(together: FloatArray, a: int, b: int) -> float:
    """Most opposite changes to those of a, of all photographs but b and its copies."""
    return float(together[a, together[b] < _SAME_CHANGES].min(initial=0))


def _partner(seen: LinePlaces, together: FloatArray, a: int, among: Sequence[int]) -> int:
    """The photograph among some that is the complement of one, or -1."""
    others = [b for b in among if b != a and _complementary(seen, together, (a, b))]
    return min(others, key=lambda b: complement_error(seen, a, b) + together[a, b], default=-1)


def _without_complement(
    seen: LinePlaces, lonely: Sequence[int], named: Sequence[tuple[int, int]], names: Sequence[str]
) -> str:
    together = fine_correlation(seen)
    for a in lonely:
        for b in range(len(names)):
            alike = repetition_error(seen, a, b) < _REPEATED and together[a, b] > -_BLURRED_PAIR
            if a != b and alike:
                return (
                    f"{names[a]} and {names[b]} show the same picture: one of them is a stale frame or a copy; "
                    f"photograph {' and '.join(names[k] for k in (a, b) if k in lonely)} again, longer after the "
                    "pattern was shown"
                )
    pairs = [pair for pair in named if set(pair) & set(lonely)]
    a, b = pairs[0]
    share = 100 * complement_error(seen, a, b)
    return (
        f"{names[a]} and {names[b]} are not each other's inverse: at {share:.1f} % of the lit places they do not add "
        f"up to white and black (limit {100 * _NO_COMPLEMENT:g} %), and no other photograph fits either; photograph "
        "both again, longer after the pattern was shown, with the camera still, its automatics off and no other light "
        "switched"
    )


def _refuse_movement(
    shown: Sequence[tuple[Frame, Frame]], pairs: Sequence[tuple[int, int]], names: Sequence[str]
) -> None:
    found = movements(shown)
    if not found:
        return
    worst = _likeliest(found)
    order = [k for pair in pairs for k in pair]
    before, after = names[order[worst.before]], names[order[worst.after]]
    raise CalibrationError(
        f"the picture moves by {worst.step_px:.0f} px between {before} and {after}: camera or object was bumped; "
        "photograph all patterns again without touching either, or leave out the code's side that moved"
    )


def _likeliest(found: Sequence[Movement]) -> Movement:
    """Between two pairs where their sums say so clearly, else within the last pair that does not fit."""
    largest = max(movement.step_px for movement in found)
    between = [m for m in found if m.before % 2 == 1 and m.step_px > largest / 2]
    return max(between, key=lambda m: m.step_px) if between else found[-1]


def _unexplained(evidence: Evidence, names: Sequence[str]) -> str:
    against = evidence.contradictions(as_named(evidence.slots))
    count = against.sum(axis=0) + against.sum(axis=1)
    worst = [names[k] for k in np.argsort(-count)[:2] if count[k]]
    pairs = int(against.sum())
    return (
        "no order of the photographs explains their stripes: at the edges of coarse stripes finer ones are not as this "
        f"code has them, in {pairs} {'pair' if pairs == 1 else 'pairs'} of pictures, most of them with "
        f"{' and '.join(worst)}; check these two, that nothing moved, "
        "that all were exposed alike, and that all photographs show binary-reflected Gray code"
    )


def _by_name(
    reading: PictureOrder, patterns: Sequence[str], pictures: Sequence[tuple[int, int | None]], names: Sequence[str]
) -> dict[str, str]:
    result = {}
    for pattern, picture, sign in zip(patterns, reading.picture, reading.sign, strict=True):
        shown, inverse = pictures[picture] if sign > 0 else pictures[picture][::-1]
        if shown is not None:
            result[pattern] = names[shown]
        if inverse is not None:
            result[pattern + _INVERSE] = names[inverse]
    return result
