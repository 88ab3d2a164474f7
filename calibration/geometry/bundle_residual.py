"""Where camera pixels land in the projector if their points lie on given walls, and the derivative of that."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration import _kernel
from calibration.arrays import BoolArray, FloatArray, IntArray
from calibration.geometry.bundle_unknowns import (
    CAMERA,
    PROJECTOR,
    ROTATION,
    TRANSLATION,
    devices_of,
    own_slopes_of,
    planes_of,
    turn_slopes_of,
)
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.pinhole import (
    PinholeModel,
    bearings,
    direction_slopes,
    fold_squared,
    lens_slope_units,
    lens_slopes,
    project,
    rotation_slopes,
)
from calibration.geometry.planes import Axes

_FAR_PX = 1e4
"""Beyond, a residual does not grow: a point behind the projector may land anywhere."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LandingError:
    """Residuals (N, 2) of points on walls, a function of the unknowns, with its derivative.

    The kernel computes both: calibration/reference/landing.py is their definition.
    """

    x1: FloatArray
    """(N, 2) camera pixels. [px]"""
    x2: FloatArray
    """(N, 2) projector pixels. [px]"""
    label: IntArray
    """(N,) wall of each point."""
    axes: Axes
    nominal: NominalIntrinsics
    weight: FloatArray | float = 1.0
    """(N, 2) by which a residual counts: 1, and less where a coordinate is less certain than usual."""

    def of_points(self, rows: slice | BoolArray) -> LandingError:
        """Return the residuals of some of the points."""
        weight = self.weight[rows] if isinstance(self.weight, np.ndarray) else self.weight
        return replace(self, x1=self.x1[rows], x2=self.x2[rows], label=self.label[rows], weight=weight)

    @cached_property
    def _kept(self) -> dict[bytes, FloatArray]:
        """Rays of the last lens: a step that is tried and then taken needs them twice."""
        return {}

    @cached_property
    def _seen(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """Projector pixels, weights and labels as the kernel takes them."""
        return (
            np.ascontiguousarray(self.x2, dtype=np.float64),
            np.array(np.broadcast_to(self.weight, self.x2.shape), dtype=np.float64),
            np.ascontiguousarray(self.label, dtype=np.int64),
        )

    def __call__(self, z: FloatArray) -> FloatArray:
        """(N, 2) predicted minus measured projector pixel, weighted. [px]."""
        camera, projector = devices_of(z, self.nominal)
        seen, weight, label = self._seen
        error = np.empty(self.x2.shape)
        _kernel.land(
            bearings=self._rays(camera, z),
            seen=seen,
            weight=weight,
            label=label,
            planes=planes_of(z, self.axes),
            optics=projector.optics,
            pose=_pose(projector),
            fold=fold_squared(projector.distortion),
            far=_FAR_PX,
            error=error,
        )
        return error

    def _rays(self, camera: PinholeModel, z: FloatArray) -> FloatArray:
        key = z[CAMERA].tobytes()
        if key not in self._kept:
            self._kept.clear()
            self._kept[key] = rays_of(camera, self.x1)
        return self._kept[key]

    def jacobian(self, z: FloatArray) -> FloatArray:
        """(n, N, 2) derivative of the weighted residuals by each unknown."""
        camera, projector = devices_of(z, self.nominal)
        rays = self._rays(camera, z)
        seen, weight, label = self._seen
        own, own_slopes = self._own(z)
        result = np.zeros((len(z), len(rays), 2))
        _kernel.slope_landings(
            bearings=rays,
            seen=seen,
            weight=weight,
            label=label,
            planes=planes_of(z, self.axes),
            optics=projector.optics,
            pose=_pose(projector),
            by_lens=lens_slopes(camera, self.x1, rays, lens_slope_units(camera, z[CAMERA.start])),
            units=lens_slope_units(projector, z[PROJECTOR.start]),
            turns=rotation_slopes(z[ROTATION]),
            across=direction_slopes(z[TRANSLATION]),
            plane_turns=turn_slopes_of(z, self.axes),
            own=own,
            own_slopes=own_slopes,
            jacobian=result,
        )
        return result

    def _own(self, z: FloatArray) -> tuple[IntArray, FloatArray]:
        """(K, 2) first and number of each plane's own unknowns, and (K, 3, 3) its derivative by these."""
        slopes = own_slopes_of(z, self.axes)
        places, by_own = np.zeros((len(slopes), 2), dtype=np.int64), np.zeros((len(slopes), 3, 3))
        for k, (at, own) in enumerate(slopes):
            places[k], by_own[k, : len(own)] = (at.start, len(own)), own
        return places, by_own


def _pose(projector: PinholeModel) -> FloatArray:
    """(12,) rotation by rows, then translation."""
    return np.append(projector.rotation, projector.translation_m)


def rays_of(camera: PinholeModel, x1: FloatArray) -> FloatArray:
    """(N, 3) directions of camera pixels."""
    return bearings(x1, camera.focal_px, camera.principal_point_px, camera.distortion)


def landed(projector: PinholeModel, rays: FloatArray, along: FloatArray) -> FloatArray:
    """(N, 2) projector pixels of points at 1 / along on rays."""
    return project(projector, rays / np.where(np.abs(along) > 1e-9, along, 1e-9)[:, None])
