"""The measured scene as triangles for the 3-D view: patches, what is known of them, devices in their places."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.light.reflectance import ReflectanceSource
from rig.files.channels import image_of
from rig.records import Record
from rig.report.scene.texture import reflectance_texture
from rig.session import Session
from rig.stages.model import FittedScene, load_model, load_model_record
from rig.stages.scene_model import PosedLens
from sim.geometry.optics import rays_at

FloatArray = NDArray[np.float64]

_WORDS = {
    ReflectanceSource.DIRECT: "lit and seen",
    ReflectanceSource.GLOBAL: "seen in global light",
    ReflectanceSource.UNSEEN: "nobody saw it",
}
_SHOWN_TEXELS = 1 << 19
"""Of the texture in a page: about 300 kB."""
_FRUSTUM_M = 0.5
"""How far a device's picture is drawn before its lens."""


@dataclass(frozen=True, kw_only=True)
class ScenePatch(Record):
    """What a patch is and does."""

    corners: tuple[tuple[float, float, float], ...]
    """[m]"""
    region: str
    """Wall, or thing that stands before the walls."""
    reflectance: tuple[float, ...]
    """By band."""
    direct: float | None = None
    """Light of projector white, reflected once, mean over the camera's pixels; None where it sees none."""
    global_light: float | None = None
    confidence: str
    """What its reflectance is from."""


@dataclass(frozen=True, kw_only=True)
class SceneDevice(Record):
    """A camera or projector in the scene."""

    kind: str
    name: str
    position: tuple[float, float, float]
    corners: tuple[tuple[float, float, float], ...]
    """Of its picture, half a metre before its lens."""


@dataclass(frozen=True, kw_only=True)
class SceneTexture(Record):
    """A picture with a square of each patch, row by row (:mod:`rig.report.scene.texture`)."""

    png: str
    """Base64."""
    tile_px: int
    columns: int
    width_px: int
    height_px: int


@dataclass(frozen=True, kw_only=True)
class SceneView(Record):
    """All that the 3-D view draws."""

    patches: tuple[ScenePatch, ...]
    devices: tuple[SceneDevice, ...]
    texture: SceneTexture
    unit: str = "m"


def scene_of(folder: Path) -> SceneView:
    """Return the scene of a session. Raises SessionError before its model is built."""
    session = Session.read(folder)
    return view_of(session, load_model(session))


def view_of(session: Session, model: FittedScene) -> SceneView:
    """Return the scene of a session whose model is loaded."""
    return SceneView(patches=_patches(session, model), devices=_devices(model), texture=_texture(model))


def _texture(model: FittedScene) -> SceneTexture:
    found = reflectance_texture(model, most_texels=_SHOWN_TEXELS)
    height, width = found.image.shape[:2]
    return SceneTexture(
        png=base64.b64encode(found.png).decode(),
        tile_px=found.tile_px,
        columns=found.columns,
        width_px=width,
        height_px=height,
    )


def _patches(session: Session, model: FittedScene) -> tuple[ScenePatch, ...]:
    scene, record = model.scene_model.scene, load_model_record(session)
    bands = [band.scene.reflectance for band in model.room.bands]
    light = session.finished("separation").load_image("separation")
    patch = model.scene_model.camera_hits.hits.patch
    direct, global_ = (_means(image_of(light, name), patch, model, scene.n_patches) for name in ("direct", "global"))
    source = record.bands[0].source
    return tuple(
        ScenePatch(
            corners=_points(scene.vertices[k]),
            region=region_name(model, int(scene.region[k])),
            reflectance=tuple(round(float(band[k]), 4) for band in bands),
            direct=_rounded(direct[k]),
            global_light=_rounded(global_[k]),
            confidence=_WORDS[ReflectanceSource(source[k])] if k < len(source) else "",
        )
        for k in range(scene.n_patches)
    )


def region_name(model: FittedScene, region: int) -> str:
    """Return what a wall, or a thing that stands before the walls, is called."""
    walls = model.scene_model.walls
    return walls[region] if region < len(walls) else f"thing {region - len(walls) + 1}"


def _means(image: NDArray[np.float32], patch: NDArray[np.intp], model: FittedScene, n_patches: int) -> FloatArray:
    """(P,) mean of an image over the lit pixels that see a patch; NaN where none does."""
    seen = model.lit.ravel() & (patch >= 0)
    values = image.mean(axis=-1).ravel().astype(np.float64)
    counts = np.bincount(patch[seen], minlength=n_patches)
    sums = np.bincount(patch[seen], weights=values[seen], minlength=n_patches)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


def _devices(model: FittedScene) -> tuple[SceneDevice, ...]:
    found = model.scene_model
    cameras = [("camera", name, one.device) for name, one in found.cameras.items()]
    projectors = [("projector", name, one.device) for name, one in found.projectors.items()]
    return tuple(_device(*one) for one in (*cameras, *projectors))


def _device(kind: str, name: str, device: PosedLens) -> SceneDevice:
    height, width = device.lens.shape
    corners = np.array([(0, 0), (width - 1, 0), (width - 1, height - 1), (0, height - 1)], dtype=np.float64)
    rays = rays_at(device.lens, device.pose, corners)
    position = device.pose.position_m
    return SceneDevice(
        kind=kind,
        name=name,
        position=_points(position[None])[0],
        corners=_points(position + _FRUSTUM_M * rays / np.linalg.norm(rays, axis=1, keepdims=True)),
    )


def _points(points: FloatArray) -> tuple[tuple[float, float, float], ...]:
    return tuple((round(float(x), 4), round(float(y), 4), round(float(z), 4)) for x, y, z in points)


def _rounded(value: float) -> float | None:
    return round(float(value), 5) if np.isfinite(value) else None
