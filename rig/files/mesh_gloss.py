"""Gloss of mesh files: metal and roughness of glTF materials, as the lobe that model and simulated world share.

A material that states its ``metallicFactor`` m and ``roughnessFactor`` r has the lobe's alpha r², a gloss of
0.04 (1 - m) + m Y, Y the luminance of its base colour, and the matte colour base (1 - m) (1 - 0.04): glTF's mixing
without Fresnel's rise towards grazing light. One that leaves either out, or has them in a picture, is matte:
exporters of paint leave them out, though the standard then speaks of metal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from rig.files.pictures import LUMINANCE
from sim.geometry.adaptive_patches import AdaptivePatches
from sim.geometry.mesh import Mesh
from sim.geometry.rays import trace

if TYPE_CHECKING:
    from rig.files.mesh import TriangleSoup

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


def gloss_of_patches(soup: TriangleSoup, mesh: Mesh) -> PatchGloss:
    """Return the gloss of a mesh's patches: that of the triangle of its file under each one's middle.

    Parameters
    ----------
    soup
        Triangles of the file.
    mesh
        Of the same triangles. Where it was mended or simplified, no triangle may be under a patch: then the one whose
        middle is nearest speaks for it.
    """
    corners = soup.points[soup.triangles]
    flat = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 0
    number = np.flatnonzero(flat & np.isfinite(corners).all(axis=(1, 2)))
    found = number[_triangle_under(mesh, corners[number])]
    return PatchGloss(gloss=soup.gloss[found], roughness=soup.roughness[found])


def _triangle_under(mesh: Mesh, corners_m: FloatArray) -> NDArray[np.intp]:
    """(P,) triangle that lies under the middle of each patch, whichever way it looks, or else is nearest."""
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
    hits = trace(triangles, middle + above_m * mesh.normals, -mesh.normals)
    found = np.asarray(hits.face, dtype=np.intp)
    missed = ~(hits.distance < 2 * above_m)
    if missed.any():
        found[missed] = cKDTree(corners_m.mean(axis=1)).query(middle[missed])[1]
    return found
