"""Point clouds read back, to hold what the product writes."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])
_HEADER_END = b"end_header\n"


def read_ply(path: Path) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Points (N, 3) and colours (N, 3) of a binary PLY with x, y, z, red, green and blue."""
    header, _, body = path.read_bytes().partition(_HEADER_END)
    lines = header.decode("ascii").splitlines()
    names = [line.split()[2] for line in lines if line.startswith("property")]
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    assert names == ["x", "y", "z", "red", "green", "blue"]
    (count,) = (int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    assert len(body) == count * _VERTEX.itemsize
    vertices = np.frombuffer(body, dtype=_VERTEX)
    return vertices["xyz"].copy(), vertices["rgb"].copy()
