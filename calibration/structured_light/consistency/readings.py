"""Which picture of a binary-reflected Gray code is which bit, from what the pictures show at each other's edges.

From each position to the next one bit changes. Where bit k does, bit k − 1 is lit and all finer ones are dark: the edge
of a coarse stripe lies in the middle of a lit stripe of the next finer picture and in the middle of dark stripes of all
others. That orders the pictures of an axis and tells a pattern from its inverse, except for the coarsest picture that
has an edge in view and those that have none; and it does not tell columns from rows.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from calibration.arrays import BoolArray, FloatArray, IntArray
from calibration.structured_light.consistency.edges import Stripes

_AGREES = 0.3
"""Of the picture's contrast, with the sign of the code: right ones have 0.4 to 1.6, wrong ones 0 or the other sign."""
_SIGMAS = 4.0
_ALIKE = 0.992
"""Share of the places at which pictures agree that need not be told apart."""
_MOST_READINGS = 64


@dataclass(frozen=True, slots=True)
class Slots:
    """The places that pictures have in a Gray code."""

    axis: tuple[str, ...]
    bit: tuple[int, ...]

    @classmethod
    def of(cls, patterns: Sequence[str]) -> Slots:
        """Read the places from the patterns' names, `gray-AXIS-BIT`."""
        parts = [name.split("-") for name in patterns]
        return cls(tuple(part[1] for part in parts), tuple(int(part[2]) for part in parts))

    @property
    def same_axis(self) -> BoolArray:
        """(U, U) whether two pictures are of one axis."""
        axis = np.array(self.axis)
        return np.asarray(axis[:, None] == axis)

    @property
    def expected(self) -> FloatArray:
        """(U, U) what the second picture shows at the edges of the first: 1 lit, −1 dark, 0 either."""
        bit = np.array(self.bit)
        finer = self.same_axis & (bit[:, None] > bit)
        return np.where(finer, np.where(bit[:, None] == bit + 1, 1.0, -1.0), 0.0)

    @property
    def finest(self) -> BoolArray:
        """(U,) whether no picture of the same axis has finer stripes."""
        return np.asarray((self.expected == 0).all(axis=1))


