"""Faces of a file as they stand there: those of more than three corners cut, those that are no surface refused.

The reader of everything else (trimesh) cuts a polygon into a fan from its first corner, which is wrong for a concave
one, and takes a corner that does not exist for another. OBJ files are therefore handed to it with their faces cut
(``rig/files/obj_mesh.py``); PLY files are read by ``rig/files/ply_mesh.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.terminal.line import counted, first_of
from sim.geometry.mending.polygons import CutPolygons, cut_polygons

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

NAMED = 10
"""How many faces a message names."""
AT_ONCE = 20_000
"""Faces cut together: a hundred thousand quads take 0.08 s so, 0.11 s all at once and twice the memory."""


@dataclass(frozen=True, eq=False)
class CutFaces:
    """Faces of a file in triangles."""

    triangles: IntArray
    """(T, 3) places in the face."""
    face: IntArray
    """(T,) place of the face of each, ascending."""
    faults: dict[int, str]
    """What is wrong with a face, by its place, ascending."""


def cut_faces(points: FloatArray, faces: Sequence[Sequence[int] | IntArray]) -> CutFaces:
    """Cut faces of at least three corners each, places in (P, 3) points, into triangles; those of three stay."""
    counts = np.array([len(face) for face in faces], dtype=np.intp)
    triangles, which = [np.zeros((0, 3), dtype=np.intp)], [np.zeros(0, dtype=np.intp)]
    faults: dict[int, str] = {}
    for n in np.unique(counts):
        own = np.flatnonzero(counts == n)
        for at in range(0, len(own), AT_ONCE):
            some = own[at : at + AT_ONCE]
            cut = _cut_alike(points[np.array([faces[i] for i in some])])
            triangles.append(cut.triangles)
            which.append(some[cut.polygon])
            faults |= {int(some[i]): fault for i, fault in cut.faults.items()}
    face = np.concatenate(which)
    order = np.argsort(face, kind="stable")
    return CutFaces(np.concatenate(triangles)[order], face[order], dict(sorted(faults.items())))


def _cut_alike(corners: FloatArray) -> CutPolygons:
    """Cut faces of as many corners each, (M, N, 3)."""
    n = corners.shape[1]
    # What is not finite is told with all other faults, later.
    fans: BoolArray = np.asarray(~np.isfinite(corners).all(axis=(1, 2)))
    if n == 3:
        fans[:] = True
    elif n == 4:
        fans[~fans] = _fan_well(corners[~fans])
    others = np.flatnonzero(~fans)
    cut = cut_polygons(corners[others])
    fan = np.array([(0, k, k + 1) for k in range(1, n - 1)])
    # A polygon that is a line stays one triangle, to be counted with all that have no area.
    lines = np.setdiff1d(np.arange(len(others)), cut.polygon)
    which = [np.repeat(np.flatnonzero(fans), len(fan)), others[cut.polygon], others[lines]]
    triangles = [np.tile(fan, (int(fans.sum()), 1)), cut.triangles, np.tile([(0, 1, 2)], (len(lines), 1))]
    return CutPolygons(
        np.concatenate(triangles), np.concatenate(which), {int(others[i]): fault for i, fault in cut.faults.items()}
    )


def _fan_well(quads: FloatArray) -> BoolArray:
    """Whether both triangles of each quad (M, 4, 3) look the same way: convex, or bent along its first diagonal."""
    # In its own size: products of large coordinates are beyond what numbers can be.
    unit = np.maximum(np.abs(quads).max(axis=(1, 2), initial=0.0), np.finfo(float).tiny)
    a, b, c, d = np.moveaxis(quads / unit[:, np.newaxis, np.newaxis], 1, 0)
    first = (np.cross(b - a, c - a) * np.cross(c - a, d - a)).sum(axis=1)
    second = (np.cross(c - b, d - b) * np.cross(d - b, a - b)).sum(axis=1)
    return np.asarray((first > 0) & (second > 0))


def refuse_faces(path: Path, faults: Sequence[str]) -> None:
    """Raise UsageError if there are any."""
    if faults:
        raise UsageError(
            f"{path}: no surface can be made of {counted(len(faults), 'face')}: {'; '.join(first_of(faults, NAMED))}; "
            "correct or remove them"
        )
