"""The photographs of now against the session's map: which device moved, what else did, and how bright it is."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.geometry.moved.find import find_motion
from calibration.geometry.moved.records import ComparedPixels, MotionFound
from calibration.geometry.moved.residual import points_on
from calibration.geometry.pinhole import PinholeModel, bearings, project
from calibration.radiometry.steadiness import LightChange, light_change
from calibration.structured_light.correspondence import Correspondence
from rig.recheck.known import KnownRig
from rig.recheck.records import SurfaceChange
from rig.stages.maps.sampling import sample

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_FITTED = 5000
"""Pixels that the motion is fitted to: on 320 x 240 px every fourth, and more do not change the answer by its sigma."""
_MAPPED = 40_000
"""Pixels of the map of residuals."""
_WINDOW_SHARE = 0.025
"""Of the picture's width: over so much the residuals are averaged, in which a thing that moved is told from noise."""
_ELSEWHERE_SIGMAS, _ELSEWHERE_PX = 6.0, 0.5
"""Mean residual within a window that stands for a surface which stands elsewhere, if it exceeds both: the refinement
of edges is wrong by up to 0.4 px in a row."""
_FAR_PX = 50.0
"""Beyond, a residual counts no more: one wrong pixel is not a thing."""
_LEAST_IN_WINDOW = 0.25
"""Of a window's pixels."""
_NAMED_SHARE = 0.15
"""Of the pixels that see something elsewhere: a wall with as many of them is named."""
_LEAST_DIRECT = 0.1
"""Of the median light of white: where less was before, a pixel that is lost now tells nothing."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Compared:
    """Everything that the photographs say."""

    motion: MotionFound
    surface: SurfaceChange
    light: LightChange
    residual_px: FloatArray
    """(h, w, 2) what the motion leaves over, thinned, NaN where nothing is compared; in projector pixels."""
    before_px: FloatArray
    """(h, w, 2) the same before any motion was fitted."""
    elsewhere: BoolArray
    """(h, w) where something stands elsewhere."""


def compare(known: KnownRig, now: Correspondence, white: FloatArray, black: FloatArray) -> Compared:
    """Hold what the camera sees now against what a session knows.

    Parameters
    ----------
    known
        Of the session.
    now : Correspondence
        Map of now, of the same camera and projector.
    white, black : (H, W)
        Light of now, as in ``known``.

    Returns
    -------
    Compared

    Raises
    ------
    CalibrationError
        Too little is seen to compare, or nothing explains it; with the cause.
    """
    both = known.map.valid & now.valid
    motion = find_motion(known.camera, known.projector, _pixels(known, now, _thinned(both, _FITTED)), known.seen_by)
    mapped = _grid(both.shape, _MAPPED)
    residual, before, label = _residuals(known, now, motion, mapped)
    elsewhere = _elsewhere(residual, motion.noise_px)
    surface = SurfaceChange(
        share=float(elsewhere.sum() / max(np.isfinite(residual[..., 0]).sum(), 1)),
        lost_share=_lost_share(known, now, motion, mapped),
        walls=_walls(known, label[elsewhere]),
    )
    light = _light(known, motion, mapped, white=white, black=black)
    return Compared(
        motion=motion, surface=surface, light=light, residual_px=residual, before_px=before, elsewhere=elsewhere
    )


def refuse_darkness(known: KnownRig, white: FloatArray, least_share: float) -> float:
    """Return how bright white is now, of what it was. Raises CalibrationError when the projector is not seen."""
    before, now = (float(np.quantile(light, 0.9)) for light in (known.white, white))
    share = now / before if before > 0 else 0.0
    if share < least_share:
        raise CalibrationError(
            f"projector white is {100 * max(share, 0):.1f} % as bright as when the session was calibrated, the limit "
            f"is {100 * least_share:g} %: the projector is off, asleep or covered, shows another input, or the camera "
            "is covered or looks elsewhere; put it right, then check again"
        )
    return share


def refuse_flood(black_dn: NDArray[np.uint16], saturation_dn: int, most_share: float) -> None:
    """Raise CalibrationError when the camera is blinded by light that is not the projector's."""
    share = float((black_dn >= saturation_dn).mean())
    if share > most_share:
        raise CalibrationError(
            f"{100 * share:.0f} % of the camera's pixels are clipped while the projector shows black, the limit is "
            f"{100 * most_share:g} %: a light is on, or daylight comes in; darken the room as it was when the session "
            "was calibrated, then check again"
        )


def _thinned(mask: BoolArray, count: int) -> NDArray[np.intp]:
    """(N, 2) rows and columns of at most about so many pixels of a mask, evenly spread."""
    stride = max(1, int(np.sqrt(mask.sum() / count)))
    rows, columns = np.nonzero(mask[::stride, ::stride])
    return np.stack([rows * stride, columns * stride], axis=1)


