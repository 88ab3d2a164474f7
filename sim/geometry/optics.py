"""Pinhole with distortion (OpenCV's convention), for cameras and for projectors as inverse cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sim.arguments import number_of, numbers_of, vector_of
from sim.arrays import FloatArray
from sim.errors import SimulationError

Distortion = tuple[float, float, float, float, float]
UNDISTORT_STEPS = 50
"""Steps of the fixed point: lenses whose distortion can be undone take fewer."""

_POINTS_AT_ONCE = 2**13

MOST_PX = 2**20
"""Width or height of an image that no device has."""


@dataclass(frozen=True, kw_only=True)
class Lens:
    """Image size and projection of a pinhole with radial and tangential distortion.

    Raises
    ------
    SimulationError
        For a size or focal length that is no number above 0, a size beyond any device's, or other than five terms of
        distortion.
    """

    width_px: int
    height_px: int
    focal_px: tuple[float, float]
    """(fx, fy)."""
    principal_point_px: tuple[float, float]
    """(cx, cy); pixel centres at integers; may lie outside the image (lens shift)."""
    distortion: Distortion = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3 (OpenCV's order). [1]"""

    def __post_init__(self) -> None:
        sizes = numbers_of("size of the lens's image", (self.width_px, self.height_px), 2)
        numbers_of("principal point", self.principal_point_px, 2)
        numbers_of("distortion k1, k2, p1, p2, k3", self.distortion, 5)
        if not all(1 <= size <= MOST_PX for size in sizes) or min(numbers_of("focal lengths", self.focal_px, 2)) <= 0:
            raise SimulationError(
                f"lens of {self.width_px} x {self.height_px} px, focal lengths {self.focal_px} px; all must be above "
                f"0, and the size at most {MOST_PX}"
            )

    @classmethod
    def from_horizontal_field_of_view(cls, width_px: int, height_px: int, hfov_deg: float) -> Lens:
        """Return a lens with square pixels, centred, without distortion.

        Parameters
        ----------
        width_px, height_px : int
            Size of the image. [px]
        hfov_deg : float
            Horizontal field of view, from pixel edge to pixel edge. [degrees]

        Returns
        -------
        Lens

        Raises
        ------
        SimulationError
            For a field of view outside 0 ... 180 degrees, both excluded.
        """
        if not 0 < number_of("horizontal field of view", hfov_deg) < 180:
            raise SimulationError(f"horizontal field of view {hfov_deg:g} degrees; it must lie between 0 and 180")
        focal_px = float(number_of("width", width_px) / 2 / np.tan(np.radians(hfov_deg) / 2))
        return cls(
            width_px=width_px,
            height_px=height_px,
            focal_px=(focal_px, focal_px),
            principal_point_px=((width_px - 1) / 2, (number_of("height", height_px) - 1) / 2),
        )

    @property
    def n_pixels(self) -> int:
        """Number of pixels."""
        return self.width_px * self.height_px

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width) [px]."""
        return self.height_px, self.width_px

    def pixel_grid(self) -> FloatArray:
        """Return the pixel centres, row by row.

        Returns
        -------
        (H * W, 2) array
            (x, y) of each; the first is (0, 0). [px]
        """
        y, x = np.mgrid[: self.height_px, : self.width_px]
        return np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a device stands: x_device = rotation x_world + translation; x right, y down, z forward.

    Raises
    ------
    SimulationError
        For a rotation that is none.
    """

    rotation: FloatArray
    """(3, 3) device_from_world."""
    translation_m: FloatArray
    """(3,) device_from_world [m]."""

    def __post_init__(self) -> None:
        rotation = np.asarray(self.rotation, dtype=np.float64).reshape(3, 3)
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0:
            raise SimulationError(
                "pose: the rotation is not one; give orthonormal, right-handed rows, or use Pose.look_at"
            )
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation_m", np.asarray(self.translation_m, dtype=np.float64).reshape(3))

    @property
    def position_m(self) -> FloatArray:
        """(3,) centre of projection in the world [m]."""
        return np.asarray(-self.rotation.T @ self.translation_m)

    @classmethod
    def look_at(
        cls,
        position_m: ArrayLike,
        target_m: ArrayLike,
        up: ArrayLike = (0.0, 0.0, 1.0),
        roll_deg: float = 0.0,
    ) -> Pose:
        """Return the pose at a position, aimed at a target, image rows level against ``up``, then rolled.

        Parameters
        ----------
        position_m, target_m : (3,) array
            Centre of projection, and a point on the optical axis. [m]
        up : (3,) array
            A direction that shows upwards in the image.
        roll_deg : float
            Turn about the optical axis, from the image's x to its y. [degrees]

        Returns
        -------
        Pose

        Raises
        ------
        SimulationError
            For a target at the position, or straight along ``up``.
        """
        position = vector_of("position", position_m)
        forward = vector_of("target", target_m) - position
        right = np.cross(forward, vector_of("up", up))
        if np.linalg.norm(right) <= 1e-9 * np.linalg.norm(forward) or not np.any(forward):
            raise SimulationError("look_at: the target is at the position, or straight along 'up'; change one")
        forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
        level = np.stack([right, np.cross(forward, right), forward])
        cosine, sine = np.cos(np.radians(number_of("roll", roll_deg))), np.sin(np.radians(roll_deg))
        rotation = np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]]) @ level
        return cls(rotation, -rotation @ position)


