"""Meshes of very many facets simplified, and by how much what stands for them is off.

Edges are collapsed in the order of the quadric error (Garland and Heckbert 1997) by the library fast-simplification.
How much light the simpler surface gets wrong is not guessed from its distance: rays leave points of the *original*
surface, meet the original, and bring what the simpler one's solution holds at the place that was met. What they bring
less what the solution says arrives is the solution's residual D = F B - H on the original geometry. With reflectance
rho the error e of the radiosity obeys e = rho D + rho F e: what D has everywhere alike is amplified by bounces.
Each point's rays come in two independent halves, whose product has no bias by noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from sim.arrays import BoolArray, FloatArray
from sim.errors import SimulationError
from sim.geometry.mending.cleaning import cleaned
from sim.geometry.mending.collapse import collapsed, library_is_there
from sim.geometry.mending.remarks import Facets
from sim.geometry.mending.tracing import Tracing

POINTS, RAYS = 4096, 64
"""Of the original where the light is compared, and rays of each: 0.2 % of white where it is 3 % off."""
SURE = 2.0
"""Standard deviations of the mean over points that are added to it."""
MATERIAL_STEPS = 1e-6
"""Reflectances nearer than this are one material."""


def simplified(facets: Facets, count: int) -> Facets:
    """Return about ``count`` facets in the place of many; each material by itself, their common borders kept.

    Raises
    ------
    SimulationError
        If the library is missing or fails.
    """
    if not library_is_there():
        raise SimulationError(
            f"{facets.n_facets:,} facets are more than a plan takes; they can be simplified: "
            "pip install 'procam-rig[meshes]'"
        )
    _, material = np.unique(np.round(facets.reflectance / MATERIAL_STEPS), return_inverse=True)
    material = material.reshape(-1)
    borders = int(material.max()) > 0
    points, triangles, source, have = [], [], [], 0
    for one in range(int(material.max()) + 1):
        here = np.flatnonzero(material == one)
        used, corners = np.unique(facets.triangles[here], return_inverse=True)
        place, corners = np.ascontiguousarray(facets.points[used]), corners.reshape(-1, 3)
        goal = max(count * len(here) // facets.n_facets, 4)
        if goal < len(here):
            place, corners = collapsed(place, corners, goal, borders=borders)
        nearest = KDTree(facets.corners[here].mean(axis=1)).query(place[corners].mean(axis=1))[1]
        source.append(here[nearest])
        points.append(place)
        triangles.append(corners + have)
        have += len(place)
    index = np.concatenate(source)
    simple = Facets(
        points=np.concatenate(points),
        triangles=np.concatenate(triangles),
        reflectance=facets.reflectance[index],
        source=facets.source[index],
    )
    # Collapsing edges leaves some facets without area.
    return cleaned(simple, merge_m=0.0)[0]


@dataclass(frozen=True, eq=False, kw_only=True)
class TracedPoints:
    """Points of a mesh, by area, and what rays from them meet first on it."""

    places: FloatArray
    """(N, 3) [m]."""
    normals: FloatArray
    """(N, 3)."""
    lit: BoolArray
    """(N, R) rays that meet a lit side."""
    met_places: FloatArray
    """(M, 3) where the lit ones meet it, row by row [m]."""
    met_normals: FloatArray
    """(M, 3)."""

    @classmethod
    def of(cls, facets: Facets) -> TracedPoints:
        """Return 4,096 points of a mesh's facets and their rays, always the same."""
        areas = facets.areas
        ends = np.cumsum(areas)
        facet = np.minimum(np.searchsorted(ends, (np.arange(POINTS) + 0.5) / POINTS * ends[-1]), len(areas) - 1)
        tracing = Tracing.of(facets)
        u = np.random.default_rng(0).random((POINTS, RAYS, 4))
        places, normals = tracing.points(facet, u[:, 0, :2])
        directions = tracing.directions(np.repeat(facet, RAYS), u[:, :, 2:].reshape(-1, 2))
        origins = np.repeat(places + tracing.lift_m * normals, RAYS, axis=0)
        met, cosine, distance = tracing.first_met(origins, directions)
        lit = (met >= 0) & (cosine > 0)
        return cls(
            places=places,
            normals=normals,
            lit=lit.reshape(POINTS, RAYS),
            met_places=(origins + np.where(lit, distance, 0.0)[:, None] * directions)[lit],
            met_normals=tracing.normals[met[lit]],
        )


@dataclass(frozen=True, kw_only=True)
class SimplificationError:
    """What a solution on a simpler surface gets wrong on the original."""

    light: float
    """RMS over the surface of the radiosity, with two standard deviations; 1 = white."""
    distance_m: float
    """Within which 95 % of the original lies of the simpler surface, along its normals."""


def simplification_error(
    original: TracedPoints, simpler: Facets, B: FloatArray, H: FloatArray, *, spectral_radius: float
) -> SimplificationError:
    """Return what a solution on a simpler surface gets wrong on the original, of radiosity and distance.

    Parameters
    ----------
    original : TracedPoints
    simpler : Facets
        What the solution was made on, its patches in triangles.
    B, H : (T,) array
        Radiosity and irradiance of each; 1 = white.
    spectral_radius : float
        Share of the light that a bounce keeps.

    Returns
    -------
    SimplificationError
        Of all that the solution gets wrong, the size of its patches and its own noise included.
    """
    tracing = Tracing.of(simpler)
    at, distance_m = tracing.nearest_along(original.places, original.normals)
    brought = np.zeros(original.lit.shape)
    brought[original.lit] = B[tracing.nearest_along(original.met_places, original.met_normals)[0]]
    halves = [simpler.reflectance[at] * (brought[:, k::2].mean(axis=1) - H[at]) for k in (0, 1)]
    product, mean = halves[0] * halves[1], (halves[0] + halves[1]) / 2
    squared = float(product.mean()) + SURE * float(product.std()) / np.sqrt(len(product))
    common = abs(float(mean.mean()))
    light = np.sqrt(max(squared - common**2, 0.0)) + common / max(1 - spectral_radius, 1e-6)
    return SimplificationError(
        light=float(light),
        distance_m=float(np.quantile(distance_m, 0.95)),
    )
