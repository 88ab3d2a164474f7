"""Metres for a calibration: by the distance of the lenses, or by that of two spots on the walls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from calibration.arrays import FloatArray, IntArray
from calibration.errors import CalibrationError
from calibration.geometry.pinhole import points_on_planes, world_rays
from calibration.geometry.stereo import StereoCalibration

_EDGE_PX, _SAME_PLACE = 3.0, 0.003
"""Nearer to an edge, points around a spot may be those of the other wall: they are sought within 3 % of the lit width.
Walls that are no more than a tape's error apart may be taken for each other."""
_AROUND_PX = _EDGE_PX * np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)], dtype=np.float64)


def _scaled(stereo: StereoCalibration, factor: float) -> StereoCalibration:
    """Multiply every length by a factor."""
    devices = (stereo.camera, stereo.projector)
    camera, projector = (replace(device, translation_m=device.translation_m * factor) for device in devices)
    return replace(stereo, camera=camera, projector=projector, planes=stereo.planes / factor, bow=stereo.bow * factor)


def scale_from_baseline(stereo: StereoCalibration, baseline_m: float) -> StereoCalibration:
    """Put a calibration into metres by the distance of the two lenses.

    Parameters
    ----------
    stereo : StereoCalibration
        Of any unit of length.
    baseline_m : float
        Distance of the two centres of projection. [m]

    Returns
    -------
    StereoCalibration
        In metres.
    """
    return _scaled(stereo, baseline_m / stereo.baseline)


def scale_from_spots(stereo: StereoCalibration, spots_px: ArrayLike, distance_m: float) -> StereoCalibration:
    """Put a calibration into metres by the distance between the spots that two projector pixels light on the planes.

    Parameters
    ----------
    stereo : StereoCalibration
        Of any unit of length.
    spots_px : (2, 2)
        Projector column and row of the spots. [px]
    distance_m : float
        Between the spots. [m]

    Returns
    -------
    StereoCalibration
        In metres.

    Raises
    ------
    CalibrationError
        If nothing was measured around a spot, a spot lies where two walls meet, or both are one place.
    """
    pixels = np.asarray(spots_px, dtype=np.float64)
    which = _planes_at(stereo, pixels)
    _refuse_edges(stereo, pixels, np.where(which < 0, stereo.explained.plane_at(pixels), which))
    unknown = np.flatnonzero(which < 0)
    if len(unknown):
        named = " and ".join(f"({x:g}, {y:g})" for x, y in pixels[unknown])
        raise CalibrationError(
            f"spot {named} px of [scale] spots_px has no measured wall around it: the camera does not see there what "
            "the projector lights, or no wall explains it; choose spots on bare walls that the camera sees, and measure"
        )
    spots = points_on_planes(stereo.projector, pixels, stereo.planes[which])
    measured = float(np.linalg.norm(spots[1] - spots[0]))
    if measured < 1e-6:
        raise CalibrationError("the two spots of [scale] spots_px are one place; choose two far apart")
    return _scaled(stereo, distance_m / measured)


def points_of_projector_pixels(stereo: StereoCalibration, xy_px: FloatArray) -> FloatArray:
    """Find the surface points that projector pixels light: on the plane of the correspondences around them.

    Parameters
    ----------
    stereo : StereoCalibration
        With planes.
    xy_px : (N, 2)
        Projector pixels. [px]

    Returns
    -------
    (N, 3)
        In the camera's frame; NaN where nothing that was measured tells the plane.
    """
    which = _planes_at(stereo, xy_px)
    planes = np.where((which >= 0)[:, None], stereo.planes[which], np.nan)
    return points_on_planes(stereo.projector, xy_px, planes)


def _planes_at(stereo: StereoCalibration, xy_px: FloatArray) -> IntArray:
    """(N,) plane that projector pixels light: of points all around, or of all nearest if their ray meets it first."""
    explained = stereo.explained
    around = np.where(explained.are_among(xy_px), explained.plane_at(xy_px), -1)
    beside, first = explained.plane_beside(xy_px), _along(stereo, xy_px).argmin(axis=1)
    return np.where(around >= 0, around, np.where(beside == first, beside, -1))


def _along(stereo: StereoCalibration, xy_px: FloatArray) -> FloatArray:
    """(N, K) how far along their rays projector pixels (N, 2) meet each plane; infinite behind the projector."""
    origin, rays = stereo.projector.position_m, world_rays(stereo.projector, xy_px)
    with np.errstate(divide="ignore"):
        along = (1 - stereo.planes @ origin)[None, :] / (rays @ stereo.planes.T)
    return np.where(along > 0, along, np.inf)


def _refuse_edges(stereo: StereoCalibration, spots_px: FloatArray, which: IntArray) -> None:
    """Raise CalibrationError for a spot that the points around put on a wall behind another one that ends there.

    The camera may not see the grazing wall of a corner, or not the spot itself; the nearest points are then beyond the
    edge, and the tape would be laid there.
    """
    for spot, told, along in zip(spots_px, which, _along(stereo, spots_px), strict=True):
        first = int(along.argmin())
        if told < 0 or first == told or along[told] < (1 + _SAME_PLACE) * along[first]:
            continue
        near = _along(stereo, spot + _AROUND_PX)
        if (near[:, told] < near[:, first]).any():
            x, y = spot
            raise CalibrationError(
                f"spot ({x:g}, {y:g}) px of [scale] lies within {_EDGE_PX:g} px of the edge between two walls: "
                f"they are {100 * (along[told] / along[first] - 1):.2g} % of its distance apart there, and the "
                "camera does not tell on which it is; choose spots further from edges, and measure"
            )
