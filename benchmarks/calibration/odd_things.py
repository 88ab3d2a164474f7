"""What stands in rooms that nobody tuned to: on walls and under ceilings, flush in corners, thin, tilted, round."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import trimesh
from world_things import Builder, FloatArray, Thing, standing_apart

from rig.devices.simulated.worlds.shapes import Point, block, moved, turned

_FIXED = ("shelf", "board", "beam", "corner block", "plinth", "wedge", "niche", "pilaster", "none")
_BEFORE_WALLS_M = 0.5
"""What stands free keeps so far from walls with something on them."""


def _stairs(random: np.random.Generator, _height_m: float) -> Thing:
    width, deep, high = random.uniform(0.6, 1.0), random.uniform(0.2, 0.3), random.uniform(0.15, 0.2)
    steps = np.concatenate([block((0, k * deep), (width, deep, high * (k + 1))) for k in range(4)])
    middled = moved(steps, (0, -1.5 * deep, 0))
    return Thing("stairs", turned(middled, random.uniform(0, 360)), float(np.hypot(width, 4 * deep) / 2))


def _chair(random: np.random.Generator, _height_m: float) -> Thing:
    seat_m, side = 0.45, 0.45
    legs = [block((x, y), (0.04, 0.04, seat_m)) for x in (-0.2, 0.2) for y in (-0.2, 0.2)]
    seat = block((0, 0), (side, side, 0.04), bottom_m=seat_m)
    back = block((0, 0.2), (side, 0.04, 0.5), bottom_m=seat_m + 0.04)
    return Thing("chair", turned(np.concatenate([seat, back, *legs]), random.uniform(0, 360)), 0.35)


def _sofa(random: np.random.Generator, _height_m: float) -> Thing:
    width = random.uniform(1.2, 1.8)
    arms = [block((x, -0.1), (0.2, 0.6, 0.2), bottom_m=0.42) for x in (0.1 - width / 2, width / 2 - 0.1)]
    shape = [block((0, 0), (width, 0.8, 0.42)), block((0, 0.3), (width, 0.2, 0.4), bottom_m=0.42), *arms]
    turn = random.choice([0.0, random.uniform(0, 360)])
    return Thing("sofa", turned(np.concatenate(shape), turn), float(np.hypot(width, 0.8) / 2))


def _tilted(random: np.random.Generator, _height_m: float) -> Thing:
    size = (random.uniform(0.4, 0.8), random.uniform(0.3, 0.6), random.uniform(0.3, 0.9))
    mesh = trimesh.creation.box(size)
    mesh.apply_transform(trimesh.transformations.random_rotation_matrix(random.random(3)))
    mesh.apply_translation([0, 0, random.choice([0, 0.3]) - mesh.bounds[0][2]])
    return Thing("tilted box", np.asarray(mesh.triangles), float(np.hypot(*np.abs(mesh.bounds[:, :2]).max(0))))


def _ring(random: np.random.Generator, _height_m: float) -> Thing:
    radius, tube = random.uniform(0.3, 0.5), random.uniform(0.08, 0.18)
    mesh = trimesh.creation.torus(radius, tube, major_sections=36, minor_sections=16)
    if random.random() < 0.5:
        mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    mesh.apply_translation([0, 0, -mesh.bounds[0][2]])
    return Thing("ring", np.asarray(mesh.triangles), radius + 0.18)


def _person(_random: np.random.Generator, _height_m: float) -> Thing:
    body = trimesh.creation.capsule(height=0.9, radius=0.2, count=[16, 24])
    body.apply_translation([0, 0, -body.bounds[0][2]])
    head = trimesh.creation.icosphere(subdivisions=3, radius=0.12)
    head.apply_translation([0, 0, 1.55])
    return Thing("person", np.concatenate([body.triangles, head.triangles]), 0.25)


def _cone(random: np.random.Generator, _height_m: float) -> Thing:
    mesh = trimesh.creation.cone(random.uniform(0.25, 0.5), random.uniform(0.6, 1.4), sections=40)
    return Thing("cone", np.asarray(mesh.triangles), 0.5)


def _stacked(random: np.random.Generator, _height_m: float) -> Thing:
    low, high = random.uniform(0.5, 0.8), random.uniform(0.25, 0.45)
    under = block((0, 0), (low, low, 0.5), turn_deg=random.uniform(0, 90))
    upper = block((0, 0), (high, high, 0.5), bottom_m=0.5, turn_deg=random.uniform(0, 90))
    return Thing("stacked boxes", np.concatenate([under, upper]), low * 0.71)


def _lamp(random: np.random.Generator, height_m: float) -> Thing:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=random.uniform(0.15, 0.3))
    ball.apply_translation([0, 0, height_m - random.uniform(0.4, 0.8)])
    cable = block((0, 0), (0.01, 0.01, 0.4), bottom_m=height_m - 0.4)
    return Thing("lamp", np.concatenate([ball.triangles, cable]), 0.3)


def _stool(_random: np.random.Generator, _height_m: float) -> Thing:
    seat = trimesh.creation.cylinder(0.2, 0.04, sections=32)
    seat.apply_translation([0, 0, 0.5])
    return Thing("stool", np.concatenate([seat.triangles, block((0, 0), (0.05, 0.05, 0.48))]), 0.2)


ODD_THINGS: tuple[Builder, ...] = (
    _stairs,
    _chair,
    _sofa,
    _tilted,
    _ring,
    _person,
    _cone,
    _stacked,
    _lamp,
    _stool,
)


class _Fixed(NamedTuple):
    """What belongs to the room: on a wall, under the ceiling, or in a corner."""

    kind: str
    triangles_m: FloatArray | None


def _box(low_m: Point, high_m: Point) -> FloatArray:
    (x0, y0, z0), (x1, y1, z1) = low_m, high_m
    return block(((x0 + x1) / 2, (y0 + y1) / 2), (x1 - x0, y1 - y0, z1 - z0), bottom_m=z0)


def _on_wall(
    size_m: Point, swapped: bool, along_m: tuple[float, float], up_m: tuple[float, float], deep_m: float
) -> FloatArray:
    """Return a box on the wall x1, or on y1."""
    x, y, _ = size_m
    (a, b), (low, high) = along_m, up_m
    if swapped:
        return _box((a * x / y, y - deep_m, low), (b * x / y, y, high))
    return _box((x - deep_m, a, low), (x, b, high))


def _fixed(random: np.random.Generator, size_m: Point) -> _Fixed:
    (x, y, height), kind = size_m, str(random.choice(_FIXED))
    swapped, middle = bool(random.random() < 0.5), random.uniform(0.45, 0.7) * y
    on_walls = {
        "shelf": ((middle - 0.4, middle + 0.4), (1.2, 1.24), 0.25),
        "board": ((middle - 0.6, middle + 0.6), (0.9, 1.9), 0.06),
        "beam": ((0.1, y), (height - 0.3, height), 0.3),
        "plinth": ((middle - 0.5, middle + 0.5), (0.0, 0.6), 0.5),
        "pilaster": ((middle - 0.2, middle + 0.2), (0.0, height), 0.2),
    }
    if kind in on_walls:
        return _Fixed(kind, _on_wall(size_m, swapped, *on_walls[kind]))
    if kind == "corner block":
        wide, deep = random.uniform(0.6, 1.3, 2)
        return _Fixed(kind, _box((x - wide, y - deep, 0), (x, y, height)))
    if kind == "wedge":
        deep, low = random.uniform(0.5, 1.2), height - random.uniform(0.5, 1.0)
        a, b, c, d = (x - deep, 0, height), (x, 0, low), (x, y, low), (x - deep, y, height)
        return _Fixed(kind, np.array([[a, b, c], [a, c, d]], dtype=float))
    if kind == "niche":
        return _Fixed(
            kind,
            np.concatenate([_box((x - 0.4, 0, 0), (x, 0.5 * y, height)), _box((x - 0.4, 0.8 * y, 0), (x, y, height))]),
        )
    return _Fixed("none", None)


def placed_oddly(random: np.random.Generator, size_m: Point) -> list[Thing]:
    """At most one thing that belongs to the room, and up to three that stand or hang in the half that the rig sees."""
    count, fixed = int(random.integers(0, 4)), _fixed(random, size_m)
    things = [] if fixed.triangles_m is None else [Thing(fixed.kind, fixed.triangles_m, 0.0)]
    keeps_away = fixed.triangles_m is not None and fixed.kind not in ("wedge", "beam", "shelf")
    most = np.array(size_m[:2]) - (_BEFORE_WALLS_M if keeps_away else 0.0)
    corner = fixed.triangles_m.reshape(-1, 3).min(axis=0)[:2] if fixed.kind == "corner block" else np.full(2, np.inf)

    def free_of_room(at: FloatArray, radius_m: float) -> bool:
        return bool((at + radius_m < most).all() and not (at + radius_m > corner - 0.1).all())

    return things + standing_apart(random, size_m, ODD_THINGS, count, free_of_room)
