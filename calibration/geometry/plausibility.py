"""Which of several readings of the same photographs can be, by what is known of the lenses and their pose.

Points have to lie in front of both devices, projector pixels near their epipolar lines, and a surface that both devices
see from its front keeps its left and right. Along the baseline only the first and the last can tell, so this compares
readings; it proves none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, Float32Array, FloatArray
from calibration.geometry.pinhole import PinholeModel, project
from calibration.geometry.triangulation import triangulate, triangulate_lines
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.orientation import turn_of

_ANOTHER_PX = 0.75
"""Between two readings of a camera pixel: more than the border of two codes."""
_MATTERS = 0.01
"""Share of the lit pixels; readings that differ in fewer are one."""
_RIVAL = 0.5
"""A reading rivals another one when it explains half as many of the pixels in which they differ."""
_LEAST_ACROSS = 0.25
"""Share of the parallax that stripes have to tell: with less, errors of codes move a point by more than four times what
the other stripes would."""


@dataclass(frozen=True, slots=True)
class ReadingView:
    """What one reading of the photographs makes of a grid of camera pixels."""

    projector_xy_px: Float32Array
    """(H, W, 2); NaN where the reading gives none. [px]"""
    lit: BoolArray
    """(H, W) pixels that the projector lights."""
    possible: BoolArray
    """(H, W) pixels with a point in front of both devices and near their epipolar line."""
    turn: NDArray[np.int8]
    """(H, W) 1 where the neighbourhood keeps its left and right, -1 where they are exchanged, 0 where none tells."""

    @property
    def share(self) -> float:
        """Share of the lit pixels that the reading explains."""
        return float(self.possible.sum() / max(int(self.lit.sum()), 1))


@dataclass(frozen=True, slots=True)
class SeenPoints:
    """Points of pairs of pixels, or of camera pixels with the projector column or row alone."""

    points_m: FloatArray
    """(N, 3) NaN where there is none. [m]"""
    projector_xy_px: FloatArray
    """(N, 2) with the missing coordinate that the point has. [px]"""
    epipolar_px: FloatArray
    """(N,) distance from the epipolar line; NaN where a coordinate was missing. [px]"""
    along_stripes: BoolArray
    """(N,) pixels without a point because their stripes run along the baseline."""


def view_of(
    correspondence: Correspondence,
    lit: BoolArray,
    step_px: int,
    *,
    devices: tuple[PinholeModel, PinholeModel],
    limit_px: float,
) -> ReadingView:
    """Judge a reading pixel by pixel.

    Parameters
    ----------
    correspondence : Correspondence
        (H, W), of every so many-th camera pixel.
    lit : (H, W) bool
        Pixels that the projector lights.
    step_px : int
        From pixel to pixel. [camera px]
    devices : (camera, projector)
        Poses in one world.
    limit_px : float
        Largest distance of a projector pixel from its epipolar line. [px]

    Returns
    -------
    ReadingView
    """
    valid = correspondence.valid
    rows, columns = np.nonzero(valid)
    camera_xy = np.column_stack([columns, rows]).astype(np.float64) * step_px
    found = points_of(camera_xy, correspondence.projector_xy_px[rows, columns], devices)
    possible, xy = np.zeros(valid.shape, dtype=bool), np.full((*valid.shape, 2), np.nan, dtype=np.float32)
    possible[rows, columns] = np.isfinite(found.points_m[:, 0]) & ~(found.epipolar_px > limit_px)
    xy[rows, columns] = found.projector_xy_px
    return ReadingView(xy, lit, possible & lit, turn_of(xy))


def points_of(
    camera_xy_px: FloatArray, projector_xy_px: Float32Array | FloatArray, devices: tuple[PinholeModel, PinholeModel]
) -> SeenPoints:
    """Triangulate pairs of pixels, or camera pixels with the projector column or row alone.

    Parameters
    ----------
    camera_xy_px : (N, 2)
        Pixels as photographed. [px]
    projector_xy_px : (N, 2)
        Pixels as shown; a coordinate that was not coded is NaN everywhere. [px]
    devices : (camera, projector)
        Poses in one world.

    Returns
    -------
    SeenPoints
        None behind a device, beside the projector's picture, or where less than a quarter of the parallax is across the
        stripes.
    """
    xy = np.asarray(projector_xy_px, dtype=np.float64)
    coded = np.isfinite(xy).any(axis=0)
    if coded.all() or not len(xy):
        found = triangulate(camera_xy_px, xy, *devices)
        return SeenPoints(found.points_m, xy, found.epipolar_px, np.zeros(len(xy), dtype=bool))
    k = int(np.argmax(coded))
    line = triangulate_lines(camera_xy_px, xy[:, k], *devices, axis=("column", "row")[k])
    with np.errstate(invalid="ignore"):
        along = line.across < _LEAST_ACROSS
    points_m = np.where(along[:, None], np.nan, line.points_m)
    filled = xy.copy()
    filled[:, 1 - k] = project(devices[1], points_m)[:, 1 - k]
    return SeenPoints(points_m, filled, np.full(len(xy), np.nan), along)


def rivals(views: Sequence[ReadingView]) -> tuple[int, ...]:
    """Find the readings that the devices' geometry allows.

    Parameters
    ----------
    views : sequence of ReadingView
        Of the same pixels.

    Returns
    -------
    tuple of int
        The reading that explains most, then those that explain half as many of the pixels in which they differ from
        it; of readings that are the same in nearly all pixels the earliest.
    """
    best = 0
    for k in range(1, len(views)):
        ours, theirs = _explained(views[best], views[k])
        best = k if theirs > ours else best
    others = []
    for k, view in enumerate(views):
        ours, theirs = _explained(views[best], view)
        if k != best and theirs > _RIVAL * ours:
            others.append(k)
    return best, *others


def _explained(a: ReadingView, b: ReadingView) -> tuple[float, float]:
    """Shares of the pixels in which two readings differ that each explains; (1, 0) when they hardly differ."""
    with np.errstate(invalid="ignore"):
        apart = ~(np.abs(a.projector_xy_px - b.projector_xy_px).max(axis=-1) <= _ANOTHER_PX)
    none = np.isnan(a.projector_xy_px[..., 0]) & np.isnan(b.projector_xy_px[..., 0])
    differ = a.lit & apart & ~none
    if differ.sum() <= _MATTERS * a.lit.sum():
        return 1.0, 0.0
    return _share(a, differ), _share(b, differ)


def _share(view: ReadingView, among: BoolArray) -> float:
    """Share of some pixels that can be; a reading that mirrors most of them explains none."""
    mirrored = int(view.turn[view.possible & among].sum(dtype=np.int64)) < 0
    return 0.0 if mirrored else float(view.possible[among].mean())
