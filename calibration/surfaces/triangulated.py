"""Surfaces of any form as triangles: flat parts by their planes, curved ones by the points about each corner."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calibration.arrays import BoolArray, FloatArray, IntArray
from calibration.geometry.pinhole import PinholeModel, world_rays
from calibration.surfaces.flat_parts import Parts
from calibration.surfaces.planar_mesh import PlanarMesh, SideAt, mesh_within
from calibration.surfaces.point_map import PointMap, at_least_usual

_OUTLINE_PX = 0.8
"""By which a straightened outline may leave that of the pixels: their stairs are half a pixel high."""
_LEAST_SIDE_PX = 3.0
"""A side of a triangle in the picture: below, the points about a corner are too few to place it."""
_CHORD = 1e-3
"""Of the distance, by which a flat triangle may leave a curved surface in its middle; less towards its rim."""
_LEAST_SLANT = 0.25
"""Cosine between ray and normal, below which triangles grow long rather than many."""
_AT_CONTACT = 0.25
"""Of the longest side, the shortest where a part touches something else: light changes there within centimetres."""
_ABOUT_PX = 2
"""Half the side of the window whose shortest side an outline follows."""
_CLEAR = 0.8
"""Of the wanted side: no two points drawn by chance are nearer, so that the mean side comes out about as wanted."""
_BEND_SPREAD_PX = 4.0
"""Spread of the smoothing before the bend of a surface is taken, and of the points that place a corner."""
_NEIGHBOURS_PX = 6
"""Half the side of the window whose points place a corner of a curved part."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TriangulatedSurface:
    """Triangles that a camera sees, with how uncertain they are."""

    vertices_m: FloatArray
    """(V, 3) corners in the world. [m]"""
    triangles: IntArray
    """(T, 3) corners of each triangle, counter-clockwise seen from the camera."""
    part: IntArray
    """(T,) part of surface that each belongs to: light is smooth within."""
    sigma_m: FloatArray
    """(V,) standard deviation of each corner along the camera's ray, of the correspondence alone. [m]"""
    flat: BoolArray
    """(K,) parts that are planes."""

    @property
    def n_parts(self) -> int:
        """Number of parts, K."""
        return len(self.flat)


@dataclass(frozen=True, eq=False)
class _Placed:
    """A mesh in the picture, and the distance of its corners."""

    mesh: PlanarMesh
    """In pixels."""
    distance_m: FloatArray
    sigma_m: FloatArray


def triangulated(
    points: PointMap,
    parts: Parts,
    camera: PinholeModel,
    patch_size_m: float,
    *,
    apart_m: FloatArray | None = None,
) -> TriangulatedSurface:
    """Make triangles of parts of surface.

    Parameters
    ----------
    points : PointMap
    parts : Parts
        Which of the pixels belong together, and which of these parts are planes.
    camera : PinholeModel
        Whose pixels these are.
    patch_size_m : float
        Longest wanted side of a triangle; shorter where the surface bends. [m]
    apart_m : (H, W), optional
        How far each point is from what else there is: sides are no longer than that, but for a quarter of the longest.
        [m]

    Returns
    -------
    TriangulatedSurface
    """
    vertices, triangles, part, sigmas = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)], []
    count = 0
    side_m = np.full(parts.label.shape, patch_size_m)
    if apart_m is not None:
        side_m = patch_size_m * np.clip(apart_m / patch_size_m, _AT_CONTACT, 1.0)
    for number, plane in enumerate(parts.planes):
        placed = _placed(points, parts.label == number, plane, side_m)
        kept = _kept(placed.mesh, placed.distance_m)
        vertices.append(points.origin_m + placed.distance_m[:, None] * world_rays(camera, placed.mesh.corners))
        triangles.append(placed.mesh.triangles[kept] + count)
        part.append(np.full(int(kept.sum()), number, dtype=np.int64))
        sigmas.append(placed.sigma_m)
        count += len(placed.distance_m)
    return _without_unused(
        np.concatenate(vertices),
        np.concatenate(triangles),
        part=np.concatenate(part),
        sigma_m=np.concatenate([*sigmas, []]),
        parts=parts,
    )


