"""AdaptivePatches: a surface's faces cut into quads and triangles of unequal size, split where a plan asks for it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sim import _kernel
from sim.arrays import BoolArray, FloatArray, IntArray
from sim.geometry.scene import Face, Scene, intersect
from sim.geometry.surface import Surface

ON_PLANE = 1e-9
"""Distance from a plane, over the scene's size, up to which an edge lies in it."""
PIECES = 16
"""Of a patch that is cut into quarters twice."""
PER_PATCH = ("vertices", "reflectance", "region", "whole")


@dataclass(frozen=True, eq=False, kw_only=True)
class Sixteenths:
    """Pieces of P patches; piece k of patch p is number k P + p."""

    corners: FloatArray
    """(16 P, 4, 3) [m]."""
    centres: FloatArray
    """(16 P, 3) centroids [m]."""
    areas: FloatArray
    """(16 P,) [m²]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class AdaptivePatches:
    """Patches of unequal size; a ``sim.geometry.surface.Surface``. Corners of one may lie within another's edge."""

    name: str
    vertices: FloatArray
    """(P, 4, 3) corners, counter-clockwise seen from the lit side; a triangle repeats its last [m]."""
    reflectance: FloatArray
    """(P,) share of the light that a patch sends back, in [0, 1]."""
    region: IntArray
    """(P,) number of the flat region that each patch was cut from."""
    whole: IntArray
    """(P,) number of the whole, uncut patch that each was cut from."""
    occluders: FloatArray
    """(M, 4, 3) polygons that may stand between two patches, uncut [m]."""
    convex: bool
    closed: bool

    @property
    def n_patches(self) -> int:
        """Number of patches, P."""
        return len(self.vertices)

    @cached_property
    def _area_vectors(self) -> FloatArray:
        corners = self.vertices
        return np.asarray(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]) / 2)

    @cached_property
    def areas(self) -> FloatArray:
        """(P,) areas [m²]."""
        return np.asarray(np.linalg.norm(self._area_vectors, axis=1))

    @cached_property
    def normals(self) -> FloatArray:
        """(P, 3) unit normals."""
        return np.asarray(self._area_vectors / self.areas[:, None])

    @cached_property
    def centres(self) -> FloatArray:
        """(P, 3) centroids [m]."""
        areas, centres = triangles(self.vertices)
        return np.asarray((areas[..., None] * centres).sum(axis=1) / areas.sum(axis=1)[:, None])

    @cached_property
    def edges(self) -> FloatArray:
        """(P, 2, 3) mean edge vectors along u (first to second corner) and v [m]."""
        a, b, c, d = np.moveaxis(self.vertices, 1, 0)
        return np.stack([(b - a + c - d) / 2, (d - a + c - b) / 2], axis=1)

    @cached_property
    def triangular(self) -> BoolArray:
        """(P,) True where the last corner repeats the third."""
        return np.asarray((self.vertices[:, 2] == self.vertices[:, 3]).all(axis=1))

    def variation(self, gradient: FloatArray) -> FloatArray:
        """Return how much a linear field varies within each patch.

        Parameters
        ----------
        gradient : (P, 3) array
            Of the field, g. [unit/m]

        Returns
        -------
        (P,) array
            Integral over each patch of (g . (x - centre))². [unit² m²]
        """
        a, b, c, d = np.moveaxis(self.vertices - self.centres[:, None], 1, 0)
        total = np.zeros(self.n_patches)
        for corners in ((a, b, c), (a, c, d)):
            area = np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0]), axis=1) / 2
            heights = np.stack([np.einsum("pk,pk->p", corner, gradient) for corner in corners])
            total += area / 12 * ((heights**2).sum(axis=0) + heights.sum(axis=0) ** 2)
        return total

    @cached_property
    def polar_moments(self) -> FloatArray:
        """(P,) integral over each patch of |x - centre|² [m⁴]."""
        return np.asarray(sum(self.variation(np.tile(axis, (self.n_patches, 1))) for axis in np.eye(3)))

    def chosen(self, cells: BoolArray | IntArray) -> AdaptivePatches:
        """Return some of the patches.

        Parameters
        ----------
        cells : (P,) bool array, or int array
            Which ones.

        Returns
        -------
        AdaptivePatches
        """
        vertices, reflectance, region, whole = (getattr(self, key)[cells] for key in PER_PATCH)
        return replace(self, vertices=vertices, reflectance=reflectance, region=region, whole=whole)

    def halves(self, along: IntArray) -> AdaptivePatches:
        """Return the halves of all patches, first halves before second ones.

        Parameters
        ----------
        along : (P,) int array
            Quads are cut across u (0) or v (1); triangles at their longest edge, whatever it says.

        Returns
        -------
        AdaptivePatches
            2 P of them.
        """
        first, second = _halves(self.vertices, along, self.triangular)
        return joined(replace(self, vertices=first), replace(self, vertices=second))

    def quarters(self) -> AdaptivePatches:
        """Return the quarters of all patches, each cut twice.

        Returns
        -------
        AdaptivePatches
            4 P of them; patch i becomes i, i + P, i + 2 P, i + 3 P.
        """
        once = self.halves(np.zeros(self.n_patches, dtype=np.intp))
        return once.halves(np.ones(once.n_patches, dtype=np.intp))

    def sixteenths(self) -> Sixteenths:
        """Return the quarters of the quarters of all patches, natively: a plan asks for them often, and for no more.

        Returns
        -------
        Sixteenths
            ``quarters().quarters()`` as arrays.
        """
        count = PIECES * self.n_patches
        found = Sixteenths(corners=np.empty((count, 4, 3)), centres=np.empty((count, 3)), areas=np.empty(count))
        vertices = np.ascontiguousarray(self.vertices, dtype=np.float64)
        _kernel.sixteenths(vertices, corners=found.corners, centres=found.centres, areas=found.areas)
        return found


