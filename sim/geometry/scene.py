"""Scenes: rectangles gridded into patches, and where rays meet them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from sim import _kernel
from sim.arrays import FloatArray, IntArray
from sim.errors import SimulationError


@dataclass(frozen=True, eq=False, kw_only=True)
class Face:
    """A rectangle gridded into ``rows`` (along v) x ``columns`` (along u) equal patches.

    Its normal is u x v and points to the lit side. Patch (row, column) has the index
    ``first_patch + row * columns + column``.

    Raises
    ------
    SimulationError
        For edges that are not perpendicular, of length 0 or not finite, or less than one patch.
    """

    name: str
    origin_m: FloatArray
    """(3,) the corner where u and v begin [m]."""
    edge_u_m: FloatArray
    """(3,) edge along which the columns run [m]."""
    edge_v_m: FloatArray
    """(3,) edge along which the rows run; perpendicular to u [m]."""
    rows: int
    columns: int
    first_patch: int

    def __post_init__(self) -> None:
        for field in ("origin_m", "edge_u_m", "edge_v_m"):
            object.__setattr__(self, field, np.asarray(getattr(self, field), dtype=np.float64).reshape(3))
        lengths = np.linalg.norm([self.edge_u_m, self.edge_v_m], axis=1)
        if not (lengths.min() > 0 and np.isfinite(lengths).all() and np.isfinite(self.origin_m).all()):
            raise SimulationError(f"face {self.name}: edge lengths {lengths} m; both must be above 0 and finite")
        cosine = float(self.edge_u_m @ self.edge_v_m) / float(lengths.prod())
        if abs(cosine) > 1e-6:
            raise SimulationError(
                f"face {self.name}: its edges meet at {np.degrees(np.arccos(cosine)):.4f} degrees "
                "instead of 90; give a rectangle"
            )
        if self.rows < 1 or self.columns < 1:
            raise SimulationError(f"face {self.name}: {self.rows} x {self.columns} patches; at least 1 x 1")

    @property
    def n_patches(self) -> int:
        """Number of its patches."""
        return self.rows * self.columns

    @property
    def patches(self) -> slice:
        """Its patches' place in the scene."""
        return slice(self.first_patch, self.first_patch + self.n_patches)

    @cached_property
    def axes(self) -> FloatArray:
        """(3, 3) rows: unit u, unit v, unit normal."""
        u = self.edge_u_m / np.linalg.norm(self.edge_u_m)
        v = self.edge_v_m / np.linalg.norm(self.edge_v_m)
        return np.stack([u, v, np.cross(u, v)])

    @property
    def normal(self) -> FloatArray:
        """(3,) unit normal, into the room."""
        return np.asarray(self.axes[2])

    @property
    def size_m(self) -> tuple[float, float]:
        """Lengths of u and v [m]."""
        return float(np.linalg.norm(self.edge_u_m)), float(np.linalg.norm(self.edge_v_m))

    def points(self, u: ArrayLike, v: ArrayLike) -> FloatArray:
        """Return world points of face coordinates.

        Parameters
        ----------
        u, v : arrays of one shape
            Shares of the edges, in [0, 1].

        Returns
        -------
        (..., 3) array
            [m]
        """
        u, v = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
        return np.asarray(self.origin_m + u[..., None] * self.edge_u_m + v[..., None] * self.edge_v_m)

    def patch_at(self, uv: FloatArray) -> IntArray:
        """Return the patches that face coordinates lie in.

        Parameters
        ----------
        uv : (N, 2) array
            Shares of the edges, in [0, 1].

        Returns
        -------
        (N,) int array
            Indices in the scene.
        """
        column = np.minimum((uv[:, 0] * self.columns).astype(np.intp), self.columns - 1)
        row = np.minimum((uv[:, 1] * self.rows).astype(np.intp), self.rows - 1)
        return np.asarray(self.first_patch + row * self.columns + column)