def _kept(mesh: PlanarMesh, distance_m: FloatArray) -> BoolArray:
    """Triangles all of whose corners are somewhere ahead."""
    return np.asarray((np.isfinite(distance_m) & (distance_m > 0))[mesh.triangles].all(axis=1))


def _without_unused(
    vertices_m: FloatArray, triangles: IntArray, *, part: IntArray, sigma_m: FloatArray, parts: Parts
) -> TriangulatedSurface:
    used, renamed = np.unique(triangles, return_inverse=True)
    # Rows of a picture count downwards: what runs left in it runs right seen from the camera.
    return TriangulatedSurface(
        vertices_m=vertices_m[used],
        triangles=renamed.reshape(-1, 3)[:, ::-1].astype(np.int64),
        part=part,
        sigma_m=sigma_m[used],
        flat=parts.flat,
    )


def _placed(points: PointMap, mask: BoolArray, plane: FloatArray, wanted_m: FloatArray) -> _Placed:
    distance_m = np.where(mask, points.distance_m, np.nanmedian(points.distance_m[mask]))
    side_px = wanted_m / (points.metres_per_px * distance_m)
    if np.isfinite(plane).all():
        # Seen at a slant a pixel covers more of the plane one way than the other.
        slant = np.abs(points.rays @ plane) / np.linalg.norm(plane)
        side_px = side_px * np.maximum(slant, _LEAST_SLANT)
    else:
        side_px = np.minimum(side_px, _chord_px(points, mask))
    side_px = np.clip(np.nan_to_num(side_px, nan=_LEAST_SIDE_PX), _LEAST_SIDE_PX, None)
    mesh = mesh_within(_outlines(mask), _spread(mask, side_px), _read_at(mask, side_px), _LEAST_SIDE_PX)
    return _Placed(mesh, *_distances(points, mask, plane, mesh.corners))


def _read_at(mask: BoolArray, side_px: FloatArray) -> SideAt:
    """What reads a map of sides at places in the picture: the shortest of the mask's pixels about each."""
    window = np.ones((2 * _ABOUT_PX + 1,) * 2, np.uint8)
    longest = float(side_px[mask].max())
    shortest = cv2.erode(np.where(mask, side_px, longest), window)
    highest = np.array(mask.shape) - 1

    def side_at(xy_px: FloatArray) -> FloatArray:
        row, column = np.clip(np.rint(xy_px[:, ::-1]), 0, highest).astype(np.intp).T
        return np.asarray(shortest[row, column])

    return side_at


def _outlines(mask: BoolArray) -> list[FloatArray]:
    """Outlines of a mask through the borders of its pixels, straightened, as (n, 2) columns and rows."""
    from skimage.measure import approximate_polygon, find_contours  # here, for it takes its time

    padded = np.pad(mask.astype(np.float64), 1)
    found = find_contours(padded, 0.5)  # type: ignore[no-untyped-call]
    rings = [approximate_polygon(ring, _OUTLINE_PX) for ring in found]  # type: ignore[no-untyped-call]
    return [ring[:-1, ::-1] - 1 for ring in rings if len(ring) > 3]


def _chord_px(points: PointMap, mask: BoolArray) -> FloatArray:
    """(H, W) side of a triangle whose middle leaves the bent surface by a given share of the distance.

    Over h pixels a chord leaves 1 / distance by h² / 8 of its second derivative.
    """
    weight = mask.astype(np.float64)
    inverse = np.where(mask, 1 / np.where(mask, points.distance_m, 1.0), 0.0)
    spread = (0, 0), _BEND_SPREAD_PX
    smooth = cv2.GaussianBlur(inverse, *spread) / np.maximum(cv2.GaussianBlur(weight, *spread), 1e-9)
    kernel = np.array([1.0, -2.0, 1.0])
    step = round(_BEND_SPREAD_PX)
    wide = np.zeros(2 * step + 1)
    wide[[0, step, 2 * step]] = kernel / step**2
    one = np.ones(1)
    bend = np.hypot(cv2.sepFilter2D(smooth, -1, wide, one), cv2.sepFilter2D(smooth, -1, one, wide))
    inner = cv2.erode(mask.astype(np.uint8), np.ones((2 * step + 1,) * 2)) > 0
    bend = np.where(inner, bend, np.median(bend[inner]) if inner.any() else 0.0)
    return np.asarray(np.sqrt(8 * _CHORD * np.where(mask, inverse, 1.0) / np.maximum(bend, 1e-12)))


