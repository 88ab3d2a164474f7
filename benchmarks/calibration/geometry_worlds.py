"""Correspondences of rooms and shapes by exact ray casting, read as whole codes with noise.

Rays are those of the simulated world's optics; nothing here knows the model that is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.subpixel import refine_subpixel
from rig.devices.simulated.optics import SimulatedOptics, directions, pixels_of
from rig.devices.simulated.pair import pixel_grid

FloatArray = NDArray[np.float64]
_BOW_STEPS = 40
"""Of the way to a wall that bows, each shorter by its slope over that of the ray: 0.01 over 0.02 and more."""
_LINES_ALIKE = 5
"""Of the projector, whose errors are smoothed: a stripe of four lines is the narrowest of most."""


@dataclass(frozen=True, eq=False)
class HalfSpace:
    """What lies inside of a flat wall: normal · x < offset."""

    normal: FloatArray
    offset_m: float

    def leave_m(self, origin: FloatArray, rays: FloatArray) -> FloatArray:
        """(N,) distance at which rays from the inside leave."""
        towards = rays @ self.normal
        with np.errstate(divide="ignore"):
            along = (self.offset_m - self.normal @ origin) / towards
        return np.where(towards > 0, along, np.inf)


@dataclass(frozen=True, eq=False)
class BowedWall:
    """What lies inside of a wall of a box that bulges, and is where it ought to be along its edges."""

    axis: int
    side: int
    """0 or 1."""
    size_m: FloatArray
    """(3,) of the box."""
    waves_m: FloatArray
    """(3,) of half a wave along both directions, a whole one along the first, a whole one along the second."""

    def leave_m(self, origin: FloatArray, rays: FloatArray) -> FloatArray:
        """(N,) distance at which rays from the inside leave."""
        outwards = 2 * self.side - 1
        flat = HalfSpace(outwards * np.eye(3)[self.axis], self.side * float(self.size_m[self.axis]))
        first_m = flat.leave_m(origin, rays)
        along_m = np.where(np.isfinite(first_m), first_m, 0.0)
        for _ in range(_BOW_STEPS):
            bow_m = self._bow_m(origin + along_m[:, None] * rays)
            along_m = np.where(np.isfinite(first_m), first_m + bow_m / (outwards * rays[:, self.axis]), 0.0)
        return np.where(np.isfinite(first_m), along_m, np.inf)

    def _bow_m(self, points_m: FloatArray) -> FloatArray:
        others = np.delete(np.arange(3), self.axis)
        u, v = (np.pi * points_m[:, others] / self.size_m[others]).T
        waves = (np.sin(u) * np.sin(v), np.sin(2 * u) * np.sin(v), np.sin(u) * np.sin(2 * v))
        return np.asarray(np.tensordot(self.waves_m, waves, 1))


@dataclass(frozen=True, eq=False)
class Round:
    """A sphere (dome, ball), or a cylinder along an axis, from the inside or from the outside."""

    centre_m: FloatArray
    radius_m: float
    along: FloatArray | None = None
    """Of a cylinder."""

    def _roots(self, origin: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
        start = np.broadcast_to(origin - self.centre_m, rays.shape)
        if self.along is not None:
            start = start - np.outer(start @ self.along, self.along)
            rays = rays - np.outer(rays @ self.along, self.along)
        a, b = (rays * rays).sum(1), (start * rays).sum(1)
        c = (start * start).sum(1) - self.radius_m**2
        with np.errstate(invalid="ignore", divide="ignore"):
            root = np.sqrt(b * b - a * c)
            return (-b - root) / a, (-b + root) / a

    def leave_m(self, origin: FloatArray, rays: FloatArray) -> FloatArray:
        """(N,) distance at which rays from the inside leave."""
        far = self._roots(origin, rays)[1]
        return np.where(np.isfinite(far) & (far > 0), far, np.inf)

    def enter_m(self, origin: FloatArray, rays: FloatArray) -> FloatArray:
        """(N,) distance at which rays from the outside enter; infinite where they pass."""
        near = self._roots(origin, rays)[0]
        return np.where(np.isfinite(near) & (near > 0), near, np.inf)


@dataclass(frozen=True, eq=False, kw_only=True)
class Shape:
    """The inside of some walls, with balls in it."""

    walls: tuple[HalfSpace | Round | BowedWall, ...]
    balls: tuple[Round, ...] = ()
    is_box: bool = True
    """Balls apart."""

    def hit_m(self, origin: FloatArray, rays: FloatArray) -> FloatArray:
        """(N,) distance of the first surface along rays."""
        return np.asarray(np.min(self._distances_m(origin, rays), axis=0))

    def first(self, origin: FloatArray, rays: FloatArray) -> NDArray[np.int64]:
        """(N,) which surface that is."""
        return np.argmin(self._distances_m(origin, rays), axis=0)

    def _distances_m(self, origin: FloatArray, rays: FloatArray) -> list[FloatArray]:
        distances = [wall.leave_m(origin, rays) for wall in self.walls]
        return distances + [ball.enter_m(origin, rays) for ball in self.balls]


def box(size_m: FloatArray) -> Shape:
    """A room with its lower corner at the origin."""
    walls = [HalfSpace(np.eye(3)[k], float(size_m[k])) for k in range(3)]
    return Shape(walls=(*walls, *(HalfSpace(-np.eye(3)[k], 0.0) for k in range(3))))


def points_of(shape: Shape, device: SimulatedOptics, xy_px: FloatArray) -> FloatArray:
    """(N, 3) first surface that a device's pixels (N, 2) meet. [m]."""
    rays = directions(device, xy_px)
    return np.asarray(device.position_m + shape.hit_m(device.position_m, rays)[:, None] * rays)


