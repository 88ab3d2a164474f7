"""What stands in random simulated rooms: boxes, tables, columns, panels, vases and domes, apart from each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.devices.simulated.worlds.shapes import Point, block, moved, quad, sheet, turned

FloatArray = NDArray[np.float64]

_APART_M = 0.15
"""Between two things: closer ones are one to a camera of 320 pixels."""
_FROM_WALL_M = 0.05
_TRIES = 200


@dataclass(frozen=True)
class Thing:
    """What stands in a room: its triangles about the origin, and the circle that it needs."""

    kind: str
    triangles_m: FloatArray
    radius_m: float


def _box(random: np.random.Generator, _height_m: float) -> Thing:
    x, y, z = random.uniform(0.3, 0.8, 3) * (1, 1, 1.5)
    shape = block((0, 0), (x, y, z), turn_deg=random.uniform(0, 90))
    return Thing("box", shape, float(np.hypot(x, y) / 2))


def _column(random: np.random.Generator, height_m: float) -> Thing:
    x, y = random.uniform(0.2, 0.5, 2)
    return Thing("column", block((0, 0), (x, y, height_m), turn_deg=random.uniform(0, 90)), float(np.hypot(x, y) / 2))


def _table(random: np.random.Generator, _height_m: float) -> Thing:
    x, y, z = random.uniform((0.7, 0.5, 0.5), (1.3, 0.9, 0.9))
    legs = [block((a, b), (0.06, 0.06, z)) for a in (0.1 - x / 2, x / 2 - 0.1) for b in (0.1 - y / 2, y / 2 - 0.1)]
    shape = np.concatenate([block((0, 0), (x, y, 0.04), bottom_m=z), *legs])
    return Thing("table", turned(shape, random.uniform(0, 90)), float(np.hypot(x, y) / 2))


def _panel(random: np.random.Generator, height_m: float) -> Thing:
    """An upright screen that faces the rig more or less."""
    width, high = random.uniform(0.6, 1.4), random.uniform(0.4, 0.7) * height_m
    flat = quad((0, width / 2, 0), (0, -width, 0), (0, 0, high))
    lifted = moved(turned(flat, 45 + random.uniform(-35, 35)), (0, 0, random.uniform(0.05, 0.2) * height_m))
    return Thing("panel", lifted, width / 2)


def _round_column(random: np.random.Generator, height_m: float) -> Thing:
    radius = random.uniform(0.15, 0.4)

    def place(angle: FloatArray, height: FloatArray) -> FloatArray:
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)

    return Thing(
        "round column", sheet(place, np.linspace(0, 2 * np.pi, 41), np.linspace(0, height_m, 7)), float(radius)
    )


def _vase(random: np.random.Generator, height_m: float) -> Thing:
    heights, radii = np.linspace(0, 1, 7), np.append(random.uniform(0.15, 0.45, 6), 0.0)
    high = random.uniform(0.5, 0.85) * height_m

    def place(angle: FloatArray, height: FloatArray) -> FloatArray:
        radius = np.interp(height, heights, radii)
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), high * height], axis=-1)

    shape = sheet(place, np.linspace(0, 2 * np.pi, 37), np.linspace(0, 1, 25))
    return Thing("vase", shape, float(radii.max()))


def _dome(random: np.random.Generator, _height_m: float) -> Thing:
    radius = random.uniform(0.3, 0.8)

    def place(angle: FloatArray, elevation: FloatArray) -> FloatArray:
        around = radius * np.cos(elevation)
        return np.stack([around * np.cos(angle), around * np.sin(angle), radius * np.sin(elevation)], axis=-1)

    shape = sheet(place, np.linspace(0, 2 * np.pi, 41), np.linspace(0, np.pi / 2, 13))
    return Thing("dome", shape, float(radius))


Builder = Callable[[np.random.Generator, float], Thing]
"""Of a random thing in a room of some height."""

THINGS: tuple[Builder, ...] = (
    _box,
    _column,
    _table,
    _panel,
    _round_column,
    _vase,
    _dome,
)


Free = Callable[[FloatArray, float], bool]
"""Whether a thing may stand at a place (2,), which needs a circle of some radius. [m]"""


def standing_apart(
    random: np.random.Generator, size_m: Point, builders: Sequence[Builder], count: int, free_of_room: Free
) -> list[Thing]:
    """So many things, or as many as find a place, in the half of the room that the rig looks at."""
    things: list[Thing] = []
    circles: list[tuple[FloatArray, float]] = []
    for _ in range(count):
        thing = builders[int(random.integers(len(builders)))](random, size_m[2])
        for _ in range(_TRIES):
            at = random.uniform(0.42, 0.95, 2) * size_m[:2]
            free = all(np.linalg.norm(at - where) > thing.radius_m + radius + _APART_M for where, radius in circles)
            if free and free_of_room(at, thing.radius_m + _FROM_WALL_M):
                circles.append((at, thing.radius_m))
                things.append(Thing(thing.kind, moved(thing.triangles_m, (at[0], at[1], 0.0)), thing.radius_m))
                break
    return things


def placed(random: np.random.Generator, size_m: Point) -> list[Thing]:
    """One to five things."""
    count = int(random.integers(1, 6))
    return standing_apart(random, size_m, THINGS, count, lambda at, radius_m: bool((at + radius_m < size_m[:2]).all()))
