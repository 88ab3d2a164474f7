"""Lenses of the simulated world: where a pixel looks, and how bright the projector's light is where it lands."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from rig.devices.simulated.settings import SimulatedLensSettings
from rig.errors import ProfileError

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]

_UNDONE = 1e-6
"""Of the focal length, to which distortion is undone at least."""
_WIDEST, _STEPS_TO_FOLD = 10.0, 20_001
"""84 degrees from the axis; in steps of which the first is 4 degrees, and one at 45 degrees 0.07."""
_BLUR_STEPS = 5
"""Blurs between that of the axis and that of the corners; between two of them light is mixed."""


@dataclass(frozen=True, slots=True)
class SimulatedOptics:
    """One device's pinhole with distortion and vignetting."""

    lens: SimulatedLensSettings
    shape: tuple[int, int]
    rotation: FloatArray
    """(3, 3) device_from_world."""

    @property
    def position_m(self) -> FloatArray:
        """(3,) centre of projection."""
        return np.asarray(np.add(self.lens.position_m, self.lens.moved_m), dtype=np.float64)

    def depth_m(self, points_m: FloatArray) -> FloatArray:
        """(...) distance of points (..., 3) along the optical axis."""
        return np.asarray((points_m - self.position_m) @ self.rotation[2])


def make_optics(lens: SimulatedLensSettings, shape: tuple[int, int]) -> SimulatedOptics:
    """Aim a lens: camera z forward, x right, y down, room z up; roll turns the picture clockwise."""
    forward = np.array(lens.look_at_m) - np.array(lens.position_m)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    c, s = np.cos(np.radians(lens.roll_deg)), np.sin(np.radians(lens.roll_deg))
    rotation = np.stack([c * right + s * down, c * down - s * right, forward])
    if any(lens.turned_deg):
        rotation = cv2.Rodrigues(np.radians(lens.turned_deg))[0] @ rotation
    return SimulatedOptics(lens, shape, rotation)


def distort(lens: SimulatedLensSettings, xy: FloatArray) -> FloatArray:
    """Ideal to real image coordinates, focal length 1 (Brown's model in OpenCV's order)."""
    k1, k2, p1, p2, k3 = lens.distortion
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    real = np.empty_like(xy)
    real[..., 0] = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    real[..., 1] = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return real


def undistort(lens: SimulatedLensSettings, xy: FloatArray) -> FloatArray:
    """Inverse of :func:`distort` by fixed-point iteration (converges for the mild lenses of a simulated world).

    Raises ProfileError where it does not: there the distortion folds.
    """
    ideal, largest = xy.copy(), np.inf
    for _ in range(50):
        correction = xy - distort(lens, ideal)
        ideal = np.clip(ideal + correction, -_WIDEST, _WIDEST)
        largest = float(np.abs(correction).max(initial=0.0))
        if largest < 1e-11:
            break
    if largest > _UNDONE:
        raise ProfileError(
            f"simulation: the distortion {lens.distortion} of {lens.name!r} cannot be undone within its picture: "
            f"{largest * lens.focal_px:.3g} px are left, the limit is {_UNDONE * lens.focal_px:.3g} px; it folds the "
            "picture over at an edge: give smaller terms, a longer focal_px or a smaller picture"
        )
    return ideal


def directions(optics: SimulatedOptics, xy_px: FloatArray) -> FloatArray:
    """(..., 3) unit world directions of pixel coordinates (..., 2)."""
    lens = optics.lens
    xy = undistort(lens, (xy_px - np.array(lens.principal_point_px)) / lens.focal_px)
    rays = np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return np.asarray(rays @ optics.rotation)


def pixels_of(optics: SimulatedOptics, points_m: FloatArray) -> FloatArray:
    """(..., 2) pixel coordinates of world points; NaN behind the lens, and where its distortion folds back."""
    local = (points_m - optics.position_m) @ optics.rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = np.where(local[..., 2:] > 1e-6, local[..., :2] / local[..., 2:], np.nan)
    xy[(xy**2).sum(axis=-1) >= _fold_r2(optics.lens)] = np.nan
    return np.asarray(distort(optics.lens, xy) * optics.lens.focal_px + optics.lens.principal_point_px)


def _fold_r2(lens: SimulatedLensSettings) -> float:
    """Squared distance from the axis at which the distorted radius stops rising: beyond, a lens images nothing."""
    k1, k2, _, _, k3 = lens.distortion
    r2 = np.linspace(0.0, _WIDEST**2, _STEPS_TO_FOLD)
    falls = 1 + r2 * (3 * k1 + r2 * (5 * k2 + r2 * 7 * k3)) <= 0
    return float(r2[falls.argmax()]) if falls.any() else np.inf


