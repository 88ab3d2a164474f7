"""Correspondences of simple shapes, by their own equations: a wall, a block before it, a ball, two planes that meet."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibration.geometry.pinhole import PinholeModel, project, world_rays
from calibration.structured_light.correspondence import Correspondence, PixelReason

SIGMA_PX = 0.05
Shape = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Distances along rays (N, 3) from an origin (3,); infinite for none."""


def device(position_m, look_at_m, width_px=320, height_px=240, focal_px=260.0):
    """A pinhole that looks at a point, z up."""
    forward = np.array(look_at_m, float) - position_m
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return PinholeModel(
        width_px=width_px,
        height_px=height_px,
        focal_px=(focal_px, focal_px),
        principal_point_px=((width_px - 1) / 2, (height_px - 1) / 2),
        distortion=(-0.02, 0.003, 0.0, 0.0, 0.0),
        rotation=rotation,
        translation_m=-rotation @ np.array(position_m, float),
    )


CAMERA = device((0.3, 0.0, 1.2), (0.3, 3.0, 1.1))
PROJECTOR = device((-0.4, 0.0, 1.1), (0.2, 3.0, 1.1), width_px=400, height_px=300, focal_px=280.0)


def plane(point_m, normal) -> Shape:
    """A plane that has no end."""

    def meet(origin, rays):
        with np.errstate(divide="ignore"):
            along = ((np.array(point_m) - origin) @ np.array(normal)) / (rays @ np.array(normal))
        return np.where(along > 0, along, np.inf)

    return meet


def rectangle(corner_m, u_m, v_m) -> Shape:
    """A flat rectangle."""
    u, v = np.array(u_m, float), np.array(v_m, float)
    whole = plane(corner_m, np.cross(u, v))

    def meet(origin, rays):
        along = whole(origin, rays)
        on = origin + np.where(np.isfinite(along), along, 0)[:, None] * rays - corner_m
        inside = (on @ u >= 0) & (on @ u <= u @ u) & (on @ v >= 0) & (on @ v <= v @ v)
        return np.where(inside, along, np.inf)

    return meet


def ball(centre_m, radius_m) -> Shape:
    """A ball, seen from outside."""

    def meet(origin, rays):
        to = np.array(centre_m) - origin
        half = rays @ to
        inner = half**2 - to @ to + radius_m**2
        return np.where(inner > 0, half - np.sqrt(np.maximum(inner, 0)), np.inf)

    return meet


def nearest(shapes, origin, rays):
    """Distance of the first of several shapes that a ray meets."""
    return np.min([shape(origin, rays) for shape in shapes], axis=0)


def distances(shapes, camera=CAMERA):
    """(H, W) true distances."""
    columns, rows = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    rays = world_rays(camera, np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float))
    return nearest(shapes, camera.position_m, rays).reshape(camera.height_px, camera.width_px)


def correspondence_of(shapes, *, sigma_px=SIGMA_PX, seed=0, camera=CAMERA, projector=PROJECTOR) -> Correspondence:
    """What a camera decodes of shapes: noise, shadows, and the end of the projector's picture are in it."""
    columns, rows = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    rays = world_rays(camera, np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float))
    along = nearest(shapes, camera.position_m, rays)
    there = np.isfinite(along)
    points = camera.position_m + np.where(there, along, 1.0)[:, None] * rays
    way = points - projector.position_m
    length = np.linalg.norm(way, axis=1)
    lit = there & (nearest(shapes, projector.position_m, way / length[:, None]) > length * (1 - 1e-6))
    xy = project(projector, points)
    lit &= ((xy > -0.5) & (xy < (projector.width_px - 0.5, projector.height_px - 0.5))).all(axis=1)
    xy = np.where(lit[:, None], xy + np.random.default_rng(seed).normal(0, sigma_px, xy.shape), np.nan)
    shape = (camera.height_px, camera.width_px)
    return Correspondence(
        projector_xy_px=xy.reshape(*shape, 2).astype(np.float32),
        reason=np.where(lit, PixelReason.VALID, PixelReason.DARK).reshape(shape).astype(np.uint8),
        projector_shape=(projector.height_px, projector.width_px),
        sigma_px=np.full((*shape, 2), sigma_px, dtype=np.float32),
    )
