"""Meshes that are hard to hit: closed furnaces, whose light is known.

Of slivers, covered twice, with tiny gaps; and two rooms wall to wall, of which one is dark and is to stay so.

In a closed surface of reflectance rho in even light 1 the radiosity is rho / (1 - rho) everywhere: white with 1/2.
What rays lose between two facets, or behind one that another covers, is missing there.
"""

from __future__ import annotations

import time

import numpy as np

from rig.benchmark.records import Criterion, Point, Size
from sim.arrays import FloatArray
from sim.geometry.mesh import Mesh
from sim.light.sampled_light import sampled_light

REFLECTANCE = 0.5
ERROR = 0.01
"""Asked for; 1 = white."""
MOST_PERCENT = 0.1
"""Rms of what rays may lose at edges."""
STRIPS = {"quick": 100, "default": 1000, "full": 1000}
"""Of each wall of 1 m: triangles as many times as long as wide."""
GAP_M = 1e-6
GRID = 8


def hard_points(size: Size) -> list[Point]:
    """Measure the light of each hard furnace against the known one."""
    furnaces = _furnaces(STRIPS[size])
    points = [_measured(name, corners, np.ones(len(corners))) for name, corners in furnaces.items()]
    lit, dark = _cube(GRID, GRID), _cube(GRID - 1, GRID - 1) + np.array([1.0, 0.0, 0.0])
    return [
        *points,
        _measured("dark room beside", np.concatenate([lit, dark]), np.repeat([1.0, 0.0], [len(lit), len(dark)])),
    ]


def hard_bars(points: list[Point]) -> list[Criterion]:
    """Bars of :func:`hard_points`."""
    return [
        Criterion(
            what=f"{point.problem}, {point.n:,} facets: light lost, rms",
            value=point.error or 0.0,
            limit=MOST_PERCENT,
            unit="%",
        )
        for point in points
    ]


def _furnaces(strips: int) -> dict[str, FloatArray]:
    """(P, 4, 3) corners of each, lit inside [m]."""
    even = _cube(GRID, GRID)
    middle = even.mean(axis=1, keepdims=True)
    edge_m = 1 / GRID
    return {
        f"slivers 1:{strips}": _triangles(_cube(1, strips)),
        "covered twice": np.concatenate([even, _cube(GRID - 3, GRID - 1)]),
        f"gaps of {GAP_M:g} m": middle + (even - middle) * (1 - GAP_M / edge_m),
    }


def _cube(columns: int, rows: int) -> FloatArray:
    """(6 columns rows, 4, 3) corners of rectangles on the walls of a cube of 1 m, lit inside."""
    s, t = (grid.ravel() for grid in np.meshgrid(np.arange(columns) / columns, np.arange(rows) / rows))
    ds, dt = 1 / columns, 1 / rows
    uv = np.stack([np.stack(pair, axis=1) for pair in ((s, t), (s + ds, t), (s + ds, t + dt), (s, t + dt))], axis=1)
    walls = []
    for axis in range(3):
        low = np.insert(uv, 0, 0.0, axis=2)
        low = np.roll(low, axis, axis=2)
        high = low.copy()
        high[..., axis] = 1.0
        walls += [low, high[:, ::-1]]
    return np.concatenate(walls)


def _triangles(quads: FloatArray) -> FloatArray:
    return np.concatenate([quads[:, [0, 1, 2, 2]], quads[:, [0, 2, 3, 3]]])


def _measured(name: str, corners: FloatArray, lit: FloatArray) -> Point:
    """``lit``: (P,) 1 where even light falls on a facet, 0 in the dark; no facet sees both."""
    mesh = Mesh(name=name, vertices=corners, reflectance=np.full(len(corners), REFLECTANCE))
    started = time.perf_counter()
    light = sampled_light(mesh, lit * mesh.reflectance, mesh.reflectance, error=ERROR)
    seconds = time.perf_counter() - started
    lost = light.B - lit * REFLECTANCE / (1 - REFLECTANCE)
    return Point(
        problem=name,
        method="rays",
        n=mesh.n_patches,
        seconds=seconds,
        error=100 * float(np.sqrt((mesh.areas * lost**2).sum() / mesh.areas.sum())),
        error_of="% of white, rms",
        detail={
            "rays": float(light.sample.rays.mean()),
            "largest_error": 100 * float(np.abs(lost).max()),
            "row_sum_min": float(light.factors.row_sums.min()),
            "row_sum_max": float(light.factors.row_sums.max()),
            "threads": 1,
        },
    )