def relative_illumination(optics: SimulatedOptics, xy_px: FloatArray) -> FloatArray:
    """Vignetting 1 + v2 r² + v4 r⁴ with r = distance from the axis / half diagonal."""
    v2, v4 = optics.lens.vignetting
    half_diagonal = np.hypot(*optics.shape) / 2
    r2 = ((xy_px - np.array(optics.lens.principal_point_px)) ** 2).sum(axis=-1) / half_diagonal**2
    return np.asarray(1 + r2 * (v2 + r2 * v4))


def blurred(optics: SimulatedOptics, light: Float32Array, margin_px: int = 0) -> Float32Array:
    """(H, W) light of a picture, with a margin around it, after the lens's blur, which may change to the corners."""
    centre, corner = optics.lens.blur_px, optics.lens.corner_blur_px
    if corner is None or corner == centre:
        return _gaussian(light, centre)
    mixed = np.zeros_like(light)
    for sigma_px, weight in _blur_steps(optics, centre, corner, margin_px):
        mixed += weight.astype(np.float32) * _gaussian(light, sigma_px)
    return mixed


def haloed(optics: SimulatedOptics, light: Float32Array) -> Float32Array:
    """(H, W) light of a picture with the lens's halo: a share of it lands far away, or outside and is lost."""
    share = optics.lens.halo
    if not share:
        return light
    size = [fft.next_fast_len(2 * n, real=True) for n in light.shape]
    around = fft.irfft2(fft.rfft2(light, size) * _halo_spectrum(optics.lens.halo_px, tuple(size)), size)
    height, width = light.shape
    return np.asarray((1 - share) * light + share * around[:height, :width], dtype=np.float32)


@lru_cache(maxsize=4)
def _halo_spectrum(radius_px: float, size: tuple[int, int]) -> NDArray[np.complexfloating]:
    """Of 1 / (1 + (r / a)^2)^1.5 over distances r on a torus; a disc of radius a sqrt 3 holds half of it.

    Between the point spreads that are published for eyes and lenses, which fall with the second to third power.
    """
    y, x = (np.minimum(np.arange(n), n - np.arange(n)) for n in size)
    kernel = (1 + 3 * (y[:, None] ** 2 + x**2) / radius_px**2) ** -1.5
    return np.asarray(fft.rfft2((kernel * 3 / (2 * np.pi * radius_px**2)).astype(np.float32)))


def blur_variance_px2(optics: SimulatedOptics) -> FloatArray:
    """(H, W) variance of the lens's blur at its pixels."""
    centre, corner = optics.lens.blur_px, optics.lens.corner_blur_px
    steps = _blur_steps(optics, centre, centre if corner is None else corner)
    return np.asarray(sum(sigma_px**2 * weight for sigma_px, weight in steps))


def _blur_steps(
    optics: SimulatedOptics, centre: float, corner: float, margin_px: int = 0
) -> list[tuple[float, FloatArray]]:
    """Blurs that are mixed, and how much there is of each at every pixel, (H, W), and in a margin around them."""
    half_diagonal = np.hypot(*optics.shape) / 2
    y, x = (
        np.arange(n + 2 * margin_px) - margin_px - c
        for n, c in zip(optics.shape, reversed(optics.lens.principal_point_px), strict=True)
    )
    step = np.clip((y[:, None] ** 2 + x**2) / half_diagonal**2, 0, 1) * (_BLUR_STEPS - 1)
    return [
        (centre + (corner - centre) * k / (_BLUR_STEPS - 1), np.asarray(np.maximum(1 - np.abs(step - k), 0)))
        for k in range(_BLUR_STEPS)
    ]


def _gaussian(light: Float32Array, sigma_px: float) -> Float32Array:
    return np.asarray(cv2.GaussianBlur(light, (0, 0), sigma_px), dtype=np.float32) if sigma_px > 0 else light


def flux_density(optics: SimulatedOptics, points_m: FloatArray, cos_incidence: FloatArray) -> FloatArray:
    """Pixels per square metre of surface at points that the projector reaches.

    A pixel of an ideal lens covers the solid angle cos³γ / f²; distortion stretches the pixel grid by the
    determinant of its Jacobian, taken by finite differences.
    """
    local = (points_m - optics.position_m) @ optics.rotation.T
    r2 = (local**2).sum(axis=-1)
    cos_axis = local[..., 2] / np.sqrt(r2)
    xy = local[..., :2] / local[..., 2:]
    step = 1e-4
    dx, dy = (
        (distort(optics.lens, xy + d) - distort(optics.lens, xy - d)) / (2 * step)
        for d in (np.array([step, 0.0]), np.array([0.0, step]))
    )
    stretch = dx[..., 0] * dy[..., 1] - dx[..., 1] * dy[..., 0]
    return np.asarray(stretch * optics.lens.focal_px**2 * cos_incidence / (r2 * cos_axis**3))
