"""The measured scene as triangles for the page's 3-D view: patches, what is known of them, devices in their places."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.light.reflectance import ReflectanceSource
from rig.files.channels import image_of
from rig.records import Record
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
    direct: float | None
    """Light of projector white, reflected once, mean over the camera's pixels; None where it sees none."""
    global_light: float | None
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
class SceneView(Record):
    """All that the 3-D view draws."""

    patches: tuple[ScenePatch, ...]
    devices: tuple[SceneDevice, ...]
    unit: str = "m"


def scene_of(folder: Path) -> SceneView:
    """Return the scene of a session. Raises SessionError before its model is built."""
    session = Session.read(folder)
    model = load_model(session)
    return SceneView(patches=_patches(session, model), devices=_devices(model))


def _patches(session: Session, model: FittedScene) -> tuple[ScenePatch, ...]:
    scene, record = model.scene_model.scene, load_model_record(session)
    bands = [band.scene.reflectance for band in model.room.bands]
    light = session.finished("separation").load_image("separation")
    patch = model.scene_model.camera_hits.hits.patch
    direct, global_ = (_means(image_of(light, name), patch, model, scene.n_patches) for name in ("direct", "global"))
    names = _region_names(model)
    source = record.bands[0].source
    return tuple(
        ScenePatch(
            corners=_points(scene.vertices[k]),
            region=names.get(int(scene.region[k]), f"thing {int(scene.region[k]) - len(names) + 1}"),
            reflectance=tuple(round(float(band[k]), 4) for band in bands),
            direct=_rounded(direct[k]),
            global_light=_rounded(global_[k]),
            confidence=_WORDS[ReflectanceSource(source[k])] if k < len(source) else "",
        )
        for k in range(scene.n_patches)
    )


def _region_names(model: FittedScene) -> Mapping[int, str]:
    return dict(enumerate(model.scene_model.walls))


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