def _grid(shape: tuple[int, ...], count: int) -> tuple[slice, slice]:
    stride = max(1, round(float(np.sqrt(shape[0] * shape[1] / count))))
    return slice(stride // 2, None, stride), slice(stride // 2, None, stride)


def _pixels(known: KnownRig, now: Correspondence, places: NDArray[np.intp]) -> ComparedPixels:
    at = places[:, 0], places[:, 1]
    return ComparedPixels(
        camera_xy_px=places[:, ::-1].astype(np.float64),
        before_px=known.map.projector_xy_px[at].astype(np.float64),
        now_px=now.projector_xy_px[at].astype(np.float64),
    )


def _xy(shape: tuple[int, ...], mapped: tuple[slice, slice]) -> FloatArray:
    """(h, w, 2) camera pixels of the thinned map."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    return np.stack([columns[mapped], rows[mapped]], axis=-1).astype(np.float64)


def _residuals(
    known: KnownRig, now: Correspondence, motion: MotionFound, mapped: tuple[slice, slice]
) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """Measured minus expected projector pixels (h, w, 2), the same without any motion, and the walls (h, w)."""
    xy = _xy(now.valid.shape, mapped)
    before, seen = (m.projector_xy_px[mapped].astype(np.float64) for m in (known.map, now))
    shift = seen - before
    flat = xy.reshape(-1, 2)
    landed = _landed_now(known, motion, flat) - _landed_before(known, flat)
    label = known.seen_by(motion.camera_now, flat).label
    return shift - landed.reshape(shift.shape), shift, label.reshape(shift.shape[:2])


def _landed_before(known: KnownRig, xy_px: FloatArray) -> FloatArray:
    """(N, 2) projector pixels that camera pixels should see by the session's own geometry."""
    return project(known.projector, _points(known, known.camera, xy_px))


def _landed_now(known: KnownRig, motion: MotionFound, xy_px: FloatArray) -> FloatArray:
    """(N, 2) the same where the devices stand now."""
    return project(motion.projector_now, _points(known, motion.camera_now, xy_px))


def _points(known: KnownRig, camera: PinholeModel, xy_px: FloatArray) -> FloatArray:
    """(N, 3) of the walls that a camera's pixels see. [m]."""
    rays = bearings(xy_px, camera.focal_px, camera.principal_point_px, camera.distortion)
    return points_on(known.seen_by(camera, xy_px), camera, rays)


def _elsewhere(residual_px: FloatArray, noise_px: float) -> BoolArray:
    """(h, w) pixels around which residuals agree with each other, and not with zero."""
    there: BoolArray = np.asarray(np.isfinite(residual_px).all(axis=-1))
    size = max(3, 2 * round(_WINDOW_SHARE * there.shape[1] / 2) + 1)
    count = _sums(there.astype(np.float64), size)
    known = np.where(there[..., None], residual_px, np.zeros_like(residual_px))
    limited: FloatArray = np.minimum(np.maximum(known, -_FAR_PX), _FAR_PX)
    total = np.stack([_sums(limited[..., k], size) for k in range(2)], axis=-1)
    mean = np.linalg.norm(total / np.maximum(count, 1)[..., None], axis=-1)
    limit = np.maximum(_ELSEWHERE_PX, _ELSEWHERE_SIGMAS * noise_px / np.sqrt(np.maximum(count, 1)))
    own = np.linalg.norm(limited, axis=-1) > _ELSEWHERE_PX
    return np.asarray(there & own & (mean > limit) & (count > _LEAST_IN_WINDOW * size**2))


def _sums(values: FloatArray, size: int) -> FloatArray:
    """(h, w) sums over the window around each pixel."""
    return np.asarray(cv2.boxFilter(np.ascontiguousarray(values), -1, (size, size), normalize=False), np.float64)


def _lost_share(known: KnownRig, now: Correspondence, motion: MotionFound, mapped: tuple[slice, slice]) -> float:
    """Share of well lit pixels that should have a projector pixel from where the devices stand now, and have none."""
    xy = _xy(now.valid.shape, mapped).reshape(-1, 2)
    expected = _landed_now(known, motion, xy)
    height, width = known.map.projector_shape
    margin = 0.02 * width
    with np.errstate(invalid="ignore"):
        inside = ((expected > margin) & (expected < np.array([width, height]) - 1 - margin)).all(axis=1)
    typical = float(np.median(known.white[known.map.valid]))
    was = (known.map.valid & (known.white > _LEAST_DIRECT * typical))[mapped].ravel() & inside
    return float((was & ~now.valid[mapped].ravel()).sum() / max(was.sum(), 1))


def _walls(known: KnownRig, label: NDArray[np.int64]) -> tuple[str, ...]:
    """Names of the walls with most of some pixels."""
    numbers, count = np.unique(label[label >= 0], return_counts=True)
    order = np.argsort(-count)
    named = [known.wall_name(int(numbers[k])) for k in order if count[k] >= _NAMED_SHARE * count.sum()]
    return tuple(dict.fromkeys(named))


def _light(
    known: KnownRig, motion: MotionFound, mapped: tuple[slice, slice], *, white: FloatArray, black: FloatArray
) -> LightChange:
    """The same places of the walls, as they were seen before and as they are seen now."""
    valid = known.map.valid[mapped].ravel()
    xy = _xy(white.shape, mapped).reshape(-1, 2)[valid]
    points, normal = _points(known, motion.camera_now, xy), known.seen_by(motion.camera_now, xy).normal
    there = project(known.camera, points)
    ratio = _irradiance(motion.projector_now, points, normal) / _irradiance(known.projector, points, normal)
    ripple = max(known.radiometric.black_ripple.values(), default=0.0)
    return light_change(
        xy,
        (sample(known.white, there), white[mapped].ravel()[valid]),
        (sample(known.black, there), black[mapped].ravel()[valid]),
        expected=(ratio, abs(float(np.nanmedian(ratio)) - 1)),
        ripple=ripple,
    )


def _irradiance(projector: PinholeModel, points_m: FloatArray, normal: FloatArray) -> FloatArray:
    """(N,) cos θ / (r² cos³ γ) of unit flux, γ from the optical axis."""
    way = points_m - projector.position_m
    r2 = (way**2).sum(axis=1)
    distance = np.sqrt(r2)
    cos_wall, cos_axis = np.abs((way * normal).sum(axis=1)) / distance, (way @ projector.rotation[2]) / distance
    return np.asarray(cos_wall / (r2 * np.maximum(cos_axis, 1e-3) ** 3))