@dataclass(frozen=True, slots=True)
class PictureOrder:
    """One way to read the pictures: which of them is in which slot, and which way round."""

    picture: tuple[int, ...]
    """Of each slot."""
    sign: tuple[int, ...]
    """Of each slot: 1 as given, −1 pattern and inverse exchanged."""

    def exchanged(self, a: int, b: int, signs: tuple[int, int] = (1, 1)) -> PictureOrder:
        """Return the reading with the pictures of two slots exchanged, each turned round where its sign is −1."""
        picture, sign = list(self.picture), list(self.sign)
        picture[a], picture[b] = self.picture[b], self.picture[a]
        sign[a], sign[b] = self.sign[b] * signs[0], self.sign[a] * signs[1]
        return PictureOrder(tuple(picture), tuple(sign))

    def turned(self, slots: Iterable[int]) -> PictureOrder:
        """Return the reading with the pictures of some slots turned round."""
        turn = set(slots)
        return PictureOrder(self.picture, tuple(-s if k in turn else s for k, s in enumerate(self.sign)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """What decides about a reading, gathered once."""

    slots: Slots
    expected: FloatArray
    """(U, U) of slots: see :attr:`Slots.expected`."""
    at_edges: FloatArray
    """(U, U) of pictures: see :class:`~calibration.structured_light.consistency.edges.Stripes`."""
    sigma: FloatArray
    """(U, U) of pictures: see :class:`~calibration.structured_light.consistency.edges.Stripes`."""
    kind: IntArray
    """(U,) of pictures: those that agree at nearly all places have one number, opposite ones its negative."""

    def agreement(self, reading: PictureOrder) -> FloatArray:
        """(U, U) of slots: what is seen in the expected direction; NaN where nothing is expected or seen."""
        order = np.array(reading.picture)
        seen = self.at_edges[order[:, None], order] * np.array(reading.sign)
        return np.asarray(seen * self.expected)

    def contradictions(self, reading: PictureOrder) -> BoolArray:
        """(U, U) pairs of slots: the second's picture does not show what it should at the edges of the first's."""
        order = np.array(reading.picture)
        return np.asarray(self.agreement(reading) < _AGREES - _SIGMAS * self.sigma[order[:, None], order])

    def consistent(self, reading: PictureOrder) -> bool:
        """Whether no pair of pictures contradicts the code."""
        return not self.contradictions(reading).any()

    def cost(self, reading: PictureOrder) -> float:
        """Grow with each contradiction."""
        return float(np.nansum(np.clip(1 - self.agreement(reading), 0, 2)))

    def what_is_read(self, reading: PictureOrder) -> tuple[int, ...]:
        """Return the same for readings that give every place the same position."""
        return tuple((self.kind[list(reading.picture)] * reading.sign).tolist())


def evidence_of(stripes: Stripes, slots: Slots) -> Evidence:
    """Gather what decides about readings of pictures."""
    expected = slots.expected
    side = np.where(stripes.middle > 0, np.float32(1), np.float32(-1))
    agree = side @ side.T / max(side.shape[1], 1)
    near = np.abs(agree) > 2 * _ALIKE - 1
    first = near.argmax(axis=1)
    kind = (first + 1) * np.sign(agree[np.arange(len(first)), first])
    return Evidence(
        slots=slots,
        expected=np.where(expected == 0, np.nan, expected),
        at_edges=stripes.at_edges,
        sigma=stripes.sigma,
        kind=kind.astype(np.int64),
    )


def as_named(slots: Slots) -> PictureOrder:
    """Return the reading that takes every picture for what it is called."""
    count = len(slots.bit)
    return PictureOrder(tuple(range(count)), (1,) * count)


def consistent_readings(evidence: Evidence, start: PictureOrder) -> tuple[PictureOrder, ...]:
    """Find the readings of the pictures that do not contradict the code.

    Parameters
    ----------
    evidence : Evidence
    start : PictureOrder
        As the pictures are named; comes first when it is consistent.

    Returns
    -------
    tuple of PictureOrder
        Those that read some place otherwise than the ones before; at most 64. Empty when none was found: then the
        pictures do not belong to one code and one still scene.
    """
    first = start if evidence.consistent(start) else _searched(evidence, start)
    if first is None:
        return ()
    slots, found, queue = evidence.slots, {evidence.what_is_read(first): first}, [first]
    loose = _loose_slots(evidence, first)
    while queue and len(found) < _MOST_READINGS:
        current = queue.pop(0)
        for move in (*_moves(current, loose), *_axes_exchanged(slots, current)):
            key = evidence.what_is_read(move)
            if key not in found and evidence.consistent(move):
                found[key] = move
                queue.append(move)
    return tuple(found.values())[:_MOST_READINGS]


def _loose_slots(evidence: Evidence, reading: PictureOrder) -> list[int]:
    """Slots whose pictures may be exchanged or turned without a contradiction."""
    moves = [move for move in _moves(reading, range(len(reading.sign))) if evidence.consistent(move)]
    return sorted({k for move in moves for k in range(len(reading.sign)) if _differs(move, reading, k)})


def _differs(a: PictureOrder, b: PictureOrder, slot: int) -> bool:
    return a.picture[slot] != b.picture[slot] or a.sign[slot] != b.sign[slot]


def _moves(reading: PictureOrder, among: Sequence[int]) -> Iterator[PictureOrder]:
    """Single turns and exchanges among slots."""
    yield from (reading.turned([k]) for k in among)
    for a, b in combinations(among, 2):
        yield from (reading.exchanged(a, b, (first, second)) for first, second in product((1, -1), repeat=2))


def _axes_exchanged(slots: Slots, reading: PictureOrder) -> Iterator[PictureOrder]:
    columns, rows = ([k for k, name in enumerate(slots.axis) if name == axis] for axis in ("column", "row"))
    if len(columns) == len(rows):
        order = np.arange(len(slots.bit))
        order[columns], order[rows] = rows, columns
        yield _reordered(reading, order)


def _reordered(reading: PictureOrder, order: IntArray) -> PictureOrder:
    return PictureOrder(tuple(reading.picture[k] for k in order), tuple(reading.sign[k] for k in order))


def _reversed(slots: Slots, reading: PictureOrder) -> PictureOrder:
    """Each axis with its finest picture first."""
    order = np.arange(len(slots.bit))
    for axis in set(slots.axis):
        members = [k for k, name in enumerate(slots.axis) if name == axis]
        order[members] = members[::-1]
    return _reordered(reading, order)


def _searched(evidence: Evidence, start: PictureOrder) -> PictureOrder | None:
    """Walk downhill by single exchanges from the names, and from what people get wrong as a whole."""
    whole = (start, *_axes_exchanged(evidence.slots, start), _reversed(evidence.slots, start))
    starts = [*whole, *(reading.turned(range(len(reading.sign))) for reading in whole)]
    for begin in sorted(starts, key=evidence.cost):
        end = _descended(evidence, begin)
        if evidence.consistent(end):
            return end
    return None


def _descended(evidence: Evidence, reading: PictureOrder) -> PictureOrder:
    cost, everywhere = evidence.cost(reading), range(len(reading.sign))
    while True:
        best = min(_moves(reading, everywhere), key=evidence.cost)
        if evidence.cost(best) >= cost - 1e-9:
            return reading
        reading, cost = best, evidence.cost(best)
