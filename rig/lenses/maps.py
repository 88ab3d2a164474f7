"""Maps over both pictures: where corners were seen, what is left of them, how sure a projection is."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.lenses.calibrate import LensFit
from calibration.lenses.halves import HalvesDifference, compare_halves, halves_of
from calibration.lenses.lens import FittedLens
from calibration.lenses.records import RigState
from calibration.lenses.uncertainty import FAR_M, Anchor, pixel_grid, projection_covariance, worst_sigma

FloatArray = NDArray[np.float64]
_COLUMNS = 24
"""Of a map."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DeviceMaps:
    """What is drawn of one device, and what its numbers are read from."""

    role: str
    lens: FittedLens
    seen_px: FloatArray
    """(N, 2) corners that the fit rests on."""
    residual_px: FloatArray
    """(N, 2) seen minus modelled."""
    left_out_px: FloatArray
    """(M, 2) corners that do not belong."""
    left_out_residual_px: FloatArray
    """(M, 2)"""
    grid_px: FloatArray
    """(K, 2)"""
    grid_shape: tuple[int, int]
    near_m: float
    """Median distance of the boards."""
    sigma_near_px: FloatArray
    """(K,) at that distance, in the worst direction."""
    sigma_far_px: FloatArray
    """(K,) far away."""
    halves: HalvesDifference | None
    inside: NDArray[np.bool_]
    """(K,) places of the grid within the outline of the corners: elsewhere a lens is extrapolated."""


def device_maps(fit: LensFit) -> tuple[DeviceMaps, ...]:
    """Return the maps of the camera, and of the projector if there is one."""
    calibration = fit.calibration
    halves = halves_of(fit.settled)
    anchor = Anchor.of(fit.settled.sightings, fit.settled.state)
    near_m = float(np.median(np.linalg.norm(calibration.state.translations_m, axis=1)))
    found = []
    for device, lens in enumerate((calibration.camera, calibration.projector)):
        if lens is None:
            continue
        grid, shape = pixel_grid(lens.width_px, lens.height_px, _COLUMNS)
        sigmas = [
            worst_sigma(projection_covariance(anchor, calibration.covariance, grid, far, in_projector=bool(device)))
            for far in (near_m, FAR_M)
        ]
        seen = calibration.sightings.projector_xy_px if device else calibration.sightings.camera_xy_px
        weight = calibration.sightings.projector_weight if device else calibration.sightings.camera_weight
        used = calibration.used[:, device]
        odd = ~used & (weight > 0)
        residual = calibration.residual_px[:, 2 * device : 2 * device + 2]
        found.append(
            DeviceMaps(
                role="projector" if device else "camera",
                lens=lens,
                seen_px=seen[used],
                residual_px=residual[used],
                left_out_px=seen[odd],
                left_out_residual_px=residual[odd],
                grid_px=grid,
                grid_shape=shape,
                near_m=near_m,
                sigma_near_px=sigmas[0],
                sigma_far_px=sigmas[1],
                halves=_told(halves, grid, lens.width_px, in_projector=bool(device)),
                inside=_inside(grid, seen[used]),
            )
        )
    return tuple(found)


def _told(
    halves: tuple[Anchor, RigState, FloatArray, FloatArray] | None,
    grid_px: FloatArray,
    width_px: int,
    *,
    in_projector: bool,
) -> HalvesDifference | None:
    """What two halves of the views say of each other; None where one of them says nothing."""
    if halves is None:
        return None
    found = compare_halves(halves, grid_px, in_projector=in_projector)
    return found if found.tells(width_px) else None


def _inside(grid_px: FloatArray, seen_px: FloatArray) -> NDArray[np.bool_]:
    """(K,) which places lie within the convex outline of the corners."""
    outline = cv2.convexHull(seen_px.astype(np.float32).reshape(-1, 1, 2))
    return np.array([cv2.pointPolygonTest(outline, (float(x), float(y)), False) >= 0 for x, y in grid_px])
