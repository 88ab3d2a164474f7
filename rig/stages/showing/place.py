"""A picture that is wanted somewhere in the room, as the projector's pixels have to show it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.profile.target_table import TargetTable
from rig.stages.model import FittedScene
from rig.stages.scene_model import SceneModel
from rig.stages.showing.cube import cube_places
from rig.stages.showing.surfaces import surface_places
from rig.stages.target import Target

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]

_BLUR_A_STEP = 0.4
"""Spread of the smoothing before a large picture is sampled, of the step between two samples: half a pixel's box."""


def placed(model: FittedScene, target: Target) -> Target:
    """Return the target as a picture of the projector's shape; itself where it is one.

    Parameters
    ----------
    model
        The measured room.
    target
        With where it is wanted.

    Returns
    -------
    Target
        Black where the picture does not reach.

    Raises
    ------
    UsageError
        The viewer stands outside of the room, the surface is none of the room's or is curved, or the picture lands on
        none of the projector's pixels.
    """
    if target.place is None:
        return target
    scene_model = model.scene_model
    picture = target.levels
    xy_px = _PLACES[target.place.placed](scene_model, target.place, (picture.shape[0], picture.shape[1]))
    if not np.isfinite(xy_px[model.room.active]).all(axis=1).any():
        raise UsageError(
            f"{target.name}, {target.place.words}, lands on none of the pixels that the projector lights and the "
            "camera sees; look at the room in the report, and choose another place"
        )
    is_round = target.place.placed == "panorama"
    levels = _sampled(picture, xy_px, scene_model.projector.lens.shape, is_round=is_round)
    return replace(target, levels=levels, place=None, words=target.place.words, before_sha256=target.sha256)


def _camera_places(scene_model: SceneModel, _: TargetTable, shape: tuple[int, int]) -> FloatArray:
    """(n, 2) where the camera sees what each projector pixel lights."""
    height, width = scene_model.camera.lens.shape
    scale = np.array([shape[1] / width, shape[0] / height])
    xy = (scene_model.camera_xy_px + 0.5) * scale - 0.5
    return np.where(scene_model.hidden[:, None], np.nan, xy)


def _panorama_places(scene_model: SceneModel, place: TargetTable, shape: tuple[int, int]) -> FloatArray:
    """(n, 2) in an equirectangular picture: x by azimuth, its middle ahead, y by height above the horizon."""
    ahead, right, up = seen_from(scene_model, place)
    azimuth = np.arctan2(right, ahead)
    elevation = np.arctan2(up, np.hypot(ahead, right))
    x = (azimuth / (2 * np.pi) + 0.5) * shape[1] - 0.5
    return np.stack([x, (0.5 - elevation / np.pi) * shape[0] - 0.5], axis=-1)


def _cube_places(scene_model: SceneModel, place: TargetTable, shape: tuple[int, int]) -> FloatArray:
    return cube_places(np.stack(seen_from(scene_model, place), axis=-1), shape)


def seen_from(scene_model: SceneModel, place: TargetTable) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (n,) each: how far ahead, to the right and up of a viewer each projector pixel's light lands, in metres.

    Raises
    ------
    UsageError
        The viewer stands outside of the room.
    """
    viewer = np.array(place.viewer_m)
    corners = scene_model.scene.vertices.reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    if len(scene_model.walls) == _CLOSED and not ((viewer > low) & (viewer < high)).all():
        room = ", ".join(f"{axis} {a:.2f} to {b:.2f}" for axis, a, b in zip("xyz", low, high, strict=True))
        at = ", ".join(f"{one:g}" for one in viewer)
        raise UsageError(f"the viewer at {at} m stands outside of the room ({room} m); give a point within")
    axis = scene_model.projector.pose.rotation[2]
    turn = np.arctan2(axis[1], axis[0]) - np.radians(place.turn_deg)
    away = scene_model.projector_hits.points_m - viewer
    ahead = away[:, 0] * np.cos(turn) + away[:, 1] * np.sin(turn)
    right = away[:, 0] * np.sin(turn) - away[:, 1] * np.cos(turn)
    return ahead, right, away[:, 2]


_CLOSED = 6
"""Walls of a room that has an inside."""
_Places = Callable[[SceneModel, TargetTable, tuple[int, int]], FloatArray]
_PLACES: Mapping[str, _Places] = {
    "camera": _camera_places,
    "panorama": _panorama_places,
    "cube": _cube_places,
    "surface": surface_places,
}


def _sampled(picture: Float32Array, xy_px: FloatArray, shape: tuple[int, int], *, is_round: bool) -> Float32Array:
    """(H, W, C) levels of a picture at places (H · W, 2) in it; 0 beyond it, and where places are NaN."""
    height, width = picture.shape[:2]
    places = xy_px.reshape(*shape, 2)
    smooth = _smoothed(picture, _step_px(places), is_round=is_round)
    wide = np.concatenate([smooth[:, -1:], smooth, smooth[:, :1]], axis=1) if is_round else smooth
    inside = np.isfinite(places).all(axis=-1) & (places > -0.5).all(axis=-1)
    inside &= (places[..., 0] < width - 0.5) & (places[..., 1] < height - 0.5)
    x = np.where(inside, places[..., 0], 0) + (1.0 if is_round else 0.0)
    y = np.where(inside, places[..., 1], 0)
    found = cv2.remap(
        wide, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    ).reshape(*shape, picture.shape[2])
    return np.where(inside[..., None], found, 0.0).astype(np.float32)


def _step_px(places: FloatArray) -> float:
    """Median distance in the picture between the places of neighbouring pixels."""
    steps = np.concatenate([np.diff(places, axis=0).reshape(-1, 2), np.diff(places, axis=1).reshape(-1, 2)])
    lengths = np.linalg.norm(steps[np.isfinite(steps).all(axis=1)], axis=1)
    return float(np.median(lengths)) if len(lengths) else 0.0


def _smoothed(picture: Float32Array, step_px: float, *, is_round: bool) -> Float32Array:
    """A picture without what is finer than the step at which it is sampled."""
    if step_px <= 1:
        return picture
    margin = int(np.ceil(4 * _BLUR_A_STEP * step_px)) if is_round else 0
    wide = np.pad(picture, ((0, 0), (margin, margin), (0, 0)), mode="wrap") if margin else picture
    sigma = _BLUR_A_STEP * np.sqrt(step_px**2 - 1)
    blurred = cv2.GaussianBlur(wide, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
    smooth: Float32Array = np.asarray(blurred, dtype=np.float32).reshape(wide.shape)
    return smooth[:, margin : margin + picture.shape[1]]