def joined(first: AdaptivePatches, second: AdaptivePatches) -> AdaptivePatches:
    """Return two sets of patches of one scene as one, the first before the second."""
    parts = (np.concatenate([getattr(first, key), getattr(second, key)]) for key in PER_PATCH)
    vertices, reflectance, region, whole = parts
    return replace(first, vertices=vertices, reflectance=reflectance, region=region, whole=whole)


def triangles(vertices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return areas (P, 2) [m²] and centroids (P, 2, 3) [m] of the two triangles of each patch (P, 4, 3)."""
    a, b, c, d = np.moveaxis(vertices, 1, 0)
    areas = np.stack([_area_between(b - a, c - a), _area_between(c - a, d - a)], axis=1)
    return areas, np.stack([(a + b + c) / 3, (a + c + d) / 3], axis=1)


def _area_between(one: FloatArray, other: FloatArray) -> FloatArray:
    """(P,) areas of triangles with these edges: numpy's cross product and norm, in a third of their time."""
    (x, y, z), (u, v, w) = one.T, other.T
    return np.asarray(np.sqrt((y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2) / 2)


def _halves(vertices: FloatArray, along: IntArray, triangular: BoolArray) -> tuple[FloatArray, FloatArray]:
    # Turned so that the edge to cut is the first; a triangle's longest edge is.
    turn = np.where(triangular, _longest_edge(vertices), along)
    count = np.where(triangular, 3, 4)
    order = (np.arange(4) + turn[:, None]) % count[:, None]
    order[triangular, 3] = order[triangular, 2]
    a, b, c, d = np.moveaxis(np.take_along_axis(vertices, order[:, :, None], axis=1), 1, 0)
    low = (a + b) / 2
    high = np.where(triangular[:, None], c, (c + d) / 2)
    return np.stack([a, low, high, d], axis=1), np.stack([low, b, c, high], axis=1)


def _longest_edge(vertices: FloatArray) -> IntArray:
    lengths = [np.linalg.norm(vertices[:, (k + 1) % 3] - vertices[:, k], axis=1) for k in range(3)]
    return np.asarray(np.argmax(lengths, axis=0))


def coarsest_patches(surface: Surface) -> AdaptivePatches:
    """Return the fewest patches: a scene's faces, cut where others stand on them; a mesh's patches as they are.

    What another object covers (the floor under a box) is left out: no light gets there. A face whose
    reflectance varies keeps its patches.
    """
    if isinstance(surface, Scene):
        return _cells_of_scene(surface)
    return AdaptivePatches(
        name=surface.name,
        vertices=surface.vertices,
        reflectance=surface.reflectance,
        region=surface.region,
        whole=np.arange(surface.n_patches),
        occluders=surface.occluders,
        convex=surface.convex,
        closed=surface.closed,
    )


def _cells_of_scene(scene: Scene) -> AdaptivePatches:
    corners = np.stack([face.points([0, 1, 1, 0], [0, 0, 1, 1]) for face in scene.faces])
    pieces, reflectance, region = [], [], []
    for index, face in enumerate(scene.faces):
        rho = scene.reflectance[face.patches]
        if np.ptp(rho) == 0:
            vertices = _grid(face, *_contact_lines(face, np.delete(corners, index, axis=0)))
            vertices = vertices if scene.convex else vertices[~_covered(scene, face, vertices)]
            rho = np.full(len(vertices), rho[0])
        else:
            vertices = scene.vertices[face.patches]
        pieces.append(vertices)
        reflectance.append(rho)
        region.append(np.full(len(vertices), index))
    vertices = np.concatenate(pieces)
    vectors = np.cross(vertices[:, 2] - vertices[:, 0], vertices[:, 3] - vertices[:, 1]) / 2
    closed = len(scene.faces) > 3 and bool(np.abs(vectors.sum(axis=0)).max() < 1e-9 * np.abs(vectors).sum())
    return AdaptivePatches(
        name=scene.name,
        vertices=vertices,
        reflectance=np.concatenate(reflectance),
        region=np.concatenate(region),
        whole=np.arange(len(vertices)),
        occluders=scene.occluders,
        convex=scene.convex,
        closed=closed,
    )


def _contact_lines(face: Face, others: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where along u and v edges of other faces lie on this one and run along it, 0 and 1 included."""
    local = others - face.origin_m
    u, v = (local @ axis / size for axis, size in zip(face.axes[:2], face.size_m, strict=True))
    on_plane = np.abs(local @ face.normal) <= ON_PLANE * max(face.size_m)
    lines: list[list[float]] = [[0.0, 1.0], [0.0, 1.0]]
    for k in range(4):
        ends = (slice(None), [k, (k + 1) % 4])
        lies = on_plane[ends].all(axis=1)
        for axis, (across, beside) in enumerate(((u, v), (v, u))):
            low, high = beside[ends].min(axis=1), beside[ends].max(axis=1)
            runs = lies & (np.abs(np.diff(across[ends], axis=1)[:, 0]) < 1e-9) & (low < 1 - 1e-9) & (high > 1e-9)
            lines[axis] += [float(x) for x in across[runs, k] if 1e-6 < x < 1 - 1e-6]
    first, second = (_distinct(np.sort(np.array(values))) for values in lines)
    return first, second


def _distinct(values: FloatArray) -> FloatArray:
    return np.asarray(values[np.concatenate([[True], np.diff(values) > 1e-9])])


def _grid(face: Face, u: FloatArray, v: FloatArray) -> FloatArray:
    """(patches, 4, 3) corners of the rectangles between lines."""
    low_u, low_v = (grid.ravel() for grid in np.meshgrid(u[:-1], v[:-1]))
    high_u, high_v = (grid.ravel() for grid in np.meshgrid(u[1:], v[1:]))
    pairs = ((low_u, low_v), (high_u, low_v), (high_u, high_v), (low_u, high_v))
    return np.stack([face.points(*pair) for pair in pairs], axis=1)


def _covered(scene: Scene, face: Face, vertices: FloatArray) -> BoolArray:
    """(patches,) True where the middle of a patch sees mostly backs of faces: it lies inside an object."""
    u, v, normal = face.axes
    size = float(np.ptp(scene.vertices.reshape(-1, 3), axis=0).max())
    origin = vertices.mean(axis=1) + 1e-6 * size * normal
    backs = np.zeros(len(origin))
    directions = (normal, *(normal + 0.7 * tilt for tilt in (u, -u, v, -v)))
    for direction in directions:
        rays = np.tile(direction / np.linalg.norm(direction), (len(origin), 1))
        hits = intersect(scene, origin, rays)
        backs += (hits.face >= 0) & (hits.cos_incidence < 0)
    return np.asarray(backs > len(directions) / 2)
