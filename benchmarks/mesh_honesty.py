"""Does a plan by rays keep its tolerance? Random corners, 500 facets and more, against solutions on their sixteenths.

    .venv/bin/python benchmarks/mesh_honesty.py 30 3 500 3000
    .venv/bin/python benchmarks/mesh_honesty.py 30 3 500 3000 16 26    # of the thirty only these

Arguments: scenes, tolerance [% of white], fewest and most facets, and which scenes. Seconds are processor time of plan
and of solution.
"""

import sys
import time

import numpy as np

from sim.planning.check import refined_check
from sim.planning.plan import plan
from sim.planning.simulation import simulate
from sim.scenes.cluttered import random_corner


def main(scenes: int, tolerance: float, fewest: int, most: int, *only: int) -> int:
    print("| scene | facets | patches | error estimated | actual | plan s | solution s |")
    print("|---|---|---|---|---|---|---|")
    kept = 0
    for seed, facets in enumerate(np.geomspace(fewest, most, scenes).astype(int)):
        if only and seed not in only:
            continue
        scene = random_corner(seed, int(facets))
        started = time.process_time()
        made = plan(scene, tolerance, "uniform")
        planned = time.process_time()
        simulation = simulate(made.cells, made.light, made.model)
        solved = time.process_time()
        actual = 100 * refined_check(simulation, made.light, made.model, 16 * made.patches).rms
        kept += actual <= tolerance
        print(
            f"| {scene.name} | {scene.n_patches} | {made.patches} | {made.error_percent:.2f} | {actual:.2f} "
            f"| {planned - started:.2f} | {solved - planned:.2f} |",
            flush=True,
        )
    asked = len(only) or scenes
    print(f"\n{kept} of {asked} within {tolerance:g} %")
    return 0 if kept == asked else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), float(sys.argv[2]), *map(int, sys.argv[3:])))
