"""Faces of a file as they stand there: those of more than three corners cut, those that are no surface refused.

The reader of everything else (trimesh) cuts a polygon into a fan from its first corner, which is wrong for a concave
one, and takes a corner that does not exist for another. OBJ files are therefore handed to it with their faces cut
(``rig/files/obj_mesh.py``); PLY files are read by ``rig/files/ply_mesh.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.terminal.line import counted
from sim.geometry.mending.polygons import cut_polygon

FloatArray = NDArray[np.float64]

NAMED = 10
"""How many faces a message names."""


def pieces(corners: FloatArray) -> tuple[Sequence[Sequence[int]], str]:
    """Return the triangles of a face of (N, 3) corners, N > 3, as places in it, and what is wrong with it."""
    n = len(corners)
    if not np.isfinite(corners).all() or (n == 4 and _fans_well(corners)):
        # What is not finite is told with all other faults, later.
        return [(0, k, k + 1) for k in range(1, n - 1)], ""
    cut = cut_polygon(corners)
    # A polygon that is a line stays one triangle, to be counted with all that have no area.
    return cut.triangles.tolist() or [(0, 1, 2)], cut.fault


def _fans_well(quad: FloatArray) -> bool:
    """Whether both triangles of a quad look the same way: convex, or bent along its first diagonal."""
    # In its own size: products of large coordinates are beyond what numbers can be.
    quad = quad / max(float(np.abs(quad).max()), np.finfo(float).tiny)
    a, b, c, d = quad
    one, other = np.cross(b - a, c - a), np.cross(c - a, d - a)
    return bool(one @ other > 0) and bool(np.cross(c - b, d - b) @ np.cross(d - b, a - b) > 0)


def refuse_faces(path: Path, faults: Sequence[str]) -> None:
    """Raise UsageError if there are any."""
    if faults:
        more = f"; and {len(faults) - NAMED} more" if len(faults) > NAMED else ""
        raise UsageError(
            f"{path}: no surface can be made of {counted(len(faults), 'face')}: {'; '.join(faults[:NAMED])}{more}; "
            "correct or remove them"
        )
