"""Point clouds on disk: binary PLY, which every viewer reads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.files.atomic import write_bytes

_VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])
_HEADER_END = b"end_header\n"
_PROPERTIES = (
    "property float x",
    "property float y",
    "property float z",
    "property uchar red",
    "property uchar green",
    "property uchar blue",
)


def write_ply(path: Path, points: ArrayLike, colours: NDArray[np.uint8], comments: Sequence[str] = ()) -> None:
    """Write (N, 3) points and (N, 3) uint8 red, green, blue; the file is complete or not there.

    Raises SessionError when the disk is full or refuses.
    """
    vertices = np.empty(len(colours), dtype=_VERTEX)
    vertices["xyz"], vertices["rgb"] = points, colours
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {comment}" for comment in comments),
        f"element vertex {len(vertices)}",
        *_PROPERTIES,
    ]
    header = "".join(f"{line}\n" for line in lines).encode() + _HEADER_END
    write_bytes(path, header + vertices.tobytes())
