"""Point clouds on disk: binary PLY, which every viewer reads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.errors import UsageError
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


def read_ply(path: Path) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Read a cloud as :func:`write_ply` writes it: points (N, 3) and colours (N, 3).

    Raises UsageError for any other file.
    """
    raw = path.read_bytes()
    end = raw.find(_HEADER_END)
    header = raw[: max(end, 0)].decode("ascii", "replace").splitlines()
    expected = [line for line in header if line.startswith("property")] == list(_PROPERTIES)
    if end < 0 or "format binary_little_endian 1.0" not in header or not expected:
        raise UsageError(f"{path}: is no binary PLY of x, y, z, red, green, blue; export it as such")
    body = raw[end + len(_HEADER_END) :]
    count = next((int(line.split()[2]) for line in header if line.startswith("element vertex")), -1)
    if len(body) != count * _VERTEX.itemsize:
        raise UsageError(f"{path}: has {len(body)} bytes of {count} points, expected {count * _VERTEX.itemsize}")
    vertices = np.frombuffer(body, dtype=_VERTEX)
    return vertices["xyz"].copy(), vertices["rgb"].copy()
