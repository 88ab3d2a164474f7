"""Find which of two calibrated devices was turned or moved: the least motion that explains what pixels see now."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.moved.records import ComparedPixels, DeviceMotion, MotionFound, Moved, SeenWalls, WallsSeen
from calibration.geometry.moved.residual import SHIFT_M, TURN_RAD, UNKNOWNS, ZOOM, MotionError, Who, moved_device
from calibration.geometry.noise import common_covariance, covariance, observation_variance, standard_deviations
from calibration.geometry.pinhole import PinholeModel, project, vector_of
from calibration.geometry.robust_fit import Fit, Priors, robust_fit

LEAST_PIXELS = 300
"""Compared pixels: with fewer, what is left over cannot be told from noise wall by wall."""
_LARGEST_TURN_RAD, _LARGEST_SHIFT_M = 0.2, 0.5
"""Standard deviations of what is expected: a bump, not another place. Along what the photographs do not tell (the room
and both devices larger together, where only three walls are seen) they keep the answer finite."""
_LARGEST_ZOOM = 0.1
ONE_AT_A_TIME: tuple[Who, ...] = ("camera", "projector", "together", "camera zoomed", "projector zoomed")
_ZOOMS: tuple[Who, ...] = ("camera zoomed", "projector zoomed")
_PRIOR_VARIANCE_PX2 = 0.02
"""Of an independent observation, for what the priors weigh: as in the calibration itself."""
_LEAST_SCALE_PX = 0.3
"""Of the robust fit: twice the noise of a sub-pixel correspondence, as in the calibration itself."""
_ROUNDS, _ITERATIONS = 3, 30
"""Which wall a pixel sees is looked up again after each round: near edges it is another one after a turn."""
_COMMON_PX = 0.01 * 2**0.5
"""By which all of a wall's coordinates are off together: twice what it is in one map, in squares."""
_STRUCTURE_PX, _STRUCTURE_SHARE = 0.03, 0.01
"""Root mean square that one device's motion may leave over more than both devices' do: absolutely, and as a share of
the displacement. Lenses, walls and windows of the refinement that are slightly wrong leave about as much, on twenty
random moves of two simulated rooms."""
_NOISE_CHI2 = 40.0
"""Of twelve unknowns: noise alone exceeds it once in ten thousand."""
_CLEARLY = 3.0
"""Ratio of what two motions leave over, from which on one is the better."""
_FARTHEST_DEG, _FARTHEST_M = 10.0, 0.3
"""Of a bump. Beyond, another room of much the same shape explains the photographs as well as a move does."""
_MOST_LEFT_PX, _MOST_LEFT_SHARE = 0.5, 0.02
"""Median residual beyond which no motion explains the photographs: absolutely, and as a share of the displacement."""


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A motion of some devices, fitted."""

    error: MotionError
    fit: Fit
    variance_px2: float

    @property
    def devices(self) -> tuple[PinholeModel, PinholeModel]:
        return self.error.devices(self.fit.z)

    def left_over(self, scale_px: float) -> float:
        """Robust sum of squares. [px²]."""
        return _robust_sum(self.fit.residual, scale_px)

    def covariance(self) -> FloatArray:
        """(n, n) of the motion."""
        own = covariance(self.fit, self.variance_px2)
        return own + common_covariance(self.fit, self.error.walls_now.label, 1.0, _COMMON_PX)


Fits = dict[Who, _Fitted]


def find_motion(
    camera: PinholeModel, projector: PinholeModel, pixels: ComparedPixels, walls_seen: WallsSeen
) -> MotionFound:
    """Find which device moved since a calibration, by how much, and how sure that is.

    Parameters
    ----------
    camera, projector : PinholeModel
        As they were calibrated, in the room. [px, m]
    pixels : ComparedPixels
        Camera pixels that have a projector pixel in both maps.
    walls_seen : callable
        What pixels of a camera that stands elsewhere see.

    Returns
    -------
    MotionFound
        The least that explains the photographs: nothing, one device, or both.

    Raises
    ------
    CalibrationError
        Fewer than 300 pixels to compare, or no motion of the two devices explains what they see.

    Notes
    -----
    A pixel's ray meets a wall that stands where it stood; seen from there, the projector's pixel follows from its
    pose: two equations a pixel, six unknowns a device, robustly (Cauchy's loss, B. Triggs et al., Bundle adjustment -
    a modern synthesis, 1999).
    """
    before = walls_seen(camera, pixels.camera_xy_px)
    seen = before.label >= 0
    _check_count(int(seen.sum()))
    chosen = _of(pixels, seen)
    fitting = _Fitting(
        camera=camera, projector=projector, pixels=chosen, walls_seen=walls_seen, before=_walls_of(before, seen)
    )
    fitted = fitting.fits()
    both = fitted["both"]
    displacement_px = float(np.median(np.linalg.norm(chosen.now_px - chosen.before_px, axis=1)))
    _refuse_unexplained(both, displacement_px)
    found = _found(_least_motion(fitted, chosen, displacement_px), fitted, seen, displacement_px)
    _refuse_far(found)
    return found


@dataclass(frozen=True, eq=False, kw_only=True)
class _Fitting:
    """All that the fits of different devices share."""

    camera: PinholeModel
    projector: PinholeModel
    pixels: ComparedPixels
    walls_seen: WallsSeen
    before: SeenWalls

    def fits(self) -> Fits:
        """Everything that may have changed, fitted."""
        alone = {who: self._fit(who) for who in ONE_AT_A_TIME}
        better = min((alone["camera"], alone["projector"], alone["together"]), key=lambda one: one.fit.cost)
        start = np.concatenate([_motion_between(*pair) for pair in zip(self._before, better.devices, strict=True)])
        return {**alone, "both": self._fit("both", start=start)}

    @property
    def _before(self) -> tuple[PinholeModel, PinholeModel]:
        return self.camera, self.projector

    def _fit(self, who: Who, *, start: FloatArray | None = None) -> _Fitted:
        error = MotionError(
            camera=self.camera,
            projector=self.projector,
            pixels=self.pixels,
            walls_before=self.before,
            walls_now=self.before,
            who=who,
        )
        z = np.zeros(error.unknowns) if start is None else start
        for _ in range(1 if who.startswith("projector") else _ROUNDS):
            error = replace(error, walls_now=self._walls_now(error.devices(z)[0]))
            fit = robust_fit(error, z, _priors(error), iterations=_ITERATIONS, least_scale_px=_LEAST_SCALE_PX)
            z = fit.z
        pixels = self.pixels
        variance = observation_variance(fit, pixels.camera_xy_px, error.walls_now.label, pixels.now_px)
        return _Fitted(error, fit, variance)

    def _walls_now(self, camera: PinholeModel) -> SeenWalls:
        """What the pixels see from there; past the room's edge, what they saw before."""
        now, seen = self.walls_seen(camera, self.pixels.camera_xy_px), self.before
        there = now.label >= 0
        return SeenWalls(
            np.where(there[:, None], now.normal, seen.normal),
            np.where(there, now.offset_m, seen.offset_m),
            np.where(there, now.label, seen.label),
        )


