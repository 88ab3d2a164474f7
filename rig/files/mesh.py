"""Rooms from files: OBJ, PLY, glTF and GLB, read by trimesh, held to the mesh's checks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.files.colour.srgb import linear_of_srgb
from rig.files.mesh_gloss import gloss_of_material
from rig.files.obj_mesh import obj_with_cut_faces
from rig.files.pictures import LUMINANCE
from rig.files.ply_mesh import read_ply_mesh
from sim.errors import SimulationError
from sim.geometry.checks import mesh_faults, refuse, refuse_extent
from sim.geometry.mending.judgement import UNITS_M as ROOM_UNITS_M
from sim.geometry.mesh import Mesh
from sim.geometry.quads import quads_from_triangles

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
Unit = Literal["m", "cm", "mm", "in", "inch", "ft"]
UpAxis = Literal["x", "y", "z", "-x", "-y", "-z"]

UNITS_M = {**ROOM_UNITS_M, "inch": ROOM_UNITS_M["in"]}
"""Metres of each unit, by all its names."""
TURNED_UP: dict[UpAxis, tuple[list[int], tuple[int, int, int]]] = {
    "x": ([1, 2, 0], (1, 1, 1)),
    "y": ([0, 2, 1], (1, -1, 1)),
    "z": ([0, 1, 2], (1, 1, 1)),
    "-x": ([1, 2, 0], (1, -1, -1)),
    "-y": ([0, 2, 1], (1, 1, -1)),
    "-z": ([0, 1, 2], (1, -1, -1)),
}
"""Which of a file's axes become x, y, z where one of them points up, and their signs: turned, never mirrored."""
FORMATS = (".obj", ".ply", ".stl", ".gltf", ".glb")


@np.errstate(over="ignore", invalid="ignore")  # of absurd numbers: what comes of them is judged afterwards
def read_mesh(
    path: str | Path,
    *,
    reflectance: float | None = None,
    unit: Unit = "m",
    up: UpAxis | None = None,
    colours: bool = True,
    join_quads: bool = True,
    thorough: bool = True,
    convex: bool | None = None,
    closed: bool | None = None,
) -> Mesh:
    """Read a mesh.

    Reflectance is the luminance (BT.709) of a patch's colour: the diffuse factor of its material (``Kd``,
    ``baseColorFactor``; taken as linear), else the colours of its corners or face (sRGB; linear in glTF), averaged.
    Materials with a picture have no colour here. glTF factors come in steps of 1/255.

    Parameters
    ----------
    reflectance : float, optional
        For patches without a colour. None: each needs one.
    unit : {"m", "cm", "mm", "in", "inch", "ft"}
        What the file's numbers are.
    up : {"x", "y", "z", "-x", "-y", "-z"}, optional
        The file's axis that points up. None: y for glTF, as its standard says, else z.
    colours : bool
        False: ignore the file's colours; ``reflectance`` holds for all.
    join_quads : bool
        Join triangles of one plane and colour to quads. The reader cuts all polygons into triangles.
    thorough : bool
        Also refuse patches that pierce or cover each other.
    convex, closed : bool, optional
        None: found out.

    Raises
    ------
    UsageError
        If the file is missing, of another format, broken, or its geometry is bad; names file and patches. A
        patch's number is its place in the mesh, which is not always the file's.
    """
    path = Path(path)
    if unit not in UNITS_M:
        raise UsageError(f"{path}: unknown unit {unit!r}; there are {', '.join(UNITS_M)}")
    is_gltf = path.suffix.lower() in (".gltf", ".glb")
    soup = _soup(_loaded(path), linear_colours=is_gltf)
    if not len(soup.triangles):
        raise UsageError(f"{path}: no faces in it; export surfaces, not points or lines")
    points = _turned_up(soup.points * UNITS_M[unit], up or standard_up(path))
    rho = _reflectances(path, soup.luminance, reflectance, colours)
    try:
        refuse_extent(path.stem, points)
        polygons, rho = _polygons(points, soup.triangles, rho, join_quads)
        mesh = Mesh.from_arrays(path.stem, points, polygons, rho, convex=convex, closed=closed)
        if thorough:
            refuse(mesh.name, mesh_faults(mesh, thorough=True))
    except SimulationError as error:
        raise UsageError(f"{path} (read as {unit}): {error}") from error
    return mesh


