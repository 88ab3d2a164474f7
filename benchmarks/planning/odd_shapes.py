"""Simulations of shapes that nothing was tuned to: tunnel, stairs, gear, maze, pillars, blobs, louvre, books, terrain.

    python benchmarks/planning/odd_shapes.py 3 1
    python benchmarks/planning/odd_shapes.py 0.3 --light floor --only pillars maze

Arguments: tolerances [% of white]. Each shape is written as a mesh file and goes the way of `rig simulate --check`: its
facets are judged, planned, simulated, and held against a refined solution. A line each: patches, the error that
is expected and the actual one, seconds of plan and solution. Exit status 1 where one is further off than its tolerance,
or is refused. Some pillars, and all blobs, pass through each other; pillars stand on the floor, without its being cut.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.offline.simulate import SimulationRequest, plan_simulation, run_planned
from rig.terminal import silent

FloatArray = NDArray[np.float64]
Polygons = list[FloatArray]


def prism(outline: Sequence[Sequence[float]], height_m: float) -> Polygons:
    """A room over a floor, counter-clockwise from above, seen from inside."""
    low = np.column_stack([np.array(outline, dtype=float), np.zeros(len(outline))])
    high = low + np.array([0, 0, height_m])
    walls = [np.array([low[k - 1], high[k - 1], high[k], low[k]]) for k in range(len(low))]
    return [low, high[::-1], *walls]


def room(x: float, y: float, z: float) -> Polygons:
    return prism([(0, 0), (x, 0), (x, y), (0, y)], z)


def turned(polygons: Polygons) -> Polygons:
    """The same, seen from outside."""
    return [polygon[::-1] for polygon in polygons]


def block(at: Sequence[float], size: Sequence[float]) -> Polygons:
    return [polygon + np.array(at) for polygon in turned(room(*size))]


def ring(radius_m: float, corners: int) -> list[tuple[float, float]]:
    turns = 2 * np.pi * np.arange(corners) / corners
    return [(radius_m * np.cos(turn), radius_m * np.sin(turn)) for turn in turns]


def swept(points: FloatArray) -> Polygons:
    """Quads of a grid of points, closed along its first axis."""
    after = np.roll(points, -1, axis=0)
    corners = np.stack([points[:, :-1], after[:, :-1], after[:, 1:], points[:, 1:]], axis=2)
    return list(corners.reshape(-1, 4, 3))


def ball(middle: Sequence[float], radius_m: float) -> Polygons:
    turn, height = np.meshgrid(2 * np.pi * np.arange(16) / 16, np.linspace(-1.4, 1.4, 9), indexing="ij")
    rim = np.cos(height)
    points = radius_m * np.stack([rim * np.cos(turn), rim * np.sin(turn), np.sin(height)], axis=2)
    caps = [points[::-1, 0], points[:, -1]]
    return [polygon + np.array(middle) for polygon in [*swept(points), *caps]]


def pillars() -> Polygons:
    things = room(5, 5, 3)
    for k in range(30):
        away = 0.3 + 0.06 * k
        at = np.array([2.5 + away * np.cos(0.5 * k), 2.5 + away * np.sin(0.5 * k), 0.0])
        things += [polygon + at for polygon in turned(prism(ring(0.1, 12), 1.5))]
    return things


def blobs() -> Polygons:
    random, things = np.random.default_rng(3), room(4, 4, 3)
    for _ in range(12):
        things += ball(random.uniform([1, 1, 0.7], [3, 3, 2.1]), float(random.uniform(0.15, 0.4)))
    return things


def maze() -> Polygons:
    random, things = np.random.default_rng(3), room(8, 8, 2.5)
    for i, j in np.argwhere(random.random((5, 5)) < 0.6):
        things += block((1 + 1.4 * i, 1 + 1.4 * j, 0.2), (0.5, 1.2, 2.1))
    return things


def stairs() -> Polygons:
    steps = [point for k in range(10) for point in ((0.3 * k + 0.3, 0.2 * k), (0.3 * k + 0.3, 0.2 * k + 0.2))]
    return prism([(0, 0), *steps, (5, 2), (5, 5), (0, 5)], 2.0)


def gear() -> Polygons:
    return prism([(x * (1 if k % 2 else 0.6), y * (1 if k % 2 else 0.6)) for k, (x, y) in enumerate(ring(2, 60))], 1.5)


def louvre() -> Polygons:
    sheet = np.array([[0.5, 1, 0.4], [2.5, 1, 0.4], [2.5, 1.15, 0.5], [0.5, 1.15, 0.5]])
    return room(3, 3, 3) + [sheet + np.array([0, 0, 0.1 * k]) for k in range(20)]


def books() -> Polygons:
    things = room(3, 3, 3)
    for k in range(25):
        things += block((0.5 + 0.06 * k, 2.6, 1.0), (0.02, 0.25, 0.3))
    return things


def torus() -> Polygons:
    turn, around = np.meshgrid(2 * np.pi * np.arange(32) / 32, np.linspace(0, 2 * np.pi, 17), indexing="ij")
    away = 2 + 0.7 * np.cos(around)
    points = np.stack([away * np.cos(turn), away * np.sin(turn), 0.7 * np.sin(around)], axis=2)
    return room(8, 8, 3) + [polygon + np.array([4, 4, 1.5]) for polygon in swept(points)]


def terrain() -> Polygons:
    x, y = np.meshgrid(np.linspace(0, 10, 40), np.linspace(0, 10, 40), indexing="ij")
    z = 0.8 * np.sin(x) * np.cos(1.3 * y) + 0.1 * np.random.default_rng(3).normal(size=x.shape)
    points = np.stack([x, y, z], axis=2)
    corners = [points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]]
    quads = np.stack(corners, axis=2).reshape(-1, 4, 3)
    return [quad[list(some)] for quad in quads for some in ((0, 1, 2), (0, 2, 3))]


SHAPES: dict[str, Callable[[], Polygons]] = {
    "tunnel": lambda: room(40, 2, 2),
    "stairs": stairs,
    "gear": gear,
    "maze": maze,
    "pillars": pillars,
    "blobs": blobs,
    "louvre": louvre,
    "books": books,
    "torus": torus,
    "terrain": terrain,
}


def written(polygons: Polygons, path: Path) -> Path:
    """Write polygons as they are, each with corners of its own."""
    lines, first = [], 1
    for polygon in polygons:
        lines += [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in polygon]
        lines.append("f " + " ".join(str(first + k) for k in range(len(polygon))))
        first += len(polygon)
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def row(name: str, path: Path, tolerance: float, light: str) -> tuple[str, bool]:
    """Simulate one shape: a line of the table, and whether it is as near as was asked for."""
    request = SimulationRequest(scene=str(path), tolerance=tolerance, light=light, reflectance=(0.6,))
    begun = time.perf_counter()
    try:
        planned, result = plan_simulation(request, silent)
        plan_s = time.perf_counter() - begun
        actual = run_planned(planned, silent, check=True)
    except UsageError as error:
        return f"| {name} | {tolerance:g} | {str(error)[:120]} | | | |", False
    off = actual.error if actual.error is not None else np.inf
    line = f"| {name} | {tolerance:g} | {result.plan.patches} | {result.estimated.error:.3g} | {off:.3g} "
    return line + f"| {plan_s:.2f} + {actual.seconds:.2f} |", off <= tolerance


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tolerances", type=float, nargs="+", metavar="PERCENT")
    parser.add_argument("--light", default="uniform", choices=["uniform", "floor"])
    parser.add_argument("--only", nargs="+", choices=list(SHAPES), default=list(SHAPES))
    wanted = parser.parse_args()
    print("| shape | % | patches | expected | actual | plan + solution s |\n|---|---|---|---|---|---|")
    good = []
    with tempfile.TemporaryDirectory() as folder:
        for name in wanted.only:
            path = written(SHAPES[name](), Path(folder) / f"{name}.obj")
            for tolerance in wanted.tolerances:
                line, is_near = row(name, path, tolerance, wanted.light)
                print(line, flush=True)
                good.append(is_near)
    print(f"\n{sum(good)} of {len(good)} within their tolerance")
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