def _motion_between(before: PinholeModel, now: PinholeModel) -> FloatArray:
    """(6,) unknowns that move a device from one place to another."""
    turn = vector_of(now.rotation @ before.rotation.T) / TURN_RAD
    return np.concatenate([turn, (now.position_m - before.position_m) / SHIFT_M])


def _priors(error: MotionError) -> Priors:
    one = np.repeat([_LARGEST_TURN_RAD / TURN_RAD, _LARGEST_SHIFT_M / SHIFT_M], UNKNOWNS // 2)
    sigma = np.tile(one, error.unknowns // UNKNOWNS) if error.unknowns > 1 else np.array([_LARGEST_ZOOM / ZOOM])
    return Priors.independent(np.zeros(error.unknowns), sigma, _PRIOR_VARIANCE_PX2)


def _robust_sum(residual: FloatArray, scale_px: float) -> float:
    return float(scale_px**2 * np.log1p((residual**2).sum(axis=1) / scale_px**2).sum())


def _least_motion(fitted: Fits, pixels: ComparedPixels, displacement_px: float) -> Moved:
    """The fewest unknowns that leave over no more than noise, and what small errors of the model leave.

    Raises CalibrationError when that is a lens.
    """
    both = fitted["both"]
    scale_px = max(_LEAST_SCALE_PX, 2 * float(np.median(np.linalg.norm(both.fit.residual, axis=1))))
    sums = {who: one.left_over(scale_px) for who, one in fitted.items()}
    least, count = min(sums.values()), len(pixels)
    left = {who: (total - least) / count for who, total in sums.items()}
    noise = _NOISE_CHI2 * min(one.variance_px2 for one in fitted.values()) / count
    still = (_robust_sum(pixels.now_px - pixels.before_px, scale_px) - least) / count
    if still <= noise + _STRUCTURE_PX**2:
        return "nothing"
    limit = noise + _STRUCTURE_PX**2 + (_STRUCTURE_SHARE * displacement_px) ** 2
    _refuse_zoom(fitted, left, limit)
    return _simplest(left, limit, noise)


def _simplest(left: Mapping[Who, float], limit: float, noise: float) -> Moved:
    """Which motion leaves over least, [px²]; one device before the pair as one, that before both."""
    camera, projector = left["camera"], left["projector"]
    if min(camera, projector) > limit or left["together"] < min(camera, projector) / _CLEARLY**2 - noise:
        return "together" if left["together"] <= limit else "both"
    if max(camera, projector) <= max(_CLEARLY**2 * min(camera, projector), noise + _STRUCTURE_PX**2 / 4):
        return "either"
    return "camera" if camera < projector else "projector"


def _refuse_zoom(fitted: Fits, left: Mapping[Who, float], limit: float) -> None:
    """Raise CalibrationError when one number, a lens's focal length, explains what no device alone does."""
    for who in _ZOOMS:
        others = min(left[other] for other in ("camera", "projector", "together"))
        if left[who] <= limit and left[who] < others / _CLEARLY:
            share = 100 * ZOOM * float(fitted[who].fit.z[0])
            raise CalibrationError(
                f"the {who.split()[0]}'s lens was zoomed or focused: its focal length changed by {share:+.2f} %, "
                "and no move explains that; put the lens back, or calibrate a new session"
            )


def _found(moved: Moved, fitted: Fits, seen: BoolArray, displacement_px: float) -> MotionFound:
    both = fitted["both"]
    of_camera = both if moved in ("projector", "both", "together") else fitted["camera"]
    of_projector = both if moved in ("camera", "both", "together") else fitted["projector"]
    explaining: dict[Moved, Who] = {"camera": "camera", "either": "camera", "projector": "projector"}
    chosen = fitted["together" if moved == "together" else explaining.get(moved, "both")]
    camera_now, projector_now = both.error.camera, both.error.projector
    residual = chosen.fit.residual
    if moved == "nothing":
        residual = both.error.pixels.before_px - both.error.pixels.now_px
    else:
        camera_now, projector_now = chosen.devices
    label = np.full(len(seen), -1, dtype=np.intp)
    label[seen] = chosen.error.walls_now.label
    whole = np.full((len(seen), 2), np.nan)
    whole[seen] = residual
    return MotionFound(
        moved=moved,
        camera=_motion_of(of_camera, slice(0, UNKNOWNS), _camera_image),
        projector=_motion_of(of_projector, slice(-UNKNOWNS, None), _projector_image),
        camera_now=camera_now,
        projector_now=projector_now,
        displacement_px=displacement_px,
        residual_px=whole,
        noise_px=1.4826 * float(np.median(np.abs(residual))),
        label=label,
    )


ImageShift = Callable[[MotionError, FloatArray], FloatArray]
"""Motion (6,) of a device → (N, 2) by which walls move in its picture. [px]"""


def _camera_image(error: MotionError, z: FloatArray) -> FloatArray:
    return np.asarray(project(moved_device(error.camera, z), error.points_before_m) - error.pixels.camera_xy_px)


def _projector_image(error: MotionError, z: FloatArray) -> FloatArray:
    there = project(moved_device(error.projector, z), error.points_before_m)
    return np.asarray(there - project(error.projector, error.points_before_m))


def _motion_of(fitted: _Fitted, own: slice, image: ImageShift) -> DeviceMotion:
    """One device's part of a fitted motion, with its standard deviations."""
    z, spread = fitted.fit.z[own], fitted.covariance()[own, own]
    unit = np.repeat([np.degrees(TURN_RAD), SHIFT_M], UNKNOWNS // 2)
    value, sigma = z * unit, np.sqrt(np.diag(spread)) * unit

    def lengths(motion: FloatArray) -> FloatArray:
        shift = np.median(np.linalg.norm(image(fitted.error, motion), axis=1))
        turned, shifted = (np.linalg.norm(part) for part in (motion[:3] * unit[:3], motion[3:] * unit[3:]))
        return np.array([turned, shifted, shift])

    (turned, shifted, image_px), of_lengths = lengths(z), standard_deviations(lengths, z, spread)
    return DeviceMotion(
        turn_deg=value[:3],
        turn_sigma_deg=sigma[:3],
        shift_m=value[3:],
        shift_sigma_m=sigma[3:],
        turned_deg=float(turned),
        turned_sigma_deg=float(of_lengths[0]),
        shifted_m=float(shifted),
        shifted_sigma_m=float(of_lengths[1]),
        image_px=float(image_px),
        image_sigma_px=float(of_lengths[2]),
    )


def _check_count(found: int) -> None:
    if found < LEAST_PIXELS:
        raise CalibrationError(
            f"only {found} camera pixels see a measured wall both now and when the session was calibrated, the limit "
            f"is {LEAST_PIXELS}: the devices stand elsewhere, or something covers the picture; look (`rig look`), or "
            "calibrate a new session"
        )


def _refuse_unexplained(both: _Fitted, displacement_px: float) -> None:
    left_px = float(np.median(np.linalg.norm(both.fit.residual, axis=1)))
    limit_px = max(_MOST_LEFT_PX, _MOST_LEFT_SHARE * displacement_px)
    if left_px > limit_px:
        raise CalibrationError(
            f"no move of camera and projector explains what the camera sees: {left_px:.2g} of {displacement_px:.2g} "
            f"projector pixels are left at the median, the limit is {limit_px:.2g}: too much was moved (walls, "
            "furniture, a lens zoomed or focused), or it is another rig's session; calibrate a new session"
        )


def _refuse_far(found: MotionFound) -> None:
    """Raise CalibrationError for what is no bump."""
    for name, motion, has_moved in (
        ("camera", found.camera, found.moved in ("camera", "both", "together", "either")),
        ("projector", found.projector, found.moved in ("projector", "both", "together", "either")),
    ):
        if has_moved and (motion.turned_deg > _FARTHEST_DEG or motion.shifted_m > _FARTHEST_M):
            raise CalibrationError(
                f"the {name} would have been turned by {motion.turned_deg:.2g}° and shifted by {motion.shifted_m:.2g} "
                f"m, the limits are {_FARTHEST_DEG:g}° and {_FARTHEST_M:g} m: too much was moved, or it is another "
                "rig's session; calibrate a new session"
            )


def _of(pixels: ComparedPixels, chosen: BoolArray) -> ComparedPixels:
    return ComparedPixels(
        camera_xy_px=pixels.camera_xy_px[chosen], before_px=pixels.before_px[chosen], now_px=pixels.now_px[chosen]
    )


def _walls_of(walls: SeenWalls, chosen: BoolArray) -> SeenWalls:
    return SeenWalls(walls.normal[chosen], walls.offset_m[chosen], walls.label[chosen])