def _spread(mask: BoolArray, side_px: FloatArray) -> FloatArray:
    """(M, 2) points within a mask that are about as far from each other as the sides that are wanted there."""
    free = mask.astype(np.uint8)
    rows, columns = np.nonzero(mask)
    order = np.random.default_rng(0).permutation(len(rows))
    found = []
    for row, column in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        if free[row, column]:
            found.append((column, row))
            radius = max(1, round(_CLEAR * side_px[row, column]))
            cv2.circle(free, (column, row), radius, color=0, thickness=cv2.FILLED)
    return np.array(found, dtype=np.float64).reshape(-1, 2)


def _distances(
    points: PointMap, mask: BoolArray, plane: FloatArray, corners_px: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(V,) distance of corners, and its standard deviation."""
    if np.isfinite(plane).all():
        rays = _rays_at(points, corners_px)
        usual = float(np.median(points.sigma_m[mask]) / np.sqrt(mask.sum()))
        with np.errstate(divide="ignore"):
            return 1 / (rays @ plane), np.full(len(corners_px), usual)
    found = [_near(points, mask, corner) for corner in corners_px]
    distance, sigma = np.array(found).reshape(-1, 2).T
    return distance, sigma


def _rays_at(points: PointMap, xy_px: FloatArray) -> FloatArray:
    """(N, 3) unit rays between pixels, and just outside the picture's border."""
    height, width = points.rays.shape[:2]
    corner = np.clip(np.floor(xy_px), 0, (width - 2, height - 2)).astype(np.intp)
    fx, fy = (xy_px - corner).T[:, :, None]
    x, y = corner.T
    upper = (1 - fx) * points.rays[y, x] + fx * points.rays[y, x + 1]
    lower = (1 - fx) * points.rays[y + 1, x] + fx * points.rays[y + 1, x + 1]
    rays = (1 - fy) * upper + fy * lower
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _near(points: PointMap, mask: BoolArray, corner_px: FloatArray) -> tuple[float, float]:
    """Distance at a place in the picture by a quadric through 1 / distance of the points about, and its sigma."""
    column, row = corner_px
    top, left = (max(0, round(v) - _NEIGHBOURS_PX) for v in (row, column))
    window = np.s_[top : round(row) + _NEIGHBOURS_PX + 1, left : round(column) + _NEIGHBOURS_PX + 1]
    rows, columns = np.nonzero(mask[window])
    if len(rows) < 3:
        return np.nan, np.nan
    distance_m, sigma_m = points.distance_m[window][rows, columns], points.sigma_m[window][rows, columns]
    sigma = at_least_usual(sigma_m, sigma_m) / distance_m**2
    x, y = columns + left - column, rows + top - row
    terms = [np.ones_like(x), x, y, x * x, x * y, y * y][: 6 if len(rows) >= 24 else 3]
    design = np.stack(terms, axis=1)
    nearness = np.exp(-(x * x + y * y) / (2 * _BEND_SPREAD_PX**2)) / sigma**2
    normal = (design * nearness[:, None]).T @ design
    inverse = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
    value = float(inverse[0] @ ((design * nearness[:, None]).T @ (1 / distance_m)))
    return (1 / value, float(np.sqrt(max(inverse[0, 0], 0.0))) / value**2) if value > 0 else (np.nan, np.nan)
