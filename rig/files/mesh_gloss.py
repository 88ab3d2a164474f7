"""Gloss of mesh files: metal and roughness of glTF materials, as the lobe that model and simulated world share.

A material that states its ``metallicFactor`` m and ``roughnessFactor`` r has the lobe's alpha r², a gloss of
0.04 (1 - m) + m Y, Y the luminance of its base colour, and the matte colour base (1 - m) (1 - 0.04): glTF's mixing
without Fresnel's rise towards grazing light. One that leaves either out, or has them in a picture, is matte:
exporters of paint leave them out, though the standard then speaks of metal.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.files.pictures import LUMINANCE
from sim.errors import SimulationError
from sim.geometry.adaptive_patches import AdaptivePatches
from sim.geometry.mesh import Mesh
from sim.geometry.rays import trace

if TYPE_CHECKING:
    from rig.files.mesh import Unit

FloatArray = NDArray[np.float64]

DIELECTRIC = 0.04
"""Gloss of what is no metal: glTF's, an index of refraction of 1.5."""
MATTE_ROUGHNESS = 0.3
"""Of materials without gloss, where it has no meaning."""
LEAST_ALPHA = 1e-3
"""Smaller ones become this: a mirror image to any camera."""
_MOST = 0.99
"""Of a gloss: that of a polished metal."""
_ABOVE = 1e-6
"""Of the mesh's size: from there a patch's middle looks down on its triangle."""


@dataclass(frozen=True, slots=True)
class MaterialGloss:
    """What one material reflects besides its matte part."""

    gloss: float = 0.0
    roughness: float = MATTE_ROUGHNESS
    """The GGX distribution's alpha."""
    matte_share: float = 1.0
    """Of its colour, that is matte."""


def gloss_of_material(material: Any) -> MaterialGloss:
    """Return the gloss of one material as the reader has it; none where it states none."""
    metal, roughness = (getattr(material, name, None) for name in ("metallicFactor", "roughnessFactor"))
    pictured = getattr(material, "metallicRoughnessTexture", None) is not None
    colour = getattr(material, "baseColorFactor", None)
    if metal is None or roughness is None or colour is None or pictured:
        return MaterialGloss()
    metal, roughness = float(np.clip(metal, 0, 1)), float(np.clip(roughness, 0, 1))
    luminance = float(np.asarray(colour, dtype=np.float64)[:3] @ LUMINANCE) / 255
    gloss = min(DIELECTRIC * (1 - metal) + metal * luminance, _MOST)
    return MaterialGloss(gloss, max(roughness**2, LEAST_ALPHA), (1 - metal) * (1 - DIELECTRIC))


@dataclass(frozen=True, eq=False, kw_only=True)
class PatchGloss:
    """What a file's materials say of a mesh's patches."""

    gloss: FloatArray
    """(P,) 0: matte."""
    roughness: FloatArray
    """(P,) alpha."""
    matte_share: FloatArray
    """(P,) of the patches' colours, that is matte."""


def read_gloss(path: str | Path, mesh: Mesh, *, unit: Unit = "m", up: Literal["y", "z"] | None = None) -> PatchGloss:
    """Read the gloss of a mesh's patches from its file: that of the triangle under each one's middle.

    Parameters
    ----------
    mesh
        As :func:`rig.files.mesh.read_mesh` made it of the same file, unit and axis.

    Raises
    ------
    UsageError
        If the file cannot be read, or a patch of the mesh is not in it.
    """
    from rig.files.mesh import read_triangles

    soup = read_triangles(path, unit=unit, up=up)
    if not (soup.gloss > 0).any():
        n = mesh.n_patches
        return PatchGloss(gloss=np.zeros(n), roughness=np.full(n, MATTE_ROUGHNESS), matte_share=np.ones(n))
    corners = soup.points[soup.triangles]
    flat = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) <= 0
    number = np.flatnonzero(~flat)
    found = number[_triangle_under(mesh, corners[number], path)]
    return PatchGloss(gloss=soup.gloss[found], roughness=soup.roughness[found], matte_share=soup.matte_share[found])


def _triangle_under(mesh: Mesh, corners_m: FloatArray, path: str | Path) -> NDArray[np.intp]:
    """(P,) triangle that lies under the middle of each patch, whichever way it looks."""
    n = len(corners_m)
    triangles = AdaptivePatches(
        name=mesh.name,
        vertices=corners_m[:, [0, 1, 2, 2]],
        reflectance=np.zeros(n),
        region=np.arange(n),
        whole=np.arange(n),
        occluders=np.zeros((0, 4, 3)),
        convex=False,
        closed=False,
    )
    above_m = _ABOVE * float(np.ptp(mesh.vertices.reshape(-1, 3), axis=0).max())
    # Of its first three corners: within one of its triangles, whichever diagonal parts them.
    middle = mesh.vertices[:, :3].mean(axis=1)
    try:
        hits = trace(triangles, middle + above_m * mesh.normals, -mesh.normals)
    except SimulationError as error:
        raise UsageError(f"{path}: {error}") from error
    if (missed := int((~(hits.distance < 2 * above_m)).sum())) > 0:
        raise UsageError(
            f"{path}: {missed} patches are on none of its triangles; give the unit and axis it was read by"
        )
    return np.asarray(hits.face, dtype=np.intp)