@dataclass(frozen=True, eq=False)
class Scene:
    """Gridded rectangles with a diffuse reflectance a patch; a ``sim.geometry.surface.Surface``.

    Raises
    ------
    SimulationError
        For no faces, faces whose patches are not numbered one after the other, or a reflectance outside 0 ... 1.
    """

    name: str
    faces: tuple[Face, ...]
    reflectance: FloatArray
    """(P,) share of the light that a patch sends back, in [0, 1]."""
    convex: bool
    """True if every two points on the faces' lit sides see each other: no visibility rays are needed."""

    def __post_init__(self) -> None:
        if not self.faces:
            raise SimulationError(f"scene {self.name}: no faces; give at least one")
        first = 0
        for face in self.faces:
            if face.first_patch != first:
                raise SimulationError(
                    f"scene {self.name}, face {face.name}: first patch {face.first_patch}, expected {first}"
                )
            first += face.n_patches
        reflectance = np.asarray(self.reflectance, dtype=np.float64)
        if reflectance.shape != (first,):
            raise SimulationError(
                f"scene {self.name}: reflectance of shape {reflectance.shape} for {first} patches; one each"
            )
        if not ((reflectance >= 0) & (reflectance <= 1)).all():
            raise SimulationError(
                f"scene {self.name}: reflectance {reflectance.min():.4g} ... {reflectance.max():.4g}; "
                "it must lie in 0 ... 1"
            )
        object.__setattr__(self, "reflectance", reflectance)

    @property
    def n_patches(self) -> int:
        """Number of patches, P."""
        return len(self.reflectance)

    @cached_property
    def vertices(self) -> FloatArray:
        """(P, 4, 3) corners, counter-clockwise seen from the lit side [m]."""
        return np.concatenate([_patch_vertices(face) for face in self.faces])

    @cached_property
    def centres(self) -> FloatArray:
        """(P, 3) centres [m]."""
        return np.asarray(self.vertices.mean(axis=1))

    @cached_property
    def normals(self) -> FloatArray:
        """(P, 3) unit normals."""
        return np.concatenate([np.tile(face.normal, (face.n_patches, 1)) for face in self.faces])

    @cached_property
    def areas(self) -> FloatArray:
        """(P,) areas [m²]."""
        return np.concatenate([np.full(face.n_patches, np.prod(face.size_m) / face.n_patches) for face in self.faces])

    @cached_property
    def closed(self) -> bool:
        """True if the faces' area vectors add up to nothing, as those of every closed surface do."""
        vector = (self.areas[:, None] * self.normals).sum(axis=0)
        return len(self.faces) > 3 and bool(np.abs(vector).max() < 1e-9 * self.areas.sum())

    @cached_property
    def region(self) -> IntArray:
        """(P,) index of the face of each patch."""
        return np.repeat(np.arange(len(self.faces)), [face.n_patches for face in self.faces])

    @cached_property
    def occluders(self) -> FloatArray:
        """(M, 4, 3) corners of the faces that something of the scene lies behind [m]."""
        corners = np.concatenate([face.points([0, 1, 1, 0], [0, 0, 1, 1]) for face in self.faces])
        size = float(np.ptp(corners, axis=0).max())
        hidden = [((corners - face.origin_m) @ face.normal < -1e-9 * size).any() for face in self.faces]
        return np.asarray(corners.reshape(-1, 4, 3)[np.array(hidden)])

    @cached_property
    def tracer(self) -> _kernel.Tracer:
        """What meets rays and stops segments."""
        rows = [
            np.concatenate([f.origin_m, f.axes[0] / f.size_m[0], f.axes[1] / f.size_m[1], f.normal, counts])
            for f in self.faces
            for counts in [(f.columns, f.rows, f.first_patch)]
        ]
        corners = np.stack([face.points([0, 1, 1, 0], [0, 0, 1, 1]) for face in self.faces])
        return _kernel.Tracer(np.array(rows), corners, np.zeros((0, 12)))

    def with_reflectance(self, reflectance: ArrayLike) -> Scene:
        """Return the same scene with another reflectance.

        Parameters
        ----------
        reflectance : float or (P,) array
            In [0, 1].

        Returns
        -------
        Scene

        Raises
        ------
        SimulationError
            For a reflectance outside 0 ... 1.
        """
        values = np.broadcast_to(np.asarray(reflectance, dtype=np.float64), (self.n_patches,))
        return Scene(self.name, self.faces, values.copy(), self.convex)


def _patch_vertices(face: Face) -> FloatArray:
    u, v = np.meshgrid(np.arange(face.columns), np.arange(face.rows))
    corners = [
        face.points((u.ravel() + du) / face.columns, (v.ravel() + dv) / face.rows)
        for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    return np.stack(corners, axis=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Hits:
    """Where rays first meet a scene."""

    face: IntArray
    """(N,) index into ``scene.faces``; -1 where the ray meets nothing."""
    patch: IntArray
    """(N,) patch index; -1 where the ray meets nothing, or a face from behind."""
    distance: FloatArray
    """(N,) along the ray, infinite where it meets nothing. [lengths of the direction]"""
    uv: FloatArray
    """(N, 2) face coordinates in [0, 1]; 0 where the ray meets nothing."""
    cos_incidence: FloatArray
    """(N,) cosine between the ray reversed and the normal: above 0 on the lit side, below 0 from behind."""


def intersect(scene: Scene, origin_m: ArrayLike, directions: FloatArray) -> Hits:
    """Return the nearest hit of each ray; a face met from behind still stops it.

    Parameters
    ----------
    scene : Scene
    origin_m : (3,) or (N, 3) array
        Where the rays begin. [m]
    directions : (N, 3) array
        Unit directions.

    Returns
    -------
    Hits
    """
    return hits_of_tracer(scene.tracer, origin_m, directions)


def hits_of_tracer(tracer: _kernel.Tracer, origin_m: ArrayLike, directions: ArrayLike) -> Hits:
    """Return the hits of rays on whatever the tracer knows, by the native kernel.

    Raises
    ------
    SimulationError
        For origins or directions of another shape than ``intersect`` takes.
    """
    rays = np.ascontiguousarray(directions, dtype=np.float64)
    origins = np.atleast_2d(np.ascontiguousarray(origin_m, dtype=np.float64))
    n = len(rays)
    if rays.shape != (n, 3) or origins.shape not in ((1, 3), (n, 3)):
        raise SimulationError(f"rays: origins {origins.shape} and directions {rays.shape}; give (N, 3) directions")
    hits = Hits(
        face=np.empty(n, np.intp),
        patch=np.empty(n, np.intp),
        distance=np.empty(n),
        uv=np.empty((n, 2)),
        cos_incidence=np.empty(n),
    )
    tracer.trace(
        origins,
        rays,
        face=hits.face,
        patch=hits.patch,
        distance=hits.distance,
        uv=hits.uv,
        cosine=hits.cos_incidence,
    )
    return hits
