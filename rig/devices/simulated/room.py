"""The simulated world's room: axis-parallel walls cut into cells, and the light that they exchange.

Deliberately another discretisation than the model that is fitted to it (`sim`): light is collected at the cells'
centres (point to rectangle, exact), not averaged over patches, on a finer grid, and interpolated between centres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator, gmres

from rig.devices.simulated.settings import SimulationSettings, in_band
from rig.errors import DeviceError

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]

_AXIS_AND_SIDE = {"x0": (0, 0), "x1": (0, 1), "y0": (1, 0), "y1": (1, 1), "floor": (2, 0), "ceiling": (2, 1)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Wall:
    """One face of the room; its cells are numbered along `axes[0]` first, `axes[1]` second (fastest)."""

    name: str
    axis: int
    position_m: float
    axes: tuple[int, int]
    edges_m: tuple[FloatArray, FloatArray]
    first_cell: int

    @property
    def shape(self) -> tuple[int, int]:
        """Cells along the two axes."""
        return len(self.edges_m[0]) - 1, len(self.edges_m[1]) - 1

    @property
    def centres_m(self) -> tuple[FloatArray, FloatArray]:
        """Cell centres along the two axes, in metres."""
        a, b = self.edges_m
        return (a[1:] + a[:-1]) / 2, (b[1:] + b[:-1]) / 2

    @property
    def cell_area_m2(self) -> float:
        """Area of each cell."""
        a, b = self.edges_m
        return float((a[1] - a[0]) * (b[1] - b[0]))


@dataclass(frozen=True, slots=True)
class SurfacePoints:
    """Where rays meet the room: -1 and NaN where they escape through an open face."""

    wall: NDArray[np.int8]
    points_m: FloatArray
    distance_m: FloatArray
    cos_incidence: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedRoom:
    """Walls, the reflectance of their cells and the point-to-cell form factors."""

    settings: SimulationSettings
    walls: tuple[Wall, ...]
    reflectance: Float32Array
    """(N,) of each cell."""
    form_factors: Float32Array
    """(N, N) share of what leaves a small element at centre i that arrives at cell j."""
    band: int | None = None
    """Of the light: 0 red, 1 green, 2 blue; None: all, as a grey camera sees it."""

    @property
    def cell_area_m2(self) -> FloatArray:
        """(N,) areas."""
        return np.concatenate([np.full(w.shape[0] * w.shape[1], w.cell_area_m2) for w in self.walls])

    def indirect_irradiance(self, emission: FloatArray) -> FloatArray:
        """(N,) irradiance F B at the cell centres for reflected projector light `emission` (N,)."""
        n = len(self.reflectance)
        emitted = np.asarray(emission, dtype=np.float32)
        if not emitted.any():
            return np.zeros(n)
        operator = LinearOperator(
            (n, n), matvec=lambda b: b - self.reflectance * (self.form_factors @ b), dtype=np.float32
        )
        radiosity, info = gmres(operator, emitted, x0=emitted, rtol=1e-5, restart=40, maxiter=10)
        if info != 0:
            raise DeviceError("the simulated room's light did not converge; lower world.reflectance below 0.98")
        return np.asarray(self.form_factors @ radiosity.astype(np.float32), dtype=np.float64)


def make_room(settings: SimulationSettings, band: int | None = None) -> SimulatedRoom:
    """Cut the faces into cells and compute what they exchange, for one band of light or for a grey camera's."""
    walls: list[Wall] = []
    first = 0
    for name in settings.reflectance:
        walls.append(_make_wall(name, settings, first))
        first += walls[-1].shape[0] * walls[-1].shape[1]
    factors = np.zeros((first, first), dtype=np.float32)
    for receiver, emitter in product(walls, walls):
        if receiver is not emitter:
            _fill_block(factors, receiver, emitter)
    return in_light(
        SimulatedRoom(settings=settings, walls=tuple(walls), reflectance=np.zeros(0, np.float32), form_factors=factors),
        band,
    )


def in_light(room: SimulatedRoom, band: int | None) -> SimulatedRoom:
    """The same walls in another band of light."""
    room = replace(room, band=band)
    reflectance = np.concatenate([_cell_reflectance(room, k) for k in range(len(room.walls))])
    return replace(room, reflectance=reflectance.astype(np.float32))