@dataclass(frozen=True, eq=False)
class _Soup:
    """All triangles of a file, in its unit and axes."""

    points: FloatArray
    """(V, 3)."""
    triangles: IntArray
    """(T, 3) into points."""
    luminance: FloatArray
    """(T,) of each triangle's colour; NaN where it has none."""


def _loaded(path: Path) -> Any:
    """The reader's scene."""
    import trimesh  # here, for it takes its time

    if path.suffix.lower() not in FORMATS:
        raise UsageError(f"{path}: unknown mesh format {path.suffix!r}; there are {', '.join(FORMATS)}")
    if not path.is_file():
        raise UsageError(f"{path}: no such file; check the name")
    try:
        if path.suffix.lower() == ".ply":
            return read_ply_mesh(path)
        if path.suffix.lower() == ".obj":
            text, folder = obj_with_cut_faces(path), trimesh.resolvers.FilePathResolver(str(path))
            return trimesh.load_scene(BytesIO(text.encode()), file_type="obj", resolver=folder, process=False)
        return trimesh.load_scene(path, process=False)
    except UsageError:
        raise
    except Exception as error:
        raise UsageError(f"{path}: cannot be read as {path.suffix[1:].upper()}: {error}; export it again") from error


def _meshes(scene: Any) -> Iterator[tuple[str, NDArray[Any], Any]]:
    """Names, places in the scene and triangles of what is a surface in it."""
    import trimesh  # here, for it takes its time

    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        if isinstance(scene.geometry[name], trimesh.Trimesh):
            yield name, transform, scene.geometry[name]


def _soup(scene: Any, linear_colours: bool) -> _Soup:
    points, triangles, luminance = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.intp)], [np.zeros(0)]
    count = 0
    for _, transform, geometry in _meshes(scene):
        faces = np.asarray(geometry.faces, dtype=np.intp)
        mirrored = np.linalg.det(transform[:3, :3]) < 0
        points.append(np.asarray(geometry.vertices) @ transform[:3, :3].T + transform[:3, 3])
        triangles.append(count + (faces[:, ::-1] if mirrored else faces))
        luminance.append(_luminance(geometry.visual, faces, linear_colours))
        count += len(geometry.vertices)
    return _Soup(np.concatenate(points), np.concatenate(triangles), np.concatenate(luminance))


def _luminance(visual: Any, faces: IntArray, linear_colours: bool) -> FloatArray:
    """(T,) luminance of each triangle's colour; NaN where the file gives none."""
    return np.asarray(_colours(visual, faces, linear_colours) @ LUMINANCE)


def _linear(colours: NDArray[np.uint8], already: bool) -> FloatArray:
    """(N, 3) linear light of (N, 4) 8-bit colours, by the curve of sRGB unless they are linear already."""
    share = np.asarray(colours, dtype=np.float64)[:, :3] / 255
    return share if already else linear_of_srgb(share)


def standard_up(path: Path) -> UpAxis:
    """Return the axis that points up in files of a format: y of glTF, z of all others."""
    return "y" if path.suffix.lower() in (".gltf", ".glb") else "z"


def _turned_up(points: FloatArray, up: UpAxis) -> FloatArray:
    order, signs = TURNED_UP[up]
    return np.asarray(points[:, order] * signs)


def reflectances_of_soup(path: Path, soup: TriangleSoup, reflectance: float | None) -> FloatArray:
    """Return (T,) reflectance of each triangle: the luminance of its colour, else the one given. Raises UsageError."""
    return _reflectances(path, np.asarray(soup.colours @ LUMINANCE), reflectance, colours=True)


def _reflectances(path: Path, luminance: FloatArray, reflectance: float | None, colours: bool) -> FloatArray:
    """(T,) reflectance: the colour's, else the one given."""
    missing = np.isnan(luminance) if colours else np.ones(len(luminance), dtype=bool)
    if missing.any() and reflectance is None:
        raise UsageError(
            f"{path}: {int(missing.sum())} of {len(missing)} triangles have no colour that can be used; "
            "give reflectance=..."
        )
    return np.where(missing, np.nan if reflectance is None else reflectance, luminance)


