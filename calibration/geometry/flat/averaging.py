"""What it does to a coordinate that it was averaged over a window of the camera's picture, on walls that slant.

Refined codes are means over a window, and a lens's blur averages, too. A wall's coordinates do not change linearly
over the picture: by perspective and distortion their mean is off to the side on which they change faster, all of a
slanting wall the same way.
"""

from __future__ import annotations

import numpy as np

from calibration.arrays import FloatArray
from calibration.geometry.bundle_residual import rays_of
from calibration.geometry.bundle_unknowns import PlanarScene
from calibration.geometry.plane_bundle import transfer_of
from calibration.geometry.planes import assign_planes

_REACH_PX = 2.0
"""Of the differences that stand for second derivatives: half of a window, over which a lens bends evenly."""
_LIMIT_PX = 1.5
"""Within which a wall explains a point."""
_MOST_PX = 0.5
"""A wall that slants more changes faster than its second derivative tells."""


def without_averaging(
    camera_xy_px: FloatArray, projector_xy_px: FloatArray, scene: PlanarScene, averaged_px2: float
) -> FloatArray:
    """Take out of coordinates by what averaging over the camera's picture has moved them.

    The mean of a function over a window whose variance along each axis is v differs from its value in the middle by
    v/2 times the function's Laplacian.

    Parameters
    ----------
    camera_xy_px, projector_xy_px : (N, 2)
        Corresponding pixels. [px]
    scene : PlanarScene
        Roughly where lenses and walls are.
    averaged_px2 : float
        Variance of the window along each axis, blur included. [px² of the camera]

    Returns
    -------
    (N, 2)
        Projector pixels; as they were where no wall explains them. [px]
    """
    if not averaged_px2:
        return projector_xy_px
    transfer = transfer_of(scene.projector)
    label = assign_planes(
        transfer, rays_of(scene.camera, camera_xy_px), projector_xy_px, scene.planes, limit_px=_LIMIT_PX, margin_px=0.0
    )
    on, planes = label >= 0, scene.planes[label[label >= 0]]
    steps = _REACH_PX * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    middle, *around = (
        transfer(rays_of(scene.camera, camera_xy_px[on] + step), planes) for step in (np.zeros(2), *steps)
    )
    laplacian = (np.sum(around, axis=0) - 4 * middle) / _REACH_PX**2
    moved = projector_xy_px.copy()
    moved[on] -= np.clip(averaged_px2 / 2 * laplacian, -_MOST_PX, _MOST_PX)
    return moved
