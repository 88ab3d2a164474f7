"""Which surfaces are expected to reflect alike: what is taken of those that nobody saw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, FloatArray

_SAME_WALL_SPREAD, _OTHER_WALL_SPREAD = 0.03, 0.06
"""Standard deviations by which the unseen part of a wall differs from its seen part, and a wall that nobody sees from
the mean of the others, or a thing's back from its front: painted rooms, whose texture is some percent."""
_OTHER_THING_SPREAD = 0.15
"""The same of a thing of which nothing is seen, from the mean of the other things: they are of all colours."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Alike:
    """What the R surfaces of a room are to each other."""

    front: NDArray[np.intp]
    """(R,) of a back that nobody saw, the number of its front; of all others, their own."""
    of_room: BoolArray
    """(R,) walls, floor, ceiling; what is not stands in the room, and says nothing of the paint of its walls."""

    @classmethod
    def only_walls(cls, n_walls: int) -> Alike:
        """Return that of an empty room."""
        return cls(front=np.arange(n_walls), of_room=np.ones(n_walls, dtype=bool))

    @classmethod
    def with_things(cls, n_walls: int, n_parts: int, *, backs: bool) -> Alike:
        """Return that of walls, fronts of what stands in the room, and their backs if any, numbered in this order."""
        fronts = np.arange(n_walls + n_parts)
        front = np.concatenate([fronts, fronts[n_walls:] if backs else fronts[:0]])
        return cls(front=front, of_room=np.arange(len(front)) < n_walls)


def expected_reflectance(
    reflectance: FloatArray, known: BoolArray, *, surface: NDArray[np.intp], alike: Alike
) -> tuple[FloatArray, FloatArray]:
    """Return (R,) what the unseen part of each surface is expected to reflect, and its standard deviation.

    The seen part of it tells most, then its front, then what of its kind is seen: other walls of a wall, other things
    of a thing.

    Parameters
    ----------
    reflectance : (P,)
        Of all patches.
    known : (P,) bool
        Patches that were seen.
    surface : (P,) int
        Number of each patch's surface.
    alike
        What the surfaces are to each other.
    """
    n_surfaces = len(alike.front)
    count = np.bincount(surface[known], minlength=n_surfaces)
    mean = np.bincount(surface[known], reflectance[known], minlength=n_surfaces) / np.maximum(count, 1)
    seen, of_front = count > 0, (count > 0)[alike.front]
    of_walls, of_things = (_mean_of(mean, seen, alike.of_room == is_wall) for is_wall in (True, False))
    of_kind = np.where(alike.of_room, of_walls, of_things)
    spread_of_kind = np.where(alike.of_room, _OTHER_WALL_SPREAD, _OTHER_THING_SPREAD)
    expected = np.where(seen, mean, np.where(of_front, mean[alike.front], of_kind))
    spread = np.where(seen, _SAME_WALL_SPREAD, np.where(of_front, _OTHER_WALL_SPREAD, spread_of_kind))
    return expected, spread


def _mean_of(mean: FloatArray, seen: BoolArray, kind: BoolArray) -> float:
    """Of the surfaces of a kind that are seen; of all seen where there is none."""
    return float(mean[seen & kind if (seen & kind).any() else seen].mean())
