"""Does a plan by rays keep its tolerance? Random corners, 500 facets and more, against solutions on their sixteenths.

    .venv/bin/python benchmarks/mesh_honesty.py 30 3 500 3000

Arguments: scenes, tolerance [% of white], fewest and most facets. Seconds are of plan and of solution.
"""

import sys
import time

import numpy as np

from sim.planning.check import refined_check
from sim.planning.plan import plan
from sim.planning.simulation import simulate
from sim.scenes.cluttered import random_corner


def main(scenes: int, tolerance: float, fewest: int, most: int) -> int:
    print("| scene | facets | patches | error estimated | actual | plan s | solution s |")
    print("|---|---|---|---|---|---|---|")
    kept = 0
    for seed, facets in enumerate(np.geomspace(fewest, most, scenes).astype(int)):
        scene = random_corner(seed, int(facets))
        started = time.perf_counter()
        made = plan(scene, tolerance, "uniform")
        planned = time.perf_counter()
        simulation = simulate(made.cells, made.light, made.model)
        solved = time.perf_counter()
        actual = 100 * refined_check(simulation, made.light, made.model, 16 * made.patches).rms
        kept += actual <= tolerance
        print(
            f"| {scene.name} | {scene.n_patches} | {made.patches} | {made.error_percent:.2f} | {actual:.2f} "
            f"| {planned - started:.2f} | {solved - planned:.2f} |",
            flush=True,
        )
    print(f"\n{kept} of {scenes} within {tolerance:g} %")
    return 0 if kept == scenes else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])))
