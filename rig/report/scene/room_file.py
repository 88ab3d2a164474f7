"""A session's room as a file that other programs open: surface, reflectance, confidence, devices."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.light.reflectance import ReflectanceSource
from rig.errors import UsageError
from rig.records import JsonObject, Record
from rig.report.scene.glb import GlbCamera, GlbMesh, GlbScene, write_glb
from rig.report.scene.texture import PatchTexture, is_triangle, reflectance_texture
from rig.report.scene.view import region_name
from rig.session import Session
from rig.stages.model import FittedScene, load_model, load_model_record
from rig.stages.scene_model import PosedLens
from rig.terminal import OnStep, silent
from rig.version import __version__

_CONFIDENCE = {ReflectanceSource.DIRECT: 1.0, ReflectanceSource.GLOBAL: 0.5, ReflectanceSource.UNSEEN: 0.0}


@dataclass(frozen=True, kw_only=True)
class RoomFile(Record):
    """What was written."""

    file: str
    triangles: int
    parts: tuple[str, ...]
    """Walls, and things that stand before them: an object each."""
    devices: tuple[str, ...]


def check_room_file(path: Path) -> None:
    """Raise UsageError for a file that is no binary glTF by its name, before anything is measured for it."""
    if path.suffix.lower() != ".glb":
        raise UsageError(f"--export {path}: a room is written as binary glTF; give a name that ends in .glb")
    if not path.absolute().parent.is_dir():
        raise UsageError(f"--export {path}: there is no folder {path.absolute().parent}; make it first")


def export_room(folder: Path, path: Path, on_step: OnStep = silent) -> RoomFile:
    """Write the measured room of a session as binary glTF.

    Parameters
    ----------
    folder
        Of a session whose model is built; it is only read.
    path
        File to write, ``.glb``; one of that name is replaced.
    on_step
        Told how far it is.

    Returns
    -------
    RoomFile

    Raises
    ------
    UsageError
        The name is none of a glTF file.
    SessionError
        There is no session, its model is not built, or the disk refuses.
    """
    check_room_file(path)
    on_step("write room", 0, 3)
    session = Session.read(folder)
    model = load_model(session)
    on_step("write room", 1, 3)
    texture = reflectance_texture(model)
    on_step("write room", 2, 3)
    source = np.array(load_model_record(session).bands[0].source)
    scene = model.scene_model.scene
    meshes = [_part(model, texture, source, int(number)) for number in np.unique(scene.region)]
    found = model.scene_model
    lenses = {**{n: c.device for n, c in found.cameras.items()}, **{n: p.device for n, p in found.projectors.items()}}
    devices = [_device(name, lens, is_camera=name in found.cameras) for name, lens in lenses.items()]
    write_glb(path, GlbScene(meshes=meshes, texture_png=texture.png, cameras=devices, extras=_about(session)))
    on_step("write room", 3, 3)
    return RoomFile(
        file=str(path),
        triangles=sum(len(mesh.triangles) for mesh in meshes),
        parts=tuple(mesh.name for mesh in meshes),
        devices=tuple(device.name for device in devices),
    )


def _about(session: Session) -> JsonObject:
    return {
        "program": f"procam-rig {__version__}",
        "session": session.path.name,
        "profile": session.profile.name,
        "unit": "m",
        "confidence": "1: lit and seen, 0.5: seen in global light, 0: nobody saw it",
        "base colour": "diffuse reflectance",
    }


def _part(model: FittedScene, texture: PatchTexture, source: NDArray[np.intp], region: int) -> GlbMesh:
    """One wall or thing; corners are not shared between patches, for each has its own place in the texture."""
    scene = model.scene_model.scene
    patch = np.flatnonzero(scene.region == region)
    triangle = is_triangle(scene)[patch]
    uv = texture.corners_uv(patch)
    # A triangle's third corner has the tile's upper left: it fills the half below the diagonal.
    uv = np.where(triangle[:, None, None], uv[:, [0, 1, 3, 3]], uv)
    first = 4 * np.arange(len(patch))[:, None]
    halves = [first + np.array([0, 1, 2]), (first + np.array([0, 2, 3]))[~triangle]]
    confidence = np.array([_CONFIDENCE[ReflectanceSource(one)] for one in source[patch]])
    reflectance = np.stack([band.scene.reflectance[patch] for band in model.room.bands], axis=-1).mean(axis=-1)
    return GlbMesh(
        name=region_name(model, region),
        positions_m=scene.vertices[patch].reshape(-1, 3),
        triangles=np.concatenate(halves),
        uv=uv.reshape(-1, 2),
        attributes={
            "_CONFIDENCE": np.repeat(confidence, 4),
            "_SEEN": np.repeat(texture.seen[patch], 4),
            "_REFLECTANCE": np.repeat(reflectance, 4),
        },
    )


def _device(name: str, device: PosedLens, *, is_camera: bool) -> GlbCamera:
    lens = device.lens
    height, width = lens.shape
    focal_y = lens.focal_px[1]
    return GlbCamera(
        name=name,
        rotation=device.pose.rotation.T,
        position_m=device.pose.position_m,
        vertical_field_rad=float(2 * np.arctan(height / 2 / focal_y)),
        aspect=float(width / lens.focal_px[0] * focal_y / height),
        extras={
            "kind": "camera" if is_camera else "projector",
            "width_px": width,
            "height_px": height,
            "focal_px": list(lens.focal_px),
            "principal_point_px": list(lens.principal_point_px),
            "distortion": list(lens.distortion),
        },
    )
