"""The scene that a profile names: of the library or of a file, with the profile's own materials."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from rig.devices.simulated.mesh.scene import FloatArray, TriangleScene
from rig.devices.simulated.settings import BANDS, SimulatedMaterial, SimulationSettings
from rig.devices.simulated.worlds.scenes import SCENES, library_scene
from rig.errors import ProfileError, UsageError
from rig.files.mesh import read_triangles

ANY = "*"
"""Name of the material of triangles that have no colour."""


def find_scene(settings: SimulationSettings, folder: Path) -> TriangleScene:
    """Make or read the scene of a simulation, relative files in `folder`.

    Raises
    ------
    ProfileError
        There is no such scene; the file cannot be read; a material is named that the scene has not; a triangle has no
        reflectance.
    """
    name = settings.scene or ""
    if name in SCENES:
        scene = library_scene(name, settings.size_m)
        faces = [SimulatedMaterial(name=face, reflectance=colour) for face, colour in settings.reflectance.items()]
        return with_materials(scene, (*faces, *settings.materials))
    if not settings.is_mesh_file:
        raise ProfileError(
            f"simulation.scene: is {name!r}, should be one of {', '.join(SCENES)}, or a mesh file "
            "(.obj, .ply, .gltf, .glb)"
        )
    return with_materials(_read(settings, folder), settings.materials)


def _read(settings: SimulationSettings, folder: Path) -> TriangleScene:
    path = folder / str(settings.scene)
    try:
        soup = read_triangles(path, unit=settings.scene_unit, up=settings.scene_up)
    except UsageError as error:
        raise ProfileError(f"simulation.scene: {error}") from error
    names = tuple(dict.fromkeys(soup.materials))
    return TriangleScene(
        name=path.name,
        triangles_m=soup.points[soup.triangles],
        material=np.array([names.index(one) for one in soup.materials], dtype=np.int64),
        materials=names,
        reflectance=soup.colours,
        gloss=soup.gloss,
        roughness=soup.roughness,
    )


def with_materials(scene: TriangleScene, materials: Iterable[SimulatedMaterial]) -> TriangleScene:
    """Return a scene with some materials overruled. Raises ProfileError."""
    reflectance, gloss, roughness = scene.reflectance.copy(), scene.gloss.copy(), scene.roughness.copy()
    for one in materials:
        if one.name != ANY and one.name not in scene.materials:
            raise ProfileError(
                f"simulation.material: the scene {scene.name} has none named {one.name!r}; it has "
                f"{', '.join(scene.materials)}"
            )
        if one.name == ANY:
            on = np.isnan(reflectance).any(axis=1)
        else:
            on = scene.material == scene.materials.index(one.name)
        if one.reflectance is not None:
            reflectance[on] = _in_bands(one.reflectance)
        if one.gloss is not None:
            gloss[on] = one.gloss
        if one.roughness is not None:
            roughness[on] = one.roughness
    if bare := int(np.isnan(reflectance).any(axis=1).sum()):
        raise ProfileError(
            f"simulation.scene {scene.name}: {bare} of {len(reflectance)} triangles have no colour; give them one: "
            f'[[simulation.material]] with name = "{ANY}" and a reflectance'
        )
    return replace(scene, reflectance=reflectance, gloss=gloss, roughness=roughness)


def _in_bands(colour: tuple[float, ...]) -> FloatArray:
    return np.broadcast_to(np.array(colour), (BANDS,))
