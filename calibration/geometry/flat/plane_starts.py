"""Where a search for planes begins: devices by their epipolar lines, planes by the points that these triangulate."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np

from calibration.arrays import FloatArray
from calibration.geometry.bundle_residual import rays_of
from calibration.geometry.bundle_unknowns import PlanarScene
from calibration.geometry.epipolar import COLUMN_SHARES, UNDISTORTIONS, fit_epipolar
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.pinhole import PinholeModel
from calibration.geometry.plane_bundle import transfer_of
from calibration.geometry.planes import INLIER_PX, Axes, ViewedPoints, segment_planes
from calibration.geometry.triangulation import triangulate

FEW_POINTS = 4000
"""That planes are looked for in."""
_EPIPOLAR_MEDIANS, LEAST_LIMIT_PX = 10.0, 0.4
"""Where planes differ by few pixels of parallax, whole codes' limit would take two for one."""


def starts_by_lines(
    x1: FloatArray, x2: FloatArray, nominal: NominalIntrinsics, *, ahead: bool, bent: bool = False
) -> Iterator[PlanarScene]:
    """Yield devices by their epipolar lines, and the planes that are found in the points that they triangulate.

    Parameters
    ----------
    x1, x2 : (N, 2)
        Corresponding pixels, in an order drawn by chance. [px]
    nominal : NominalIntrinsics
        Of both lenses.
    ahead, bent : bool
        As :func:`calibration.geometry.epipolar.fit_epipolar` takes them.

    Yields
    ------
    PlanarScene
        With free planes.
    """
    a, b = nominal.idealised(x1[:FEW_POINTS], x2[:FEW_POINTS])
    shares = COLUMN_SHARES if nominal.known.projector is None else COLUMN_SHARES[:1]
    found = (fit_epipolar(a, b, nominal, share, ahead=ahead, bent=bent) for share in shares)
    for devices in chain.from_iterable(found):
        planes = planes_of(devices, a, b)
        if len(planes) >= 2:
            free = Axes(np.eye(3), np.full(len(planes), -1))
            camera, projector = nominal.real(devices)
            yield PlanarScene(camera=camera, projector=projector, planes=planes, axes=free)


def planes_of(
    devices: tuple[PinholeModel, PinholeModel], x1: FloatArray, x2: FloatArray, limit_px: float | None = None
) -> FloatArray:
    """Return (K, 3) planes in points (N, 2) at both devices; each explains its points to within the limit, in pixels.

    By default the limit is ten times the median by which rays miss each other, and at most that of whole codes.
    """
    a, b = x1[:FEW_POINTS], x2[:FEW_POINTS]
    found = triangulate(a, b, *devices, on_camera_rays=True, undistortions=UNDISTORTIONS)
    if limit_px is None:
        limit_px = float(np.clip(_EPIPOLAR_MEDIANS * np.nanmedian(found.epipolar_px), LEAST_LIMIT_PX, INLIER_PX))
    seen = ViewedPoints(found.points_m, rays_of(devices[0], a), a, b)
    return segment_planes(seen, transfer_of(devices[1]), found.in_front, limit_px)
