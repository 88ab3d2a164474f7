"""Does a plan on a simplified mesh keep its tolerance on all facets? Random corners, against solutions on every facet.

    .venv/bin/python benchmarks/simplified_honesty.py 6 3 30000

The reference has form factors by rays on all facets, to a
fifth of the tolerance, with rays of its own. Meshes are simplified here whatever their number of facets.
"""

import argparse
import sys
import time

import numpy as np

import sim.planning.simplified_plan as under_test
from sim.geometry.adaptive_patches import coarsest_patches
from sim.geometry.mending.mend import cleaned_facets, facets_of, mended, oriented_facets
from sim.geometry.mending.remarks import Facets
from sim.geometry.mending.simplification import TracedPoints
from sim.geometry.mending.tracing import Tracing
from sim.planning.plan import plan
from sim.planning.simulation import Model, simulate
from sim.scenes.cluttered import corner_with_ball, random_corner

LIGHT = "uniform"


def triangles_of(vertices: np.ndarray) -> np.ndarray:
    quads = (vertices[:, 2] != vertices[:, 3]).any(axis=1)
    return np.concatenate([vertices[:, :3], vertices[quads][:, [0, 2, 3]]])


def carried(facets: Facets, values: np.ndarray, points: TracedPoints) -> np.ndarray:
    return values[Tracing.of(facets).nearest_along(points.places, points.normals)[0]]


def actual_error(original: Facets, made: under_test.SimplifiedPlan, error: float) -> float:
    """RMS over the surface of the radiosity between surfaces; 1 = white."""
    points = TracedPoints.of(original)
    model = Model(method="rays", visibility="rays", residual=1e-5, sampling=error, seed=77)
    solutions = []
    for cells, its_model in ((made.plan.cells, made.plan.model), (coarsest_patches(reference_mesh(original)), model)):
        solved = simulate(cells, made.plan.light, its_model)
        corners = triangles_of(cells.vertices)
        quads = np.flatnonzero((cells.vertices[:, 2] != cells.vertices[:, 3]).any(axis=1))
        light = (solved.reflectance * solved.irradiance)[np.concatenate([np.arange(cells.n_patches), quads]), 0]
        numbers = np.arange(3 * len(corners)).reshape(-1, 3)
        facets = facets_of(corners.reshape(-1, 3), numbers, np.array(0.5))
        solutions.append(carried(facets, light, points))
    return float(np.sqrt(((solutions[0] - solutions[1]) ** 2).mean()))


def reference_mesh(original: Facets):
    return mended("reference", original, sides="file").mesh


def main(scenes: int, tolerance: float, facets: int, first: int) -> int:
    under_test.PLANNED_AS_THEY_ARE = under_test.COARSEST = facets // 16
    print("| scene | facets | simplified to | patches | error estimated | actual | s |")
    print("|---|---|---|---|---|---|---|")
    kept = 0
    for seed in range(first, first + scenes):
        scene = corner_with_ball(facets) if seed == 0 else random_corner(seed, facets)
        corners = triangles_of(scene.vertices)
        soup = facets_of(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), np.array(0.6))
        original = oriented_facets(scene.name, cleaned_facets(scene.name, soup)[0], "judged")
        started = time.process_time()
        made = under_test.SimplifyingPlanner(
            original=original,
            oriented=lambda some: some,
            mend=lambda some: mended("simpler", some),
            make_plan=lambda mesh, percent: plan(mesh.mesh, percent, LIGHT, by_rays=mesh.by_rays),
        ).plan(tolerance)
        seconds = time.process_time() - started
        actual = 100 * actual_error(original, made, tolerance / 500)
        kept += actual <= tolerance
        print(
            f"| {scene.name} | {original.n_facets} | {made.mesh.mesh.n_patches} | {made.plan.patches} "
            f"| {made.plan.error_percent:.2f} | {actual:.2f} | {seconds:.2f} |",
            flush=True,
        )
    print(f"\n{kept} of {scenes} within {tolerance:g} %")
    return 0 if kept == scenes else 1


def parsed() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", type=int, help="how many")
    parser.add_argument("tolerance", type=float, help="[%% of white]")
    parser.add_argument("facets", type=int, help="of each")
    parser.add_argument("--seed", type=int, default=0, help="of the first: 0, the corner with a ball")
    return parser.parse_args()


if __name__ == "__main__":
    given = parsed()
    sys.exit(main(given.scenes, given.tolerance, given.facets, given.seed))
