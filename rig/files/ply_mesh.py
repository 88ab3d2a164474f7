"""Meshes in PLY files: read face by face, and written with a colour for each facet."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.files.atomic import write_bytes
from rig.files.faces import cut_faces, refuse_faces
from rig.terminal.line import counted

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
MOST_ROWS = 100_000_000
"""More vertices or faces are taken for a damaged header."""
_FACET = np.dtype([("count", "u1"), ("corners", "<i4", 3), ("rgb", "u1", 3)])


@dataclass(frozen=True)
class _Property:
    name: str
    type: str
    count_type: str = ""
    """Of a list."""


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: tuple[_Property, ...]

    @property
    def has_lists(self) -> bool:
        return any(one.count_type for one in self.properties)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Values of an element by property: (N,) numbers, (N, K) of lists of one length, or a list of lists."""

    columns: dict[str, NDArray[Any] | list[NDArray[Any]]]

    def numbers(self, names: Sequence[str]) -> NDArray[Any] | None:
        """(N, K) of some properties; None if one is missing."""
        found = [self.columns.get(name) for name in names]
        arrays = [column for column in found if isinstance(column, np.ndarray) and column.ndim == 1]
        return np.stack(arrays, axis=1) if len(arrays) == len(names) else None


def read_ply_mesh(path: Path) -> Any:
    """Return a PLY file as the reader's scene, all faces cut into triangles.

    Raises
    ------
    UsageError
        If it is no PLY file or is cut short; for a face with a corner that does not exist or that is no surface.
    """
    import trimesh  # here, for it takes its time

    try:
        rows = _rows(path.read_bytes())
        points = rows["vertex"].numbers("xyz")
        if points is None:
            raise ValueError("no x, y, z")
    except (ValueError, KeyError, IndexError, struct.error) as error:
        raise UsageError(f"{path}: cannot be read as PLY: {error}; export it again") from error
    faces = rows.get("face", _Rows({}))
    lists = faces.columns.get("vertex_indices", faces.columns.get("vertex_index", []))
    points = np.asarray(points, dtype=np.float64)
    triangles, source = _cut_faces(path, points, lists)
    if not len(triangles):
        return trimesh.Scene()
    mesh = trimesh.Trimesh(points, triangles, process=False, validate=False)
    if (shades := faces.numbers(("red", "green", "blue"))) is not None:
        mesh.visual = trimesh.visual.ColorVisuals(mesh, face_colors=shades[source])
    elif (shades := rows["vertex"].numbers(("red", "green", "blue"))) is not None:
        mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=shades)
    return trimesh.Scene([mesh])


def _rows(data: bytes) -> dict[str, _Rows]:
    """The values of all elements of a file. Raises ValueError and the like where it is none."""
    head, found, body = data.partition(b"end_header")
    if not data.startswith(b"ply") or not found:
        raise ValueError("no header")
    order, elements = _header(head.decode("ascii", errors="replace"))
    body = body.partition(b"\n")[2]
    if order == "ascii":
        return _ascii_rows(body.decode("ascii", errors="replace").split("\n"), elements)
    result, at = {}, 0
    for element in elements:
        result[element.name], at = _binary_rows(body, at, element, ORDERS[order])
    return result


def _header(text: str) -> tuple[str, list[_Element]]:
    order, elements = "", []
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            order = words[1]
        elif words[:1] == ["element"]:
            elements.append(_Element(words[1], int(words[2]), ()))
        elif words[:1] == ["property"]:
            types = [TYPES[word] for word in words[2:-1]] if words[1] == "list" else [TYPES[words[1]]]
            new = _Property(words[-1], types[-1], types[0] if words[1] == "list" else "")
            last = elements[-1]
            elements[-1] = _Element(last.name, last.count, (*last.properties, new))
    if order not in ORDERS:
        raise ValueError(f"format {order!r}")
    if any(not 0 <= element.count <= MOST_ROWS for element in elements):
        raise ValueError(f"{max(element.count for element in elements):,} rows of an element")
    return order, elements


def _ascii_rows(lines: list[str], elements: list[_Element]) -> dict[str, _Rows]:
    lines = [line for line in lines if line.strip()]
    result, at = {}, 0
    for element in elements:
        own = [line.split() for line in lines[at : at + element.count]]
        at += element.count
        if len(own) < element.count:
            raise ValueError(f"{len(own):,} of {element.count:,} rows of {element.name!r}: the file is cut short")
        result[element.name] = _ascii_lists(own, element) if element.has_lists else _ascii_numbers(own, element)
    return result


def _ascii_numbers(rows: list[list[str]], element: _Element) -> _Rows:
    width = len(element.properties)
    values = np.array([row[:width] for row in rows], dtype=np.float64).reshape(-1, width)
    return _Rows({one.name: values[:, k].astype(one.type) for k, one in enumerate(element.properties)})


def _ascii_lists(rows: list[list[str]], element: _Element) -> _Rows:
    numbers: dict[str, list[Any]] = {one.name: [] for one in element.properties}
    for row in rows:
        at = 0
        for one in element.properties:
            count = int(row[at]) if one.count_type else 1
            at += bool(one.count_type)
            values = row[at : at + count]
            if len(values) < count:
                raise ValueError(f"a row of {element.name!r} is cut short")
            numbers[one.name].append(np.array(values, dtype=np.float64) if one.count_type else float(values[0]))
            at += count
    scalar = {one.name: one.type for one in element.properties if not one.count_type}
    return _Rows({k: np.array(v).astype(scalar[k]) if k in scalar else v for k, v in numbers.items()})


