"""From any triangles to a mesh that light can be computed in, or to the reason why not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sim.arguments import array_of
from sim.arrays import FloatArray, IntArray
from sim.errors import SimulationError
from sim.geometry.checks import refuse_extent
from sim.geometry.mending.cleaning import border_edges, cleaned
from sim.geometry.mending.judgement import judged
from sim.geometry.mending.orientation import oriented, sheets_of
from sim.geometry.mending.remarks import DamagedMesh, Facets, Remark, counted, named
from sim.geometry.mesh import Mesh
from sim.geometry.quads import quads_from_triangles

ASTRAY_SHARE, ASTRAY_TIMES = 0.05, 1e3
"""Facets so few that reach so many times farther out than the others are taken for damaged."""

Sides = Literal["judged", "file", "both"]


@dataclass(frozen=True, eq=False, kw_only=True)
class MendedMesh:
    """A mesh and what was wrong with it."""

    mesh: Mesh
    remarks: tuple[Remark, ...]
    by_rays: bool
    """Whether only form factors by rays are sure not to create light: facets cut each other, or more than two meet."""


def facets_of(points_m: FloatArray, triangles: IntArray, reflectance: FloatArray) -> Facets:
    """Return triangles as the stages of mending take them.

    Parameters
    ----------
    points_m : (V, 3) array
        Corners. [m]
    triangles : (T, 3) int array
        Into the corners, counter-clockwise seen from the lit side.
    reflectance : (T,) array or float

    Raises
    ------
    SimulationError
        For a corner that does not exist, or arrays of another shape.
    """
    points, corners = array_of("corners", points_m), np.asarray(triangles)
    if points.ndim != 2 or points.shape[1] != 3 or corners.ndim != 2 or corners.shape[1] != 3:
        raise SimulationError(f"corners {points.shape} and triangles {corners.shape}; expected (V, 3) and (T, 3)")
    lost = np.flatnonzero(((corners < 0) | (corners >= len(points))).any(axis=1))
    if len(lost):
        raise SimulationError(
            f"{len(lost)} triangles have corners that do not exist, first {lost[0]}: {corners[lost[0]].tolist()}, "
            f"there are 0 ... {len(points) - 1}; correct the triangles, or add the corners"
        )
    shares = np.broadcast_to(np.asarray(reflectance, dtype=np.float64), (len(corners),)).copy()
    return Facets(points=points, triangles=corners.astype(np.intp), reflectance=shares, source=np.arange(len(corners)))


def cleaned_facets(name: str, facets: Facets, merge_m: float | None = None) -> tuple[Facets, tuple[Remark, ...]]:
    """Return facets with area, once each, their nearly meeting borders merged, and what was done.

    Raises
    ------
    DamagedMesh
        If a corner is not finite, nothing is left, or the scene is smaller than 1 cm or larger than 1 km.
    """
    astray = _astray(facets)
    refuse_remarks(name, astray)
    try:
        refuse_extent(name, facets.points[np.unique(facets.triangles[facets.finite])])
    except SimulationError as error:
        raise DamagedMesh(str(error), ()) from error
    left, remarks = cleaned(facets, merge_m)
    refuse_remarks(name, remarks)
    if not left.n_facets:
        raise DamagedMesh(f"mesh {name}: no facet has an area; export surfaces, and check the scale", tuple(remarks))
    return left, tuple(remarks)


def mended(
    name: str, facets: Facets, *, sides: Sides = "judged", up: str = "z", unit: str = "m", unit_given: bool = True
) -> MendedMesh:
    """Return a mesh of clean facets, turned where they must be, with all that is worth knowing about it.

    Parameters
    ----------
    name : str
        What messages call it.
    facets : Facets
        As :func:`cleaned_facets` gives them.
    sides : {"judged", "file", "both"}
        Which sides are lit: turned where neighbours contradict or a sheet looks into nothing; as the file has them; or
        judged, and open sheets on both sides.
    up, unit, unit_given
        How the file was read, for words about it.

    Returns
    -------
    MendedMesh

    Raises
    ------
    DamagedMesh
        For a sheet with one side only, or area that counts twice.
    """
    remarks: list[Remark] = []
    if sides != "file":
        facets, remarks = oriented(facets)
        refuse_remarks(name, remarks)
    lit = _with_second_sides(facets) if sides == "both" else facets
    judgement = judged(facets, lit, up=up, unit=unit, unit_given=unit_given)
    remarks += judgement.remarks
    refuse_remarks(name, remarks)
    mesh = _mesh(name, lit)
    return MendedMesh(mesh=mesh, remarks=tuple(remarks), by_rays=judgement.by_rays or sides == "both")


def _astray(facets: Facets) -> list[Remark]:
    """A few facets that reach so far out that nothing else has a size beside them."""
    corners = facets.corners[facets.finite]
    if not len(corners):
        return []
    reach = np.abs(corners - np.median(corners.reshape(-1, 3), axis=0)).max(axis=(1, 2))
    usual = float(np.quantile(reach, 1 - ASTRAY_SHARE, method="lower"))
    far = np.flatnonzero(reach > ASTRAY_TIMES * usual)
    if not len(far) or usual == 0:
        return []
    which = np.flatnonzero(facets.finite)[far]
    message = (
        f"{counted(len(far))} reach {reach.max():.3g} m out of a scene of {2 * usual:.3g} m: {named(facets, which)}; "
        "correct the corner, or remove what lies far away"
    )
    return [Remark(kind="astray", outcome="refused", message=message, facets=facets.source[which])]


def refuse_remarks(name: str, remarks: list[Remark]) -> None:
    """Raise DamagedMesh, a line for each remark that is ``refused``."""
    refused = [remark for remark in remarks if remark.outcome == "refused"]
    if refused:
        lines = "".join(f"\n  {remark}" for remark in refused)
        raise DamagedMesh(f"mesh {name}: bad geometry{lines}", tuple(remarks))


def oriented_facets(name: str, facets: Facets, sides: Sides) -> Facets:
    """Return facets with the sides lit that :func:`mended` lights.

    Raises
    ------
    DamagedMesh
        For a sheet with one side only.
    """
    if sides == "file":
        return facets
    facets, remarks = oriented(facets)
    refuse_remarks(name, remarks)
    return _with_second_sides(facets) if sides == "both" else facets


def _with_second_sides(facets: Facets) -> Facets:
    """Sheets with an open border once more, turned."""
    label = sheets_of(facets)
    _, owner = border_edges(facets.triangles)
    open_ones = np.flatnonzero(np.isin(label, label[owner]))
    return Facets(
        points=facets.points,
        triangles=np.concatenate([facets.triangles, facets.triangles[open_ones][:, ::-1]]),
        reflectance=np.concatenate([facets.reflectance, facets.reflectance[open_ones]]),
        source=np.concatenate([facets.source, facets.source[open_ones]]),
    )


def _mesh(name: str, facets: Facets) -> Mesh:
    """Quads where two facets make one, checked once more by the mesh itself."""
    polygons, first = quads_from_triangles(facets.points, facets.triangles, facets.reflectance)
    try:
        return Mesh.from_arrays(name, facets.points, polygons, facets.reflectance[first])
    except SimulationError as error:
        raise DamagedMesh(str(error), ()) from error
