"""Shapes that are no boxes, fixed and drawn at random, and the tape that somebody would have laid in them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
from geometry_worlds import BowedWall, HalfSpace, Round, Shape, box, points_of
from numpy.typing import NDArray

from rig.devices.simulated.optics import make_optics
from rig.profile.schema import Profile

FloatArray = NDArray[np.float64]
_TAPE_SIGMA = 0.003
"""Of a length by tape, as a share of it."""


def with_tape(profile: Profile, shape: Shape, random: np.random.Generator) -> Profile:
    """Return the profile with the distance that a tape finds between the spots of its scale before this shape."""
    if profile.simulation is None:
        raise ValueError(f"{profile.path}: not a simulated rig")
    projector = make_optics(profile.simulation.projector, profile.projector.shape)
    spots_px = np.array(profile.scale.spots_px, dtype=np.float64)
    ends = points_of(shape, projector, spots_px)
    distance_m = float(np.linalg.norm(ends[1] - ends[0]) * (1 + _TAPE_SIGMA * random.normal()))
    scales = [profile.scale.model_copy(update={"distance_m": distance_m})]
    return profile.model_copy(update={"scales": scales})


def drawn_shape(random: np.random.Generator) -> tuple[str, Shape]:
    """Return one of the kinds below, of a size that is drawn, with its name; ci-tiny's devices stand in it."""
    kind = random.integers(6)
    if kind == 0:
        angle = round(float(random.uniform(91, 140)), 1)
        return f"corner of {angle} degrees", _corner(angle)
    if kind == 1:
        angle = round(float(np.exp(random.uniform(np.log(0.3), np.log(20)))), 1)
        return f"wall that leans {angle} degrees", _leaning(angle)
    middle = np.array([*random.uniform(1.7, 2.3, 2), 0.0])
    radius = round(float(random.uniform(2.4, 6.0)), 2)
    if kind == 2:
        return f"cylinder of {radius} m", Shape(
            walls=(Round(middle, radius, np.eye(3)[2]), *_FLOOR_AND_CEILING), is_box=False
        )
    if kind == 3:
        low = np.array([*middle[:2], random.uniform(0.2, 1.2)])
        floor = _FLOOR_AND_CEILING[: random.integers(0, 2)]
        return f"dome of {radius} m, {len(floor)} floor", Shape(walls=(Round(low, radius), *floor), is_box=False)
    size = round(float(random.uniform(0.15, 0.9)), 2)
    at = np.append(random.uniform(2.6, 4.8 - size, 2), random.uniform(size, 2.4 - size))
    return f"ball of {size} m at {np.round(at, 2).tolist()}", Shape(walls=ROOM.walls, balls=(Round(at, size),))


def askew_room(size_m: FloatArray, camera_m: FloatArray, askew_deg: float, random: np.random.Generator) -> Shape:
    """Return a box each of whose walls is turned about the foot of the camera's perpendicular, by chance."""
    walls = []
    for axis, side in itertools.product(range(3), (-1, 1)):
        normal, foot = np.zeros(3), np.array(camera_m)
        normal[axis], foot[axis] = side, max(side, 0) * size_m[axis]
        others = np.delete(np.arange(3), axis)
        normal[others] = random.normal(0, np.radians(askew_deg), 2)
        normal /= np.linalg.norm(normal)
        walls.append(HalfSpace(normal, float(normal @ foot)))
    return Shape(walls=tuple(walls), is_box=False)


def bowed_room(size_m: FloatArray, bow_m: float, random: np.random.Generator) -> Shape:
    """Return a box each of whose walls bulges smoothly, in or out, by about so much."""
    walls = []
    for axis, side in itertools.product(range(3), (0, 1)):
        waves = random.normal(size=3) * (1.0, 0.5, 0.5)
        walls.append(BowedWall(axis, side, size_m, bow_m * waves / np.abs(waves).sum()))
    return Shape(walls=tuple(walls))


def _corner(angle_deg: float) -> Shape:
    """Two walls that meet at an angle, with floor, ceiling, and walls behind the rig."""
    edge, towards = np.array([4.4, 4.4]), np.array([-1, -1]) / np.sqrt(2)
    walls = []
    for side in (0.5, -0.5):
        c, s = np.cos(np.radians(side * angle_deg)), np.sin(np.radians(side * angle_deg))
        along = np.array([[c, -s], [s, c]]) @ towards
        normal = np.array([-along[1], along[0]])
        normal = -normal if normal @ towards > 0 else normal
        walls.append(HalfSpace(np.append(normal, 0.0), float(normal @ edge)))
    behind = [HalfSpace(-np.eye(3)[k], 4.0) for k in (0, 1)]
    return Shape(walls=(*walls, *_FLOOR_AND_CEILING, *behind), is_box=angle_deg == 90)


def _leaning(angle_deg: float) -> Shape:
    """A box one of whose walls leans outwards."""
    normal = np.array([np.cos(np.radians(angle_deg)), 0, np.sin(np.radians(angle_deg))])
    leaning = HalfSpace(normal, float(normal @ [4.8, 0, 1.2]))
    return Shape(walls=(leaning, *ROOM.walls[1:]), is_box=False)


_FLOOR_AND_CEILING = (HalfSpace(-np.eye(3)[2], 0.0), HalfSpace(np.eye(3)[2], 2.4))
ROOM = box(np.array([4.8, 4.8, 2.4]))
SHAPES: Mapping[str, Shape] = {
    **{f"corner of {angle} degrees": _corner(angle) for angle in (95, 100, 110, 120, 130, 140)},
    **{f"wall that leans {angle} degrees": _leaning(angle) for angle in (1, 2, 5, 10, 20)},
    "cylinder between floor and ceiling": Shape(
        walls=(Round(np.array([2.0, 2.0, 0.0]), 3.0, np.eye(3)[2]), *_FLOOR_AND_CEILING), is_box=False
    ),
    "cylinder": Shape(walls=(Round(np.array([2.0, 2.0, 0.0]), 3.0, np.eye(3)[2]),), is_box=False),
    "dome": Shape(walls=(Round(np.array([2.0, 2.0, 1.0]), 3.2),), is_box=False),
    "dome on a floor": Shape(walls=(Round(np.array([2.0, 2.0, 0.5]), 3.2), _FLOOR_AND_CEILING[0]), is_box=False),
    **{
        f"ball of {radius} m in the corner": Shape(
            walls=ROOM.walls, balls=(Round(np.array([3.6, 3.6, radius]), radius),)
        )
        for radius in (0.3, 0.6, 0.9)
    },
}
