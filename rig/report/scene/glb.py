"""Scenes on disk: binary glTF 2.0, which Blender, browsers and most viewers read.

One file: a JSON head and one buffer (Khronos, glTF 2.0 Specification, section 4: GLB File Format).
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.files.atomic import write_bytes
from rig.records import Json, JsonObject

Float32Array = NDArray[np.float32]

_MAGIC, _VERSION = 0x46546C67, 2
_JSON, _BINARY = 0x4E4F534A, 0x004E4942
_FLOAT, _UINT32 = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
_LINEAR, _CLAMPED = 9729, 33071
_TYPES: Mapping[int, str] = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_Y_UP = (-(0.5**0.5), 0.0, 0.0, 0.5**0.5)
"""Quaternion x, y, z, w that turns z up, as here, to y up, as in glTF."""
_DEVICE_AXES = np.diag([1.0, -1.0, -1.0])
"""Cameras of glTF look along -z with y up; devices here along z with y down."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GlbMesh:
    """Triangles."""

    name: str
    positions_m: NDArray[np.floating]
    """(V, 3), z up."""
    triangles: NDArray[np.integer]
    """(T, 3) corners, counter-clockwise seen from the lit side."""
    uv: NDArray[np.floating]
    """(V, 2) place in the scene's texture, from its upper left."""
    attributes: Mapping[str, NDArray[np.floating]] = field(default_factory=dict)
    """(V,) or (V, K) numbers of corners by name; names of one's own begin with an underscore."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GlbCamera:
    """A device that sees, or lights, as a camera that looks along its optical axis."""

    name: str
    rotation: NDArray[np.floating]
    """(3, 3) world_from_device; x right, y down, z forward."""
    position_m: NDArray[np.floating]
    """(3,)"""
    vertical_field_rad: float
    aspect: float
    """Width over height."""
    extras: JsonObject = field(default_factory=dict)
    """What a camera of glTF cannot say."""


class _Buffer:
    """The file's binary part, and what its JSON says of it."""

    def __init__(self) -> None:
        self.content = bytearray()
        self.views: list[Json] = []
        self.accessors: list[Json] = []

    def view(self, content: bytes, target: int | None = None) -> int:
        """Append bytes; return their number."""
        self.content += b"\0" * (-len(self.content) % 4)
        view: dict[str, Json] = {"buffer": 0, "byteOffset": len(self.content), "byteLength": len(content)}
        self.views.append(view if target is None else {**view, "target": target})
        self.content += content
        return len(self.views) - 1

    def array(self, values: NDArray[np.generic], *, is_position: bool = False) -> int:
        """Append numbers of corners, or indices; return the number of their accessor."""
        is_index = values.dtype.kind in "iu"
        stored = np.ascontiguousarray(values, dtype="<u4" if is_index else "<f4")
        columns = 1 if stored.ndim == 1 else stored.shape[1]
        accessor: dict[str, Json] = {
            "bufferView": self.view(stored.tobytes(), _INDICES if is_index else _VERTICES),
            "componentType": _UINT32 if is_index else _FLOAT,
            "count": len(stored),
            "type": _TYPES[columns],
        }
        if is_position:
            accessor |= {"min": stored.min(axis=0).tolist(), "max": stored.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


@dataclass(frozen=True, eq=False, kw_only=True)
class GlbScene:
    """What a file holds."""

    meshes: Sequence[GlbMesh]
    """In metres, z up; the file's root turns them to y up."""
    texture_png: bytes
    """Base colour of all meshes, sRGB."""
    cameras: Sequence[GlbCamera] = ()
    extras: JsonObject = field(default_factory=dict)
    """What else the file says of itself."""


def write_glb(path: Path, scene: GlbScene) -> None:
    """Write a scene; the file is complete or not there.

    Parameters
    ----------
    path
        Ends in ``.glb``.
    scene
        At least one mesh.

    Raises
    ------
    SessionError
        When the disk is full or refuses.
    """
    buffer = _Buffer()
    gltf = _head(scene, buffer)
    binary = bytes(buffer.content) + b"\0" * (-len(buffer.content) % 4)
    gltf |= {
        "buffers": [{"byteLength": len(binary)}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    }
    head = json.dumps(gltf, separators=(",", ":"), allow_nan=False).encode()
    head += b" " * (-len(head) % 4)
    total = 12 + 8 + len(head) + 8 + len(binary)
    chunks = (struct.pack("<II", len(head), _JSON), head, struct.pack("<II", len(binary), _BINARY), binary)
    write_bytes(path, struct.pack("<III", _MAGIC, _VERSION, total) + b"".join(chunks))


def _head(scene: GlbScene, buffer: _Buffer) -> dict[str, Json]:
    """All of the JSON but for the buffer."""
    meshes, cameras = scene.meshes, scene.cameras
    children: list[Json] = [*range(1, 1 + len(meshes) + len(cameras))]
    root: Json = {"name": "room", "rotation": [*_Y_UP], "children": children}
    colour: Json = {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": 1.0}
    head: dict[str, Json] = {
        "asset": {"version": "2.0", "generator": "procam-rig", "extras": scene.extras},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "meshes": [_mesh(mesh, buffer) for mesh in meshes],
        "materials": [{"name": "matte", "pbrMetallicRoughness": colour}],
        "textures": [{"source": 0, "sampler": 0}],
        "images": [{"bufferView": buffer.view(scene.texture_png), "mimeType": "image/png", "name": "reflectance"}],
        "samplers": [{"magFilter": _LINEAR, "minFilter": _LINEAR, "wrapS": _CLAMPED, "wrapT": _CLAMPED}],
        "nodes": [
            root,
            *(_mesh_node(mesh, number) for number, mesh in enumerate(meshes)),
            *(_camera_node(camera, number) for number, camera in enumerate(cameras)),
        ],
    }
    if cameras:  # a list without entries is not allowed
        head["cameras"] = [_camera(camera) for camera in cameras]
    return head


def _mesh_node(mesh: GlbMesh, number: int) -> Json:
    return {"name": mesh.name, "mesh": number}


def _mesh(mesh: GlbMesh, buffer: _Buffer) -> Json:
    attributes: dict[str, Json] = {
        "POSITION": buffer.array(mesh.positions_m.astype(np.float32), is_position=True),
        "TEXCOORD_0": buffer.array(mesh.uv),
        **{name: buffer.array(values) for name, values in mesh.attributes.items()},
    }
    indices = buffer.array(mesh.triangles.ravel())
    primitive: Json = {"attributes": attributes, "indices": indices, "material": 0}
    return {"name": mesh.name, "primitives": [primitive]}


def _camera(camera: GlbCamera) -> Json:
    perspective: Json = {"yfov": camera.vertical_field_rad, "aspectRatio": camera.aspect, "znear": 0.01}
    return {"name": camera.name, "type": "perspective", "perspective": perspective}


def _camera_node(camera: GlbCamera, number: int) -> Json:
    matrix = np.eye(4)
    matrix[:3, :3] = camera.rotation @ _DEVICE_AXES
    matrix[:3, 3] = camera.position_m
    columns: list[Json] = [*matrix.T.ravel().tolist()]
    return {"name": camera.name, "camera": number, "matrix": columns, "extras": camera.extras}