def _binary_rows(body: bytes, at: int, element: _Element, order: str) -> tuple[_Rows, int]:
    """Rows that begin at a byte, and where the next element begins."""
    counts = _first_counts(body, at, element, order) if element.has_lists and element.count else []
    lengths = iter(counts)
    fields: list[Any] = []
    for one in element.properties:
        if one.count_type:
            fields += [
                (f"count of {one.name}", order + one.count_type),
                (one.name, order + one.type, (next(lengths, 0),)),
            ]
        else:
            fields.append((one.name, order + one.type))
    row = np.dtype(fields)
    end = at + row.itemsize * element.count
    if end <= len(body):
        table = np.frombuffer(body, row, element.count, at)
        lists = [one.name for one in element.properties if one.count_type]
        if all((table[f"count of {name}"] == n).all() for name, n in zip(lists, counts, strict=False)):
            return _Rows({one.name: table[one.name] for one in element.properties}), end
    if not element.has_lists:
        raise ValueError(f"the file ends within the rows of {element.name!r}")
    return _binary_lists(body, at, element, order)


def _first_counts(body: bytes, at: int, element: _Element, order: str) -> list[int]:
    """Lengths of the lists of an element's first row."""
    counts = []
    for one in element.properties:
        n = 1
        if one.count_type:
            n = int(np.frombuffer(body, order + one.count_type, 1, at)[0])
            at += np.dtype(one.count_type).itemsize
            counts.append(max(n, 0))
        at += max(n, 0) * np.dtype(one.type).itemsize
    return counts


def _binary_lists(body: bytes, at: int, element: _Element, order: str) -> tuple[_Rows, int]:
    """Rows whose lists have different lengths, one by one."""
    lists: dict[str, list[Any]] = {one.name: [] for one in element.properties}
    for _ in range(element.count):
        for one in element.properties:
            n = 1
            if one.count_type:
                n = int(np.frombuffer(body, order + one.count_type, 1, at)[0])
                at += np.dtype(one.count_type).itemsize
            values = np.frombuffer(body, order + one.type, n, at)
            at += values.nbytes
            lists[one.name].append(values if one.count_type else values[0])
    scalars = {one.name for one in element.properties if not one.count_type}
    return _Rows({name: np.array(values) if name in scalars else values for name, values in lists.items()}), at


def _cut_faces(path: Path, points: FloatArray, lists: NDArray[Any] | list[NDArray[Any]]) -> tuple[IntArray, IntArray]:
    """(T, 3) triangles, and (T,) the face of each. Raises UsageError for faces that are none."""
    if isinstance(lists, np.ndarray) and lists.shape[1:] == (3,):
        triangles = lists.astype(np.intp)
        lost = np.flatnonzero(((triangles < 0) | (triangles >= len(points))).any(axis=1))
        refuse_faces(path, [_missing(int(i), triangles[i], len(points)) for i in lost])
        return triangles, np.arange(len(triangles))
    faults, faces, places = {}, [], []
    for i, row in enumerate(lists):
        corners = np.asarray(row).astype(np.intp)
        if len(corners) < 3:
            faults[i] = f"face {i} has {counted(len(corners), 'corner')}"
        elif min(corners) < 0 or max(corners) >= len(points):
            faults[i] = _missing(i, corners, len(points))
        else:
            faces.append(corners)
            places.append(i)
    cut = cut_faces(points, faces)
    faults |= {places[k]: f"face {places[k]}: {fault}" for k, fault in cut.faults.items()}
    refuse_faces(path, [fault for _, fault in sorted(faults.items())])
    if not faces:
        return np.zeros((0, 3), dtype=np.intp), np.zeros(0, dtype=np.intp)
    begin = np.cumsum([0, *map(len, faces)])[cut.face]
    return np.concatenate(faces)[begin[:, np.newaxis] + cut.triangles], np.array(places, dtype=np.intp)[cut.face]


def _missing(face: int, corners: IntArray, count: int) -> str:
    return f"face {face} has corners {' '.join(map(str, corners))}, there are 0 ... {count - 1}"


def write_ply_mesh(path: Path, triangles_m: FloatArray, colours: NDArray[np.uint8], comments: Sequence[str]) -> None:
    """Write (T, 3, 3) triangles [m], each with a colour of (T, 3); the file is complete or not there.

    Raises SessionError when the disk is full or refuses.
    """
    facets = np.empty(len(triangles_m), dtype=_FACET)
    facets["count"], facets["rgb"] = 3, colours
    facets["corners"] = np.arange(3 * len(triangles_m)).reshape(-1, 3)
    axes, bands = ("x", "y", "z"), ("red", "green", "blue")
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {' '.join(comment.split())}" for comment in comments),
        f"element vertex {3 * len(triangles_m)}",
        *(f"property double {axis}" for axis in axes),
        f"element face {len(triangles_m)}",
        "property list uchar int vertex_indices",
        *(f"property uchar {band}" for band in bands),
        "end_header",
    ]
    corners = np.ascontiguousarray(triangles_m, dtype="<f8")
    write_bytes(path, "".join(f"{line}\n" for line in lines).encode() + corners.tobytes() + facets.tobytes())
