"""A library of scenes, from the paper's room to the small ones whose answer is known exactly.

Grid axes (columns along u, rows along v): floor x, y; ceiling y, x; the walls ``x0`` (x = 0) y, z;
``x1`` -y, z; ``y0`` -x, z; ``y1`` x, z. Wall rows count upwards, columns to the right seen from inside.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from sim.arguments import number_of, numbers_of
from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.geometry.scene import Face, Scene

ROOM_FACES = ("floor", "ceiling", "x0", "x1", "y0", "y1")
Reflectance = float | Mapping[str, float]


def room(
    size_m: tuple[float, float, float] = (4.8, 4.8, 2.4),
    patch_size_m: float = 0.4,
    reflectance: Reflectance = 0.7,
    faces: Sequence[str] = ROOM_FACES,
    name: str = "room",
) -> Scene:
    """Return a box-shaped room seen from inside, one corner at the origin, or some of its faces.

    Parameters
    ----------
    size_m : (float, float, float)
        Edge lengths along x, y and z. [m]
    patch_size_m : float
        Wanted patch size; the count along an edge is rounded, at least 1. [m]
    reflectance : float or mapping of face name to float
        In [0, 1].
    faces : sequence of str
        Which of ``ROOM_FACES`` there are.
    name : str
        What messages call it.

    Returns
    -------
    Scene

    Raises
    ------
    SimulationError
        For no face or an unknown one, a size that is no number above 0, more patches than fit in memory, or a face
        without reflectance.
    """
    if not isinstance(faces, Iterable) or not (named := list(faces)):
        raise SimulationError(f"a room without faces; give some of {', '.join(ROOM_FACES)}")
    unknown = sorted({str(face) for face in named if not isinstance(face, str) or face not in ROOM_FACES})
    if unknown:
        raise SimulationError(f"unknown room faces {', '.join(unknown)}; there are {', '.join(ROOM_FACES)}")
    _check_sizes(numbers_of("size of the room", size_m, 3), number_of("patch size", patch_size_m))
    geometry = _room_geometry(*size_m)
    return _scene(name, {face: geometry[face] for face in named}, patch_size_m, reflectance, convex=True)


def paper_room(ceiling: bool = True, reflectance: float = 0.7, patch_size_m: float = 0.4) -> Scene:
    """Return the room of Dehos et al. 2014: 4.8 x 4.8 x 2.4 m in 576 patches (432 without a ceiling).

    Parameters
    ----------
    ceiling : bool
        Whether there is one.
    reflectance : float
        Of all faces, in [0, 1].
    patch_size_m : float
        Wanted patch size. [m]

    Returns
    -------
    Scene

    References
    ----------
    Dehos, Zéghers, Sarry, Rousselle and Renaud, Immersive front-projection analysis using a radiosity-based simulation
    method, Virtual Reality 18(2), 2014.
    """
    faces = [face for face in ROOM_FACES if ceiling or face != "ceiling"]
    return room(patch_size_m=patch_size_m, reflectance=reflectance, faces=faces, name="paper-room")


def corner(
    size_m: tuple[float, float, float] = (2.0, 2.0, 2.0),
    patch_size_m: float = 0.25,
    reflectance: Reflectance = 0.7,
) -> Scene:
    """Return the floor and two walls that meet at the origin: open, convex."""
    return room(size_m, patch_size_m, reflectance, ("floor", "x0", "y0"), name="corner")


def furnace(patch_size_m: float = 0.25, reflectance: Reflectance = 0.5, size_m: float = 1.0) -> Scene:
    """Return a closed cube: with the same emission E everywhere, B = E / (1 - rho) exactly."""
    return room((size_m,) * 3, patch_size_m, reflectance, name="furnace")


def room_with_box(
    patch_size_m: float = 0.4,
    reflectance: float = 0.7,
    box_size_m: tuple[float, float, float] = (1.0, 1.0, 1.0),
    box_corner_m: tuple[float, float] = (1.9, 1.9),
    box_patch_size_m: float | None = None,
    size_m: tuple[float, float, float] = (4.8, 4.8, 2.4),
) -> Scene:
    """Return the paper's room with a box on the floor (five faces): not convex.

    Parameters
    ----------
    patch_size_m : float
        Wanted patch size of the room. [m]
    reflectance : float
        Of all faces, in [0, 1].
    box_size_m : (float, float, float)
        Edge lengths of the box along x, y and z. [m]
    box_corner_m : (float, float)
        Its lowest x and y. [m]
    box_patch_size_m : float, optional
        Wanted patch size of the box; default: half of the room's. [m]
    size_m : (float, float, float)
        Edge lengths of the room. [m]

    Returns
    -------
    Scene

    Raises
    ------
    SimulationError
        For a size or patch size not above 0.
    """
    box_patch = box_patch_size_m or number_of("patch size", patch_size_m) / 2
    lengths_m = (*numbers_of("size of the room", size_m, 3), *numbers_of("size of the box", box_size_m, 3))
    _check_sizes(lengths_m, min(patch_size_m, number_of("patch size of the box", box_patch)))
    walls = _room_geometry(*size_m)
    offset = np.array([*numbers_of("corner of the box", box_corner_m, 2), 0.0])
    outside = {f"box {side}": geometry for side, geometry in _box_geometry(box_size_m, offset).items()}
    faces = _faces(walls, patch_size_m, 0)
    faces += _faces(outside, box_patch, sum(face.n_patches for face in faces))
    n_patches = sum(face.n_patches for face in faces)
    return Scene("room-with-box", tuple(faces), np.full(n_patches, float(reflectance)), convex=False)


LIBRARY: Mapping[str, Callable[[float], Scene]] = {
    "paper-room": lambda patch_size_m: paper_room(patch_size_m=patch_size_m),
    "corner": lambda patch_size_m: corner(patch_size_m=patch_size_m),
    "furnace": lambda patch_size_m: furnace(patch_size_m=patch_size_m),
    "room-with-box": lambda patch_size_m: room_with_box(patch_size_m=patch_size_m),
}
"""Scenes by name, each as a function of the patch size [m]."""

Geometry = tuple[FloatArray, FloatArray, FloatArray]


def _room_geometry(x: float, y: float, z: float) -> dict[str, Geometry]:
    return {
        "floor": _geometry((0, 0, 0), (x, 0, 0), (0, y, 0)),
        "ceiling": _geometry((0, 0, z), (0, y, 0), (x, 0, 0)),
        "x0": _geometry((0, 0, 0), (0, y, 0), (0, 0, z)),
        "x1": _geometry((x, y, 0), (0, -y, 0), (0, 0, z)),
        "y0": _geometry((x, 0, 0), (-x, 0, 0), (0, 0, z)),
        "y1": _geometry((0, y, 0), (x, 0, 0), (0, 0, z)),
    }


def _box_geometry(size_m: tuple[float, float, float], offset_m: FloatArray) -> dict[str, Geometry]:
    x, y, z = size_m
    sides = {
        "top": _geometry((0, 0, z), (x, 0, 0), (0, y, 0)),
        "x0": _geometry((0, y, 0), (0, -y, 0), (0, 0, z)),
        "x1": _geometry((x, 0, 0), (0, y, 0), (0, 0, z)),
        "y0": _geometry((0, 0, 0), (x, 0, 0), (0, 0, z)),
        "y1": _geometry((x, y, 0), (-x, 0, 0), (0, 0, z)),
    }
    return {side: (origin + offset_m, u, v) for side, (origin, u, v) in sides.items()}


def _geometry(origin: ArrayLike, u: ArrayLike, v: ArrayLike) -> Geometry:
    return np.array(origin, dtype=float), np.array(u, dtype=float), np.array(v, dtype=float)


def _faces(geometry: Mapping[str, Geometry], patch_size_m: float, first_patch: int) -> list[Face]:
    faces = []
    for name, (origin, u, v) in geometry.items():
        columns, rows = (max(1, round(float(np.linalg.norm(edge)) / patch_size_m)) for edge in (u, v))
        faces.append(
            Face(
                name=name,
                origin_m=origin,
                edge_u_m=u,
                edge_v_m=v,
                rows=rows,
                columns=columns,
                first_patch=first_patch,
            )
        )
        first_patch += rows * columns
    return faces


def _scene(
    name: str, geometry: Mapping[str, Geometry], patch_size_m: float, reflectance: Reflectance, convex: bool
) -> Scene:
    faces = _faces(geometry, patch_size_m, 0)
    values = [np.full(face.n_patches, _reflectance_of(face.name, reflectance)) for face in faces]
    return Scene(name, tuple(faces), np.concatenate(values), convex)


def _reflectance_of(face: str, reflectance: Reflectance) -> float:
    if not isinstance(reflectance, Mapping):
        return number_of("reflectance", reflectance)
    if face not in reflectance:
        raise SimulationError(f"no reflectance for face {face}; given: {', '.join(reflectance) or 'none'}")
    return number_of(f"reflectance of face {face}", reflectance[face])


def _check_sizes(lengths_m: Sequence[float], patch_size_m: float) -> None:
    smallest_m, largest_m = SIZES_M
    for length in (*lengths_m, patch_size_m):
        if not smallest_m <= length <= largest_m:
            raise SimulationError(
                f"a size of {length:g} m; every edge and the patch size must be above 0, and finite: "
                f"{smallest_m:g} ... {largest_m:g} m"
            )
    boxes = [[max(1.0, edge / patch_size_m) for edge in lengths_m[k : k + 3]] for k in range(0, len(lengths_m), 3)]
    patches = sum(2 * (a * b + b * c + c * a) for a, b, c in boxes)
    if patches > MOST_PATCHES:
        raise SimulationError(
            f"edges of {max(lengths_m):g} m in patches of {patch_size_m:g} m are up to {patches:.3g} patches, the "
            f"limit is {MOST_PATCHES:g}; give larger patches"
        )


SIZES_M = 1e-12, 1e12
"""Sizes whose products stay far within the range of numbers."""
MOST_PATCHES = 5e6
"""Whose corners take half a gigabyte."""
FURNITURE: Mapping[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "table": ((1.6, 0.9, 0.05), (1.5, 1.8, 0.7)),
    "table leg 1": ((0.1, 0.1, 0.7), (1.55, 1.85, 0.0)),
    "table leg 2": ((0.1, 0.1, 0.7), (2.95, 1.85, 0.0)),
    "table leg 3": ((0.1, 0.1, 0.7), (1.55, 2.55, 0.0)),
    "table leg 4": ((0.1, 0.1, 0.7), (2.95, 2.55, 0.0)),
    "cabinet": ((0.5, 1.2, 1.8), (0.1, 3.2, 0.0)),
    "shelf": ((1.2, 0.3, 0.04), (3.0, 4.4, 1.4)),
    "bed": ((1.0, 2.0, 0.45), (3.6, 0.3, 0.0)),
    "pillar": ((0.3, 0.3, 2.4), (3.4, 3.2, 0.0)),
}
"""Size and lowest corner of each box of :func:`furnished_room` [m]; a box on the floor has no underside."""


def furnished_room(patch_size_m: float = 0.2, reflectance: float = 0.7) -> Scene:
    """Return the paper's room with a table on legs, a cabinet, a shelf, a bed and a pillar: nine boxes, 48 faces.

    It has 2,780, 12,098, 23,655, 47,587 and 94,957 patches at 0.2, 0.0967, 0.0684, 0.0484 and 0.0342 m. The
    floor and ceiling below and above a box keep their patches, which see nothing.

    Raises
    ------
    SimulationError
        For a patch size not above 0.
    """
    size_m = (4.8, 4.8, 2.4)
    _check_sizes(size_m, number_of("patch size", patch_size_m))
    geometry = _room_geometry(*size_m)
    for name, (box_m, corner_m) in FURNITURE.items():
        sides = _box_geometry(box_m, np.array(corner_m))
        if corner_m[2] > 0:
            x, y, _ = box_m
            origin, u, v = _geometry((0, 0, 0), (0, y, 0), (x, 0, 0))
            sides["underside"] = (origin + np.array(corner_m), u, v)
        hidden = "top" if corner_m[2] + box_m[2] >= size_m[2] or name.startswith("table leg") else ""
        geometry |= {f"{name} {side}": place for side, place in sides.items() if side != hidden}
    return _scene("furnished-room", geometry, patch_size_m, reflectance, convex=False)
