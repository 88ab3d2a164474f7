"""What stands before the walls of a measured room: pixels whose light does not land where the walls are."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calibration.arrays import BoolArray, FloatArray, IntArray
from calibration.geometry.pinhole import project
from calibration.geometry.room import FACES, RoomBox
from calibration.structured_light.correspondence import Correspondence
from calibration.surfaces.point_map import camera_rays

_OFF_PX, _OFF_SIGMAS = 0.5, 5.0
"""Projector pixels, and standard deviations, by which light may miss its wall. Of the bare walls of seven simulated
rooms (``random_worlds.py --odd``, seeds 600 to 607), strips along edges apart, 1 pixel in 2,400 missed by more than
either, as many as by more than 1 px."""
THIN_PX = 3
"""Camera pixels: what is thinner than this in each direction is the edge of two surfaces, not a surface."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BeforeWalls:
    """Which camera pixels see the walls of a room, which something that stands before them."""

    face: IntArray
    """(H, W) number in ``FACES`` of the wall that a pixel's ray meets first; -1 outside the room's faces."""
    wall_distance_m: FloatArray
    """(H, W) along the ray to that wall; infinite for none. [m]"""
    stands: BoolArray
    """(H, W) valid pixels that see something else than this wall."""


def before_walls(correspondence: Correspondence, box: RoomBox) -> BeforeWalls:
    """Find the pixels whose code says that their light does not land on the wall behind them.

    Parameters
    ----------
    correspondence : Correspondence
        Of both devices.
    box : RoomBox
        The room, and the devices in it.

    Returns
    -------
    BeforeWalls
    """
    camera, rays = box.camera, camera_rays(box.camera)
    face, distance_m = _first_wall(camera.position_m, rays, box)
    rows, columns = np.nonzero(correspondence.valid)
    on_wall = camera.position_m + distance_m[rows, columns][:, None] * rays[rows, columns]
    there = np.isfinite(on_wall).all(axis=1)
    off_px = np.full(len(rows), np.inf)
    seen = correspondence.projector_xy_px[rows, columns].astype(np.float64)
    off_px[there] = np.abs(project(box.projector, on_wall[there]) - seen[there]).max(axis=1)
    limit = np.full(len(rows), _OFF_PX)
    if correspondence.sigma_px is not None:
        limit = np.maximum(limit, _OFF_SIGMAS * correspondence.sigma_px[rows, columns].max(axis=1))
    stands = np.zeros(correspondence.reason.shape, dtype=bool)
    stands[rows, columns] = off_px > limit
    return BeforeWalls(face=face, wall_distance_m=distance_m, stands=opened(stands, THIN_PX))


def apart_from_walls(box: RoomBox, points_m: FloatArray) -> FloatArray:
    """Return how far points are from the nearest face of a room.

    Parameters
    ----------
    box : RoomBox
    points_m : (..., 3)
        NaN for none. [m]

    Returns
    -------
    (...) array
        NaN for no point. [m]
    """
    offsets = [np.array(divmod(FACES.index(name), 2)) for name in box.faces]
    apart = [np.abs(points_m[..., axis] - side * box.size_m[axis]) for axis, side in offsets]
    return np.asarray(np.min(apart, axis=0))


def _first_wall(origin_m: FloatArray, rays: FloatArray, box: RoomBox) -> tuple[IntArray, FloatArray]:
    """(H, W) which face of the box each ray meets first, and how far away."""
    nearest_m, which = np.full(rays.shape[:2], np.inf), np.full(rays.shape[:2], -1, dtype=np.int64)
    for name in box.faces:
        number = FACES.index(name)
        axis, side = divmod(number, 2)
        offset_m = side * box.size_m[axis] - origin_m[axis]
        with np.errstate(divide="ignore", invalid="ignore"):
            along = offset_m / rays[..., axis]
        closer = (along > 0) & (along < nearest_m)
        nearest_m, which = np.where(closer, along, nearest_m), np.where(closer, number, which)
    return which, nearest_m


def opened(mask: BoolArray, window_px: int) -> BoolArray:
    """Return (H, W) where a mask fills a window of so many pixels: without strips along edges."""
    window = np.ones((window_px, window_px), np.uint8)
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, window) > 0)