def _make_wall(name: str, settings: SimulationSettings, first_cell: int) -> Wall:
    axis, side = _AXIS_AND_SIDE[name]
    a, b = (k for k in range(3) if k != axis)
    size = settings.size_m
    counts = [max(1, round(size[k] / settings.cell_size_m)) for k in (a, b)]
    edges = (np.linspace(0, size[a], counts[0] + 1), np.linspace(0, size[b], counts[1] + 1))
    return Wall(name=name, axis=axis, position_m=side * size[axis], axes=(a, b), edges_m=edges, first_cell=first_cell)


def _parallel_corner(a: FloatArray, b: FloatArray, distance: float) -> FloatArray:
    """Element to a parallel rectangle that spans from its foot to (a, b); odd in both."""
    a, b = a / distance, b / distance
    ra, rb = np.sqrt(1 + a * a), np.sqrt(1 + b * b)
    return np.asarray((a / ra * np.arctan(b / ra) + b / rb * np.arctan(a / rb)) / (2 * np.pi))


def _perpendicular_corner(s: FloatArray, z: FloatArray, c: FloatArray) -> FloatArray:
    """Element to an upright rectangle at distance c, spanning 0…s sideways and 0…z along the element's normal."""
    r = np.hypot(z, c)
    return np.asarray((np.arctan2(s, c) - c / r * np.arctan2(s, r)) / (2 * np.pi))


def _fill_block(factors: Float32Array, receiver: Wall, emitter: Wall) -> None:
    nr, ne = receiver.shape, emitter.shape
    rows = slice(receiver.first_cell, receiver.first_cell + nr[0] * nr[1])
    columns = slice(emitter.first_cell, emitter.first_cell + ne[0] * ne[1])
    block = _parallel_block if receiver.axis == emitter.axis else _perpendicular_block
    factors[rows, columns] = block(receiver, emitter).reshape(nr[0] * nr[1], ne[0] * ne[1])


def _parallel_block(receiver: Wall, emitter: Wall) -> Float32Array:
    """Opposite faces have the same grid: the factor depends on the two index differences only."""
    (na, nb), (ca, cb), (ea, eb) = receiver.shape, receiver.centres_m, emitter.edges_m
    offsets_a = np.concatenate([ea[:1] - ca[::-1], ea[1:] - ca[0]])
    offsets_b = np.concatenate([eb[:1] - cb[::-1], eb[1:] - cb[0]])
    corners = _parallel_corner(offsets_a[:, None], offsets_b[None, :], abs(emitter.position_m - receiver.position_m))
    table = np.diff(np.diff(corners, axis=0), axis=1).astype(np.float32)
    ia = np.arange(na)[None, :] - np.arange(na)[:, None] + na - 1
    ib = np.arange(nb)[None, :] - np.arange(nb)[:, None] + nb - 1
    return np.asarray(table[ia[:, None, :, None], ib[None, :, None, :]])


def _perpendicular_block(receiver: Wall, emitter: Wall) -> Float32Array:
    """Depends on the index difference along the shared axis, the receiver's distance and the emitter's height."""
    shared = next(k for k in receiver.axes if k in emitter.axes)
    r_shared, e_shared = receiver.axes.index(shared), emitter.axes.index(shared)
    cs, es = receiver.centres_m[r_shared], emitter.edges_m[e_shared]
    n = len(cs)
    sideways = np.concatenate([es[:1] - cs[::-1], es[1:] - cs[0]])
    distance = np.abs(receiver.centres_m[1 - r_shared] - emitter.position_m)
    height = np.abs(emitter.edges_m[1 - e_shared] - receiver.position_m)
    corners = _perpendicular_corner(sideways[:, None, None], height[None, None, :], distance[None, :, None])
    table = np.abs(np.diff(np.diff(corners, axis=0), axis=2)).astype(np.float32)
    shift = np.arange(n)[None, :] - np.arange(n)[:, None] + n - 1
    block = table[shift]  # receiver shared, emitter shared, receiver distance, emitter height
    rows = (0, 2) if r_shared == 0 else (2, 0)
    cols = (1, 3) if e_shared == 0 else (3, 1)
    return np.asarray(block.transpose(rows + cols))


def reflectance_at(room: SimulatedRoom, wall_index: int, points_m: FloatArray) -> FloatArray:
    """(N,) reflectance of points of one wall: its mean, a smooth variation, and the posters."""
    wall, settings = room.walls[wall_index], room.settings
    s, t = (points_m[..., k] / settings.size_m[k] for k in wall.axes)
    phase = 1.7 * wall_index
    wave = 0.6 * np.sin(2 * np.pi * (1.3 * s + 0.4 * t) + phase) + 0.4 * np.sin(
        2 * np.pi * (2.1 * t - 0.7 * s) + 2.0 * phase
    )
    value = in_band(settings.reflectance[wall.name], room.band) + settings.texture * wave  # type: ignore[index]
    for poster in settings.posters:
        if poster.face == wall.name:
            inside = (s >= poster.lower[0]) & (s <= poster.upper[0])
            inside &= (t >= poster.lower[1]) & (t <= poster.upper[1])
            value = np.where(inside, in_band(poster.reflectance, room.band), value)
    return np.asarray(np.clip(value, 0.0, 0.99))


