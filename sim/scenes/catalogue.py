"""The surfaces that can be planned by name, as coarse as their shape allows, each with the light one expects."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from sim.geometry.mesh import Mesh
from sim.geometry.scene import Scene
from sim.scenes.cluttered import corner_with_ball
from sim.scenes.gridded import LIBRARY, furnished_room
from sim.scenes.meshes import integrating_sphere, sloped_room

COARSEST_M = 100.0
"""A patch size at which every face is one patch."""


@dataclass(frozen=True)
class Entry:
    """A surface and its standard light."""

    build: Callable[[], Scene | Mesh]
    light: str
    """One of ``sim.light.lighting.TEST_LIGHTINGS``."""


LIGHT_OF: Mapping[str, str] = {"corner": "floor", "furnace": "uniform"}
"""Other scenes are lit by the projector."""

SURFACES: Mapping[str, Entry] = {
    **{name: Entry(lambda name=name: LIBRARY[name](COARSEST_M), LIGHT_OF.get(name, "projector")) for name in LIBRARY},  # type: ignore[misc]
    "sloped-room": Entry(lambda: sloped_room(COARSEST_M), "projector"),
    "furnished-room": Entry(lambda: furnished_room(COARSEST_M), "projector"),
    "sphere": Entry(integrating_sphere, "floor"),
    "corner-with-ball": Entry(corner_with_ball, "uniform"),
}
