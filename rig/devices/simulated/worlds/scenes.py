"""The library's scenes. All stand in one room, so that the same cameras and projectors look at each of them.

The devices are thought to stand near the corner at the origin and to look towards the opposite one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from rig.devices.simulated.mesh.scene import TriangleScene
from rig.devices.simulated.worlds.shapes import FloatArray, Point, block, moved, quad, room, sheet, turned

_DIAGONAL_DEG = 45.0
"""The way in which the devices look."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A piece of a scene that is of one material."""

    material: str
    triangles_m: FloatArray
    reflectance: float
    gloss: float = 0.0
    roughness: float = 0.3


WALLS: Mapping[str, float] = {"floor": 0.66, "ceiling": 0.76, "x0": 0.70, "x1": 0.71, "y0": 0.69, "y1": 0.68}
"""Reflectance of the room's faces unless the profile says otherwise: those of the paper's room."""


def _walls(size_m: Point) -> list[Part]:
    return [Part(material=name, triangles_m=wall, reflectance=WALLS[name]) for name, wall in room(size_m).items()]


def _furnished(size_m: Point) -> list[Part]:
    """A table, a column and a box."""
    x, y, z = size_m
    table = (0.72 * x, 0.52 * y)
    legs = [block((table[0] + a, table[1] + b), (0.06, 0.06, 0.7)) for a in (-0.45, 0.45) for b in (-0.25, 0.25)]
    top = block(table, (1.1, 0.7, 0.04), bottom_m=0.7)
    return [
        *_walls(size_m),
        Part(material="table", triangles_m=np.concatenate([top, *legs]), reflectance=0.45),
        Part(material="column", triangles_m=block((0.68 * x, 0.86 * y), (0.3, 0.3, z)), reflectance=0.6),
        Part(
            material="box",
            triangles_m=block((0.55 * x, 0.70 * y), (0.5, 0.4, 0.55), turn_deg=28.0),
            reflectance=0.35,
        ),
    ]


def _cylinder(size_m: Point) -> list[Part]:
    """A half-cylinder screen that is open towards the devices."""
    x, y, z = size_m
    radius, bottom, top = 0.33 * min(x, y), 0.1 * z, 0.9 * z

    def place(angle: FloatArray, height: FloatArray) -> FloatArray:
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)

    screen = sheet(place, np.linspace(np.pi / 2, -np.pi / 2, 41), np.linspace(bottom, top, 17))
    screen = moved(turned(screen, _DIAGONAL_DEG), (0.60 * x, 0.60 * y, 0))
    return [*_walls(size_m), Part(material="screen", triangles_m=screen, reflectance=0.8)]


def _dome(size_m: Point) -> list[Part]:
    """A quarter of a sphere that stands on the floor, open towards the devices."""
    x, y, z = size_m
    radius = min(0.36 * x, 0.36 * y, 0.9 * z)

    def place(angle: FloatArray, elevation: FloatArray) -> FloatArray:
        around = radius * np.cos(elevation)
        return np.stack([around * np.cos(angle), around * np.sin(angle), radius * np.sin(elevation)], axis=-1)

    shell = sheet(place, np.linspace(np.pi / 2, -np.pi / 2, 33), np.linspace(0, np.pi / 2, 17))
    shell = moved(turned(shell, _DIAGONAL_DEG), (0.60 * x, 0.60 * y, 0))
    return [*_walls(size_m), Part(material="screen", triangles_m=shell, reflectance=0.75)]


def _relief(size_m: Point) -> list[Part]:
    """A figure of smooth bulges on a plinth, in the corner that the devices look at."""
    x, y, z = size_m
    foot, top = 0.16 * z, 0.86 * z
    heights = np.array([0.0, 0.06, 0.25, 0.45, 0.62, 0.72, 0.78, 0.86, 0.96, 1.0])
    radii = np.array([0.30, 0.34, 0.22, 0.30, 0.36, 0.16, 0.12, 0.20, 0.12, 0.0])

    def place(angle: FloatArray, height: FloatArray) -> FloatArray:
        radius = np.interp(height, heights, radii) * (
            1 + 0.10 * np.cos(3 * angle + 5 * height) + 0.05 * np.cos(7 * angle - 9 * height)
        )
        level = foot + height * (top - foot)
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), level], axis=-1)

    figure = sheet(place, np.linspace(0, 2 * np.pi, 37), np.linspace(0, 1, 31))
    plinth = block((0.74 * x, 0.74 * y), (0.8, 0.8, foot), turn_deg=20.0)
    return [
        *_walls(size_m),
        Part(material="figure", triangles_m=moved(figure, (0.74 * x, 0.74 * y, 0)), reflectance=0.7),
        Part(material="plinth", triangles_m=plinth, reflectance=0.5),
    ]


def _l_room(size_m: Point) -> list[Part]:
    """A wall from one side into the room, which hides half of it from the devices."""
    x, y, z = size_m
    wall = block((0.55 * x, 0.24 * y), (0.1, 0.48 * y, z))
    return [*_walls(size_m), Part(material="partition", triangles_m=wall, reflectance=0.7)]


def _glossy(size_m: Point) -> list[Part]:
    """A satin wall and a gloss floor."""
    lobes = {"x1": (0.45, 0.25, 0.3), "floor": (0.40, 0.25, 0.1)}
    return [
        Part(
            material=part.material,
            triangles_m=part.triangles_m,
            reflectance=lobes[part.material][0],
            gloss=lobes[part.material][1],
            roughness=lobes[part.material][2],
        )
        if part.material in lobes
        else part
        for part in _walls(size_m)
    ]


def _gain_screen(size_m: Point) -> list[Part]:
    """A flat screen across the corner that sends more light forwards than a matte one."""
    x, y, z = size_m
    width, height = 0.5 * min(x, y), 0.6 * z
    screen = quad((0, width / 2, 0), (0, -width, 0), (0, 0, height))
    screen = moved(turned(screen, _DIAGONAL_DEG), (0.72 * x, 0.72 * y, 0.2 * z))
    lobe = Part(material="screen", triangles_m=screen, reflectance=0.45, gloss=0.45, roughness=0.4)
    return [*_walls(size_m), lobe]


SCENES: Mapping[str, Callable[[Point], list[Part]]] = {
    "furnished": _furnished,
    "cylinder": _cylinder,
    "dome": _dome,
    "relief": _relief,
    "l-room": _l_room,
    "glossy": _glossy,
    "gain-screen": _gain_screen,
}
"""What makes each scene in a room of a size."""


def library_scene(name: str, size_m: Point) -> TriangleScene:
    """Make a scene of the library. Raises KeyError for a name that is none."""
    parts = SCENES[name](size_m)
    names = tuple(dict.fromkeys(part.material for part in parts))
    counts = [len(part.triangles_m) for part in parts]

    def each(values: list[float]) -> FloatArray:
        return np.repeat(np.array(values), counts)

    return TriangleScene(
        name=name,
        triangles_m=np.concatenate([part.triangles_m for part in parts]),
        material=np.repeat([names.index(part.material) for part in parts], counts),
        materials=names,
        reflectance=np.repeat(each([part.reflectance for part in parts])[:, None], 3, axis=1),
        gloss=each([part.gloss for part in parts]),
        roughness=each([part.roughness for part in parts]),
    )
