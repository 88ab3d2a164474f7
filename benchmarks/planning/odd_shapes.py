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
import trimesh
from numpy.typing import NDArray

from rig.devices.simulated.worlds.shapes import block, moved, quad, room, sheet
from rig.errors import UsageError
from rig.offline.simulate import SimulationRequest, plan_simulation, run_planned
from rig.terminal import silent

FloatArray = NDArray[np.float64]
TURN = 2 * np.pi


def box(x: float, y: float, z: float) -> list[FloatArray]:
    """Walls of a room, seen from inside."""
    return list(room((x, y, z)).values())


def prism(outline: Sequence[Sequence[float]], middle: Sequence[float], height_m: float) -> FloatArray:
    """A room over a floor, counter-clockwise from above, all corners of which a point on it sees; from inside."""
    near = np.column_stack([np.array(outline, dtype=float), np.zeros(len(outline))])
    far, up = np.roll(near, -1, axis=0), np.array([0, 0, height_m])
    centre = np.broadcast_to([*middle, 0.0], near.shape)
    corners = [
        (centre, near, far),
        (centre + up, far + up, near + up),
        (near, near + up, far),
        (far, near + up, far + up),
    ]
    return np.concatenate([np.stack(some, axis=1) for some in corners])


def ring(radius_m: FloatArray) -> list[tuple[float, float]]:
    """Corners around the origin, at as many distances."""
    turns = TURN * np.arange(len(radius_m)) / len(radius_m)
    return [(r * np.cos(turn), r * np.sin(turn)) for r, turn in zip(radius_m, turns, strict=True)]


def ball(radius_m: float) -> FloatArray:
    def place(turn: FloatArray, height: FloatArray) -> FloatArray:
        rim = np.cos(height)
        return radius_m * np.stack([rim * np.cos(turn), rim * np.sin(turn), np.sin(height)], axis=2)

    return sheet(place, np.linspace(0, TURN, 17), np.linspace(-np.pi / 2, np.pi / 2, 11))


def pillars() -> list[FloatArray]:
    pillar, things = prism(ring(np.full(12, 0.1)), (0, 0), 1.5)[:, ::-1], box(5, 5, 3)
    for k in range(30):
        away = 0.3 + 0.06 * k
        things.append(moved(pillar, (2.5 + away * np.cos(0.5 * k), 2.5 + away * np.sin(0.5 * k), 0.0)))
    return things


def blobs() -> list[FloatArray]:
    random, things = np.random.default_rng(3), box(4, 4, 3)
    for _ in range(12):
        x, y, z = random.uniform([1, 1, 0.7], [3, 3, 2.1])
        things.append(moved(ball(float(random.uniform(0.15, 0.4))), (x, y, z)))
    return things


def maze() -> list[FloatArray]:
    random, things = np.random.default_rng(3), box(8, 8, 2.5)
    for i, j in np.argwhere(random.random((5, 5)) < 0.6):
        things.append(block((1.25 + 1.4 * i, 1.6 + 1.4 * j), (0.5, 1.2, 2.1), bottom_m=0.2))
    return things


def stairs() -> list[FloatArray]:
    steps = [point for k in range(10) for point in ((0.3 * k + 0.3, 0.2 * k), (0.3 * k + 0.3, 0.2 * k + 0.2))]
    return [prism([(0, 0), *steps, (5, 2), (5, 5), (0, 5)], (0.1, 4.9), 2.0)]


def gear() -> list[FloatArray]:
    return [prism(ring(np.tile([1.2, 2.0], 30)), (0, 0), 1.5)]


def louvre() -> list[FloatArray]:
    return box(3, 3, 3) + [quad((0.5, 1, 0.4 + 0.1 * k), (2, 0, 0), (0, 0.15, 0.1)) for k in range(20)]


def books() -> list[FloatArray]:
    return box(3, 3, 3) + [block((0.51 + 0.06 * k, 2.725), (0.02, 0.25, 0.3), bottom_m=1.0) for k in range(25)]


def torus() -> list[FloatArray]:
    def place(turn: FloatArray, around: FloatArray) -> FloatArray:
        away = 2 + 0.7 * np.cos(around)
        return np.stack([away * np.cos(turn), away * np.sin(turn), 0.7 * np.sin(around)], axis=2)

    surface = sheet(place, np.linspace(0, TURN, 33), np.linspace(0, TURN, 17))
    return [*box(8, 8, 3), moved(surface, (4, 4, 1.5))]


def terrain() -> list[FloatArray]:
    rough = 0.1 * np.random.default_rng(3).normal(size=(40, 40))
    lines = np.linspace(0, 10, 40)
    return [sheet(lambda x, y: np.stack([x, y, 0.8 * np.sin(x) * np.cos(1.3 * y) + rough], axis=2), lines, lines)]


SHAPES: dict[str, Callable[[], list[FloatArray]]] = {
    "tunnel": lambda: box(40, 2, 2),
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
            path = Path(folder) / f"{name}.obj"
            corners = np.concatenate(SHAPES[name]()).reshape(-1, 3)
            trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False).export(path)
            for tolerance in wanted.tolerances:
                line, is_near = row(name, path, tolerance, wanted.light)
                print(line, flush=True)
                good.append(is_near)
    print(f"\n{sum(good)} of {len(good)} within their tolerance")
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