def pixel_rays(lens: Lens, pose: Pose) -> FloatArray:
    """Return (H, W, 3) unit world directions of all pixel centres."""
    return rays_at(lens, pose, lens.pixel_grid()).reshape(*lens.shape, 3)


def rays_at(lens: Lens, pose: Pose, xy_px: ArrayLike) -> FloatArray:
    """Return (N, 3) unit world directions of image points (N, 2) [px]."""
    plane = undistorted(lens, np.asarray(xy_px, dtype=np.float64))
    rays = np.column_stack([plane, np.ones(len(plane))])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return np.asarray(rays @ pose.rotation)


def project(lens: Lens, pose: Pose, points_m: ArrayLike) -> FloatArray:
    """Return (N, 2) image points [px] of world points (N, 3) [m]; NaN for what the device images nowhere.

    That is what lies behind it, and what is so far from its axis that the polynomial of its distortion folds back: it
    would come to lie in the midst of the picture.
    """
    local = np.asarray(points_m, dtype=np.float64) @ pose.rotation.T + pose.translation_m
    depth = np.where(local[:, 2] > 0, local[:, 2], np.nan)
    plane = local[:, :2] / depth[:, None]
    plane[(plane**2).sum(axis=1) >= fold_squared(lens.distortion)] = np.nan
    return np.asarray(distort(plane, lens.distortion) * lens.focal_px + lens.principal_point_px)


def fold_squared(distortion: Distortion) -> float:
    """Return the squared distance from the axis, on the plane z = 1, at which radial distortion folds back.

    There r (1 + k1 r² + k2 r⁴ + k3 r⁶) is largest; infinity where it rises for ever.
    """
    k1, k2, _, _, k3 = distortion
    # by 1 / r², whose polynomial begins with 1: terms that are nearly 0 do it no harm
    inverse = [root.real for root in np.roots([1.0, 3 * k1, 5 * k2, 7 * k3]) if root.imag == 0 and root.real > 0]
    return 1 / max(inverse) if inverse else float(np.inf)


def solid_angles(lens: Lens, xy_px: ArrayLike) -> FloatArray:
    """Return (N,) the solid angle of a pixel centred at each image point (N, 2) [sr].

    cos³ gamma / (fx fy) over the distortion's Jacobian, gamma from the optical axis.
    """
    plane = undistorted(lens, np.asarray(xy_px, dtype=np.float64))
    cos_cubed = (1 + (plane**2).sum(axis=1)) ** -1.5
    return np.asarray(cos_cubed / (lens.focal_px[0] * lens.focal_px[1] * _jacobian(plane, lens.distortion)))


def distort(plane: FloatArray, distortion: Distortion) -> FloatArray:
    """Return points (N, 2) of the plane z = 1 after the lens's distortion."""
    k1, k2, p1, p2, k3 = distortion
    x, y = plane[:, 0], plane[:, 1]
    squared = x * x + y * y
    radial = 1 + squared * (k1 + squared * (k2 + squared * k3))
    bent_x = x * radial + 2 * p1 * x * y + p2 * (squared + 2 * x * x)
    bent_y = y * radial + p1 * (squared + 2 * y * y) + 2 * p2 * x * y
    return np.stack([bent_x, bent_y], axis=1)


def undistorted(lens: Lens, xy_px: FloatArray) -> FloatArray:
    """Return (N, 2) points of the plane z = 1 that the lens images at (N, 2) image points, by fixed-point iteration.

    Raises
    ------
    SimulationError
        If the distortion cannot be undone at some point (it folds the image over there).
    """
    bent = (xy_px - lens.principal_point_px) / lens.focal_px
    if not any(lens.distortion):
        return np.asarray(bent)
    plane = np.empty_like(bent)
    for first in range(0, len(bent), _POINTS_AT_ONCE):
        part = slice(first, first + _POINTS_AT_ONCE)
        plane[part] = _undistorted(lens, bent[part])
    return plane


def _undistorted(lens: Lens, bent: FloatArray) -> FloatArray:
    """Points of the plane z = 1 whose distorted places are ``bent``; so few that they stay in the processor's cache."""
    plane = bent.copy()
    for _ in range(UNDISTORT_STEPS):
        error = distort(plane, lens.distortion) - bent
        if np.abs(error).max() < 1e-13:
            return plane
        plane = np.clip(plane - error, -10, 10)
    worst_px = float(np.abs(error).max()) * max(lens.focal_px)
    if worst_px > 1e-3:
        raise SimulationError(
            f"distortion {lens.distortion} cannot be undone: {worst_px:.3g} px left after "
            f"{UNDISTORT_STEPS} steps, limit 0.001 px; the coefficients fold the image over at its border"
        )
    return plane


def _jacobian(plane: FloatArray, distortion: Distortion, step: float = 1e-5) -> FloatArray:
    """(N,) area that the distortion makes of a unit area."""
    if not any(distortion):
        return np.ones(len(plane))
    dx, dy = np.array([step, 0.0]), np.array([0.0, step])
    along_x = (distort(plane + dx, distortion) - distort(plane - dx, distortion)) / (2 * step)
    along_y = (distort(plane + dy, distortion) - distort(plane - dy, distortion)) / (2 * step)
    return np.asarray(along_x[:, 0] * along_y[:, 1] - along_x[:, 1] * along_y[:, 0])