def _cell_reflectance(room: SimulatedRoom, wall_index: int, samples: int = 3) -> FloatArray:
    """Mean over samples × samples points of each cell."""
    wall = room.walls[wall_index]
    fine = [np.linspace(e[0], e[-1], samples * (len(e) - 1) + 1) for e in wall.edges_m]
    a, b = ((e[1:] + e[:-1]) / 2 for e in fine)
    points = np.zeros((len(a), len(b), 3))
    points[..., wall.axis] = wall.position_m
    points[..., wall.axes[0]], points[..., wall.axes[1]] = a[:, None], b[None, :]
    values = reflectance_at(room, wall_index, points)
    na, nb = wall.shape
    return np.asarray(values.reshape(na, samples, nb, samples).mean(axis=(1, 3)).ravel())


def trace(room: SimulatedRoom, origin_m: FloatArray, directions: FloatArray) -> SurfacePoints:
    """Follow unit rays (..., 3) from a point inside the room to the first wall."""
    shape = directions.shape[:-1]
    best = np.full(shape, np.inf)
    wall_of = np.full(shape, -1, dtype=np.int8)
    cosine = np.full(shape, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k, wall in enumerate(room.walls):
            along = directions[..., wall.axis]
            t = (wall.position_m - origin_m[wall.axis]) / along
            inside = (t > 1e-9) & (t < best)
            for axis in wall.axes:
                x = origin_m[axis] + t * directions[..., axis]
                inside &= (x >= 0) & (x <= room.settings.size_m[axis])
            best[inside], wall_of[inside] = t[inside], k
            cosine[inside] = np.abs(along[inside])
        points = origin_m + best[..., None] * directions
    points[wall_of < 0] = np.nan
    return SurfacePoints(wall_of, points, np.where(wall_of >= 0, best, np.nan), cosine)


def cells_of(room: SimulatedRoom, points: SurfacePoints) -> IntArray:
    """Cell index of each surface point, -1 where there is none."""
    cells = np.full(points.wall.shape, -1, dtype=np.int64)
    for k, wall in enumerate(room.walls):
        on = points.wall == k
        ia, ib = (_cell_coordinate(points.points_m[on], wall, c).astype(np.int64) for c in (0, 1))
        cells[on] = wall.first_cell + ia * wall.shape[1] + ib
    return cells


def _cell_coordinate(points_m: FloatArray, wall: Wall, c: int) -> FloatArray:
    edges = wall.edges_m[c]
    step = edges[1] - edges[0]
    return np.asarray(np.clip(np.floor((points_m[:, wall.axes[c]] - edges[0]) / step), 0, len(edges) - 2))


def interpolation(room: SimulatedRoom, points: SurfacePoints) -> csr_array:
    """(n points, N) weights: bilinear between cell centres of a wall, constant beyond the outermost ones."""
    rows: list[IntArray] = []
    columns: list[IntArray] = []
    weights: list[FloatArray] = []
    flat_wall, flat_points = points.wall.ravel(), points.points_m.reshape(-1, 3)
    for k, wall in enumerate(room.walls):
        index = np.flatnonzero(flat_wall == k)
        (ia, wa), (ib, wb) = (_bracket(flat_points[index], wall, c) for c in (0, 1))
        for da, db in product((0, 1), (0, 1)):
            rows.append(index)
            columns.append(wall.first_cell + (ia + da) * wall.shape[1] + ib + db)
            weights.append((wa if da else 1 - wa) * (wb if db else 1 - wb))
    data = (np.concatenate(weights).astype(np.float32), (np.concatenate(rows), np.concatenate(columns)))
    return csr_array(data, shape=(flat_wall.size, len(room.reflectance)))


def _bracket(points_m: FloatArray, wall: Wall, c: int) -> tuple[IntArray, FloatArray]:
    centres = wall.centres_m[c]
    position = (points_m[:, wall.axes[c]] - centres[0]) / (centres[1] - centres[0])
    position = np.clip(position, 0, len(centres) - 1)
    lower = np.minimum(position.astype(np.int64), len(centres) - 2)
    return lower, position - lower