def _polygons(
    points: FloatArray, triangles: IntArray, rho: FloatArray, join_quads: bool
) -> tuple[IntArray, FloatArray]:
    """Corner numbers and reflectance of each patch."""
    if not join_quads or not np.isfinite(points).all():
        return triangles, rho
    polygons, first = quads_from_triangles(points, triangles, rho)
    return polygons, rho[first]


@dataclass(frozen=True, eq=False, kw_only=True)
class TriangleSoup:
    """All triangles of a file in metres, z up, as they are: nothing joined, nothing checked."""

    points: FloatArray
    """(V, 3)."""
    triangles: IntArray
    """(T, 3) into points."""
    colours: FloatArray
    """(T, 3) linear colour of the matte part; NaN where the file gives none."""
    materials: tuple[str, ...]
    """(T,) name of each triangle's material, else of its part."""
    gloss: FloatArray
    """(T,) share of light that a glossy lobe sends back at most (:mod:`rig.files.mesh_gloss`)."""
    roughness: FloatArray
    """(T,) its alpha."""
    matte_share: FloatArray
    """(T,) of the file's colour, that is matte and in ``colours``."""


@np.errstate(over="ignore", invalid="ignore")  # of absurd numbers: what comes of them is judged afterwards
def read_triangles(path: str | Path, *, unit: Unit = "m", up: UpAxis | None = None) -> TriangleSoup:
    """Read the triangles of a file with their colours, for who takes any mesh.

    Parameters
    ----------
    unit, up
        As :func:`read_mesh`.

    Raises
    ------
    UsageError
        If the file is missing, of another format, broken or empty.
    """
    path = Path(path)
    is_gltf = path.suffix.lower() in (".gltf", ".glb")
    scene = _loaded(path)
    soup = _soup(scene, linear_colours=is_gltf)
    if not len(soup.triangles):
        raise UsageError(f"{path}: no faces in it; export surfaces, not points or lines")
    points = _turned_up(soup.points * UNITS_M[unit], up or standard_up(path))
    colours, materials, lobes = [], [], []
    for name, _, geometry in _meshes(scene):
        material = gloss_of_material(getattr(geometry.visual, "material", None))
        lobe = (material.gloss, material.roughness, material.matte_share)
        lobes.append(np.tile(lobe, (len(geometry.faces), 1)))
        shades = _colours(geometry.visual, np.asarray(geometry.faces, dtype=np.intp), is_gltf)
        colours.append(material.matte_share * shades)
        named = str(getattr(getattr(geometry.visual, "material", None), "name", None) or name)
        materials += [named] * len(geometry.faces)
    gloss, roughness, matte_share = np.concatenate(lobes).T
    return TriangleSoup(
        points=points,
        triangles=soup.triangles,
        colours=np.concatenate(colours),
        materials=tuple(materials),
        gloss=gloss,
        roughness=roughness,
        matte_share=matte_share,
    )


def _colours(visual: Any, faces: IntArray, linear_colours: bool) -> FloatArray:
    """(T, 3) linear colour of each triangle; NaN where the file gives none."""
    material = getattr(visual, "material", None)
    if material is not None:
        return np.tile(_material_colour(material), (len(faces), 1))
    if not visual.defined:
        return np.full((len(faces), 3), np.nan)
    if visual.kind == "face":
        shades = _linear(visual.face_colors, linear_colours)
        # The reader may cut a face into two triangles and leave it one colour: which is whose is not known.
        return shades if len(shades) == len(faces) else np.full((len(faces), 3), np.nan)
    return np.asarray(_linear(visual.vertex_colors, linear_colours)[faces].mean(axis=1))


def _material_colour(material: Any) -> FloatArray:
    pictures = [getattr(material, name, None) for name in ("image", "baseColorTexture")]
    if any(picture is not None for picture in pictures):
        return np.full(3, np.nan)
    exact = getattr(material, "kwargs", {}).get("kd")
    if exact is not None and np.size(exact) == 3:
        return np.asarray(exact, dtype=np.float64)
    factor = getattr(material, "baseColorFactor", None)
    return np.full(3, np.nan) if factor is None else np.asarray(factor, dtype=np.float64)[:3] / 255