def exact_map(shape: Shape, camera: SimulatedOptics, projector: SimulatedOptics) -> FloatArray:
    """(H, W, 2) projector pixel that each camera pixel sees; NaN where none lights what it sees."""
    points = points_of(shape, camera, pixel_grid(camera.shape).reshape(-1, 2))
    xy = pixels_of(projector, points)
    height, width = projector.shape
    # Beyond twice the picture's angle the distortion may fold back into the picture.
    local = (points - projector.position_m) @ projector.rotation.T
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.hypot(local[:, 0], local[:, 1]) / local[:, 2]
        reach = np.add(np.abs(projector.lens.principal_point_px), (width, height))
        seen = (xy > -0.5).all(1) & (xy < (width - 0.5, height - 0.5)).all(1)
        seen &= (local[:, 2] > 0) & (slope < 1.3 * np.hypot(*reach) / projector.lens.focal_px)
    away = points - projector.position_m
    distance = np.linalg.norm(away, axis=1)
    first = shape.hit_m(projector.position_m, away / distance[:, None])
    seen &= np.abs(first - distance) < 1e-6
    xy[~seen] = np.nan
    return np.asarray(xy.reshape(*camera.shape, 2))


@dataclass(frozen=True, kw_only=True)
class CodeNoise:
    """How codes are misread."""

    code_px: float = 0.1
    """Standard deviation of where a code seems to end. [px of the projector]"""
    lost_share: float = 0.002
    stray_share: float = 0.0005
    """Pixels with a code far from the right one."""
    line_px: float = 0.0
    """Standard deviation of an error that a projector's line has all along a surface; neighbouring lines share it."""


def measured(
    exact_xy: FloatArray,
    projector_shape: tuple[int, int],
    noise: CodeNoise,
    seed: int,
    surface: NDArray[np.int64] | None = None,
) -> Correspondence:
    """Whole codes with noise, refined as a session refines them; `surface` (H, W) is which one a pixel sees."""
    random = np.random.default_rng(seed)
    height, width = projector_shape
    off = random.normal(0, noise.code_px, exact_xy.shape)
    if surface is not None and noise.line_px:
        off += _line_errors(exact_xy, surface, noise.line_px, np.random.default_rng([seed, 1]))
    codes = np.rint(exact_xy + off)
    stray = random.random(exact_xy.shape[:2]) < noise.stray_share
    codes[stray] += np.rint(random.uniform(-30, 30, (int(stray.sum()), 2)))
    with np.errstate(invalid="ignore"):
        valid = ((codes >= 0) & (codes < (width, height))).all(axis=2)
    valid &= random.random(valid.shape) >= noise.lost_share
    codes[~valid] = np.nan
    reason = np.where(valid, PixelReason.VALID, PixelReason.DARK).astype(np.uint8)
    return refine_subpixel(Correspondence(codes.astype(np.float32), reason, projector_shape))


def _line_errors(
    exact_xy: FloatArray, surface: NDArray[np.int64], line_px: float, random: np.random.Generator
) -> FloatArray:
    """(H, W, 2) errors that lines of columns and rows have on each surface, smooth over some lines."""
    found = np.zeros_like(exact_xy)
    smooth = np.hanning(_LINES_ALIKE + 2)[1:-1]
    smooth /= np.linalg.norm(smooth)
    last = int(np.nanmax(exact_xy)) + 2
    for one in np.unique(surface):
        for axis in (0, 1):
            errors = line_px * np.convolve(random.normal(size=last + _LINES_ALIKE), smooth, "valid")
            own = (surface == one) & np.isfinite(exact_xy[..., axis])
            found[own, axis] = errors[np.clip(np.rint(exact_xy[own, axis]), 0, last).astype(np.int64)]
    return found
