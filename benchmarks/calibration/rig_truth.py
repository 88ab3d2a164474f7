"""What the simulated world knows of a rig: which walls and which of the tape's spots are seen; is a refusal true?"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
from geometry_worlds import CodeNoise, box, exact_map, measured
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from rig.devices.simulated.optics import directions, pixels_of
from rig.devices.simulated.pair import pixel_grid
from rig.devices.simulated.rigs import simulated_worlds_of
from rig.devices.simulated.room import trace
from rig.devices.simulated.world import SimulatedWorld
from rig.profile.schema import Profile
from rig.stages.geometry import geometry_of

FloatArray = NDArray[np.float64]

LEAST_WALL = 0.02
"""Of the pixels that are lit and seen: of a smaller wall nobody can ask that it be found."""
_WALLS = ("floor", "ceiling", "x0", "x1", "y0", "y1")
"""By axis (z first) and side."""
_LEFT_OPEN = ("leave open how the room stands", "two rooms explain the points equally well")
_LITTLE_PARALLAX = ("too little parallax", "the baseline is (nearly) zero")
"""What says that points tell too little: so do exact ones then. Refused with something else they leave it open."""
_NOT_OF_A_BOX = (
    "is not flat: its points leave",
    "the walls are not at right angles",
    "lie on a flat wall that does not go",
)
"""Its walls are flat and square: who says otherwise is wrong."""
_AT_EDGE_PX = 3.0
_NARROW_PX = 6.0
"""Nearer to the rim of the camera's picture, or of the wall's edge, a spot need not be found."""


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What the camera sees of what the projector lights, by the simulated world."""

    lit_share: float
    """Of the camera's pixels."""
    walls: dict[str, float]
    """Share of the lit pixels on each wall that has any."""
    spots_seen: tuple[bool, ...]
    """Whether each spot of the tape lies in the camera's picture."""
    spots_at_edges: tuple[bool, ...]
    """Whether the projector's pixels around each, three away, light different walls."""
    left_open: str | None = None
    """What exact correspondences of its walls, with a code's noise, are refused with; None where they are not."""

    @property
    def planes(self) -> int:
        """Walls with enough of the lit pixels to be found."""
        return sum(share >= LEAST_WALL for share in self.walls.values())


def seen_of(profile: Profile) -> Seen | None:
    """Look at a rig's own world; None of one that is no box."""
    world = simulated_worlds_of(profile)[0]
    if not isinstance(world, SimulatedWorld):
        return None
    surface = trace(world.room, world.camera.position_m, directions(world.camera, pixel_grid(world.camera.shape)))
    lit = np.isfinite(exact_map(box(np.array(world.settings.size_m)), world.camera, world.projector)).all(axis=-1)
    count = np.bincount(surface.wall[lit], minlength=len(world.room.walls))
    names = [_name(wall.axis, wall.position_m) for wall in world.room.walls]
    walls = {name: float(n / max(lit.sum(), 1)) for name, n in zip(names, count, strict=True) if n}
    spots = np.array(profile.scale.spots_px or (), dtype=np.float64).reshape(-1, 2)
    there = trace(world.room, world.projector.position_m, directions(world.projector, spots)).points_m
    in_view = _within(pixels_of(world.camera, there), world.camera.shape, -_NARROW_PX)
    around = _AT_EDGE_PX * np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)], dtype=np.float64)
    beside = [
        trace(world.room, world.projector.position_m, directions(world.projector, spot + around)) for spot in spots
    ]
    return Seen(
        lit_share=float(lit.mean()),
        walls=walls,
        spots_seen=tuple(bool(one) for one in in_view),
        spots_at_edges=tuple(bool(np.ptp(one.wall) > 0) for one in beside),
    )


def with_what_is_left_open(seen: Seen, profile: Profile) -> Seen:
    """Add what the geometry says of the world's own correspondences; takes a few seconds."""
    world = simulated_worlds_of(profile)[0]
    if not isinstance(world, SimulatedWorld):
        return seen
    exact = exact_map(box(np.array(world.settings.size_m)), world.camera, world.projector)
    try:
        geometry_of(measured(exact, world.projector.shape, CodeNoise(), world.settings.seed), profile, lambda *_: None)
    except CalibrationError as error:
        return replace(seen, left_open=str(error))
    return seen


def is_refusal_true(said: str, seen: Seen | None) -> bool | None:
    """Whether what a session was refused with is so; None where the world alone does not tell."""
    if seen is None:
        return None
    if "one plane explains" in said:
        return seen.planes < 2
    for words in (_LEFT_OPEN[:1], _LEFT_OPEN[1:], _LITTLE_PARALLAX):
        if any(cause in said for cause in words):
            if seen.left_open is None:
                return False
            return True if any(cause in seen.left_open for cause in words) else None
    if any(cause in said for cause in _NOT_OF_A_BOX):
        return False
    if "has no measured wall around it" in said:
        return not all(seen.spots_seen)
    if "of the edge between two walls" in said:
        return any(seen.spots_at_edges)
    share = re.search(r"only ([0-9.]+) % of the camera's pixels have a projector pixel", said)
    if share:
        return seen.lit_share < 0.02
    return None


def _within(xy_px: FloatArray, shape: tuple[int, int], margin_px: float) -> NDArray[np.bool_]:
    height, width = shape
    with np.errstate(invalid="ignore"):
        return np.asarray(((xy_px > -margin_px) & (xy_px < np.array([width, height]) - 1 + margin_px)).all(axis=-1))


def _name(axis: int, position_m: float) -> str:
    side = int(position_m > 0)
    return _WALLS[side] if axis == 2 else f"{'xy'[axis]}{side}"
