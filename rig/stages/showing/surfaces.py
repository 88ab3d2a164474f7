"""Pictures fixed to a wall, or to something flat that stands in the room."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.profile.target_table import TargetTable
from rig.stages.scene_model import SceneModel

FloatArray = NDArray[np.float64]

_FLAT = 0.02
"""By which a thing's patches may leave their common plane, of its size: more is curved."""
_THING = "thing "


@dataclass(frozen=True, eq=False, kw_only=True)
class SurfaceFrame:
    """A flat surface as who stands in the room sees it."""

    region: int
    origin_m: FloatArray
    """(3,) its lower left corner."""
    right: FloatArray
    """(3,) unit vector ..."""
    up: FloatArray
    """... and another; for a floor or ceiling, up is where the projector looks."""
    size_m: tuple[float, float]
    """Width and height."""


def surface_frame(scene_model: SceneModel, name: str) -> SurfaceFrame:
    """Return a surface of the room by its name.

    Raises
    ------
    UsageError
        There is none of that name, or it is curved.
    """
    scene, region = scene_model.scene, _region(scene_model, name)
    own = scene.region == region
    normal = np.average(scene.normals[own], axis=0, weights=scene.areas[own])
    normal /= np.linalg.norm(normal)
    up = np.array([0.0, 0.0, 1.0])
    if abs(normal[2]) > np.sqrt(0.5):
        up = scene_model.projector.pose.rotation[2]
    up = up - (up @ normal) * normal
    up /= np.linalg.norm(up)
    right = np.cross(up, normal)
    corners = scene.vertices[own].reshape(-1, 3)
    off_m = np.ptp(corners @ normal)
    across, along = corners @ right, corners @ up
    size_m = float(np.ptp(across)), float(np.ptp(along))
    if off_m > _FLAT * max(size_m):
        raise UsageError(
            f"{name} is curved: its patches leave their plane by {1000 * off_m:.0f} mm; use --placed panorama with "
            "where the viewer stands"
        )
    origin = across.min() * right + along.min() * up + (corners @ normal).mean() * normal
    return SurfaceFrame(region=region, origin_m=origin, right=right, up=up, size_m=size_m)


def _region(scene_model: SceneModel, name: str) -> int:
    walls = scene_model.walls
    last = int(scene_model.scene.region.max())
    if name in walls:
        return walls.index(name)
    number = name.removeprefix(_THING)
    if name.startswith(_THING) and number.isdecimal() and len(walls) <= len(walls) + int(number) - 1 <= last:
        return len(walls) + int(number) - 1
    things = f", thing 1 to thing {last + 1 - len(walls)}" if last >= len(walls) else ""
    raise UsageError(f"the room has no surface {name!r}; it has {', '.join(walls)}{things}")


def surface_places(scene_model: SceneModel, place: TargetTable, shape: tuple[int, int]) -> FloatArray:
    """Return (n, 2) where what each projector pixel lights lies in a picture on a surface; NaN beside it.

    Raises
    ------
    UsageError
        As :func:`surface_frame`; or the four corners are those of no picture.
    """
    frame = surface_frame(scene_model, place.surface or "")
    picture_from_surface = _homography(frame, place, shape)
    hits = scene_model.projector_hits
    away = hits.points_m - frame.origin_m
    on = np.stack([away @ frame.right, away @ frame.up, np.ones(len(away))], axis=-1)
    projected = on @ picture_from_surface.T
    lands = (hits.hits.patch >= 0) & (scene_model.scene.region[hits.hits.patch] == frame.region)
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = projected[:, :2] / projected[:, 2:]
    return np.where((lands & (projected[:, 2] > 0))[:, None], xy, np.nan)


def _homography(frame: SurfaceFrame, place: TargetTable, shape: tuple[int, int]) -> FloatArray:
    """(3, 3) pixels of a picture of metres to the right and up on a surface."""
    height, width = shape
    pixels = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    corners = _filling(frame.size_m, shape) if place.corners_m is None else np.array(place.corners_m)
    sides = np.roll(corners, -1, axis=0) - corners
    following = np.roll(sides, -1, axis=0)
    turns = sides[:, 0] * following[:, 1] - sides[:, 1] * following[:, 0]
    if turns.max() >= 0:
        raise UsageError(
            "corners_m of the picture go round no quadrilateral: give upper left, upper right, lower right, lower "
            "left, each to the right and up from the surface's lower left corner"
        )
    found = cv2.getPerspectiveTransform(corners.astype(np.float32), pixels.astype(np.float32))
    return np.asarray(found, dtype=np.float64)


def _filling(size_m: tuple[float, float], shape: tuple[int, int]) -> FloatArray:
    """(4, 2) corners of a picture that covers a surface, its middle in the surface's middle, its shape kept."""
    scale = max(size_m[0] / shape[1], size_m[1] / shape[0])
    half = np.array([shape[1], shape[0]]) * scale / 2
    middle = np.array(size_m) / 2
    return np.asarray(middle + half * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]))
