"""Codes to points of a scan: one a projector pixel, or one a camera pixel where columns or rows alone are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import BoolArray, Float32Array, FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.pinhole import PinholeModel
from calibration.geometry.plausibility import SeenPoints, points_of
from calibration.geometry.triangulation import PixelPairs, average_by_projector_pixel
from calibration.structured_light.correspondence import ROUNDING_PX, Correspondence
from calibration.structured_light.neighbours import beside_jumps
from calibration.structured_light.subpixel import refine_subpixel
from rig.devices.replay.photographs import Manifest

_LEAST_TOLD = 0.5
_CODE_SIGMA_PX = 0.3
"""Of a whole code, whose error is anything within half a pixel: good enough for a point."""
_ROUGH = 3.0
"""Codes whose standard deviation is greater than that and than so many times the median give no point: beside edges
coarse stripes cannot be refined, and would be half a stripe off in silence."""
_LEAST_JUMP = 3.0
"""Of whole codes, which differ by two over three pixels of a smooth surface whose pixels are the cells. [cells]"""


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundPoints:
    """Points before the wrong ones are left out."""

    points_m: FloatArray
    camera_xy_px: FloatArray
    epipolar_px: FloatArray
    """NaN where columns or rows alone were photographed."""
    code_sigma_px: float | None
    """Median standard deviation of the codes; None where the epipolar distances tell it."""
    cell_xy: FloatArray | None
    """(N, 2) whole projector pixels, or the stripes of which the code counts them; None where only one is known."""
    cells: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of the finest stripes that were shown, as projector pixels."""

    size_px: int
    first_px: Float32Array
    """(2,) middle of the first one. [px]"""

    def of(self, projector_xy_px: Float32Array) -> Float32Array:
        """Projector pixels counted in cells."""
        return (projector_xy_px - self.first_px) / np.float32(self.size_px)

    def projector_px(self, cells_xy: FloatArray | Float32Array) -> FloatArray:
        """Cells as projector pixels."""
        return np.asarray(cells_xy * self.size_px + self.first_px, dtype=np.float64)


def pairs_by_projector_pixel(
    manifest: Manifest, correspondence: Correspondence
) -> tuple[PixelPairs, FloatArray, tuple[int, int]]:
    """Make pairs by cell of the finest stripes that were shown.

    Parameters
    ----------
    manifest : Manifest
    correspondence : Correspondence
        Whole codes of both axes.

    Returns
    -------
    tuple
        Pairs whose projector pixels are cells, (N, 2) the projector's own pixels, and (rows, columns) of cells.
    """
    counted, cells = in_cells(manifest, correspondence)
    pairs = average_by_projector_pixel(counted)
    return pairs, cells.projector_px(pairs.projector_xy_px), counted.projector_shape


def points_by_projector_pixel(
    manifest: Manifest, correspondence: Correspondence, devices: tuple[PinholeModel, PinholeModel]
) -> FoundPoints:
    """Make one point for each projector pixel that is seen, or for each cell of the finest stripes that were shown.

    Parameters
    ----------
    manifest : Manifest
    correspondence : Correspondence
        Whole codes of both axes.
    devices : (camera, projector)

    Returns
    -------
    FoundPoints
    """
    pairs, projector_xy_px, shape = pairs_by_projector_pixel(manifest, correspondence)
    found = points_of(pairs.camera_xy_px, projector_xy_px, devices)
    return FoundPoints(
        points_m=found.points_m,
        camera_xy_px=pairs.camera_xy_px,
        epipolar_px=found.epipolar_px,
        code_sigma_px=None,
        cell_xy=pairs.projector_xy_px,
        cells=shape,
    )


def points_by_camera_pixel(
    manifest: Manifest, correspondence: Correspondence, devices: tuple[PinholeModel, PinholeModel]
) -> FoundPoints:
    """Make one point for each camera pixel: columns or rows alone name no projector pixel.

    Without epipolar lines nothing contradicts a code that is of neither side where a surface ends; none is taken there.

    Parameters
    ----------
    manifest : Manifest
    correspondence : Correspondence
        Whole codes of one axis; the other is NaN.
    devices : (camera, projector)

    Returns
    -------
    FoundPoints

    Raises
    ------
    CalibrationError
        Fewer than half of the codes give a point.
    """
    counted, cells = in_cells(manifest, correspondence)
    refined = refine_subpixel(counted)
    taken, sigma_px = _trusted(counted, refined, cells.size_px)
    row, column = np.nonzero(taken)
    camera_xy_px = np.column_stack([column, row]).astype(np.float64)
    found = points_of(camera_xy_px, cells.projector_px(refined.projector_xy_px[row, column]), devices)
    _refuse_untold(found)
    return FoundPoints(
        points_m=found.points_m,
        camera_xy_px=camera_xy_px,
        epipolar_px=found.epipolar_px,
        code_sigma_px=sigma_px,
        cell_xy=None,
        cells=counted.projector_shape,
    )


def in_cells(manifest: Manifest, correspondence: Correspondence) -> tuple[Correspondence, Cells]:
    """Return codes counted in cells of the finest stripes that were shown, whole where the code is, and the cells."""
    size = 2**manifest.finest_bit
    first = np.array(manifest.first_code, dtype=np.float32)
    height, width = (
        -(-(length + int(offset)) // size) for length, offset in zip(manifest.projector_shape, first[::-1], strict=True)
    )
    cells = Cells(size, np.float32((size - 1) / 2) - first)
    return Correspondence(cells.of(correspondence.projector_xy_px), correspondence.reason, (height, width)), cells


def _trusted(counted: Correspondence, refined: Correspondence, size_px: int) -> tuple[BoolArray, float]:
    """(H, W) camera pixels inside of surfaces whose code is as good as most, and its median standard deviation."""
    whole = np.where(counted.valid[..., None], counted.projector_xy_px, np.float32(np.nan))
    coded = int(np.argmax(np.isfinite(whole).any(axis=(0, 1))))
    inside = refined.valid & ~beside_jumps(np.ascontiguousarray(whole[..., coded]), _LEAST_JUMP)
    sigma_px = np.full(inside.shape, ROUNDING_PX * size_px)
    if refined.sigma_px is not None:
        sigma_px = size_px * refined.sigma_px[..., coded].astype(np.float64)
    median_px = float(np.median(sigma_px[inside])) if inside.any() else ROUNDING_PX * size_px
    return inside & (sigma_px < max(_CODE_SIGMA_PX, _ROUGH * median_px)), median_px


def _refuse_untold(found: SeenPoints) -> None:
    """Raise CalibrationError where columns or rows alone give few points, by what most of the others lack."""
    told = float(np.isfinite(found.points_m[:, 0]).mean()) if len(found.points_m) else 1.0
    if told >= _LEAST_TOLD:
        return
    along = float(found.along_stripes.mean())
    cause = (
        "the stripes of most run along the line from camera to projector; photograph the other ones, or both"
        if along >= 1 - told - along
        else "by lenses and pose, most others lie behind a device or beside the projector's picture; check them, "
        "[projector.crop] and first_code"
    )
    raise CalibrationError(
        f"columns or rows alone give only {100 * told:.0f} % of their pixels a point (limit {100 * _LEAST_TOLD:g} %): "
        f"{cause}"
    )
