"""Does a plan by rays keep its tolerance? Random corners, 500 facets and more, against solutions on their sixteenths.

    .venv/bin/python benchmarks/mesh_honesty.py 30 3 500 3000
    .venv/bin/python benchmarks/mesh_honesty.py 30 3 500 3000 16 26    # of the thirty only these
    .venv/bin/python benchmarks/mesh_honesty.py 30 3 500 3000 --seed 9000    # other corners

Seconds are processor time of plan and of solution.
"""

import argparse
import sys
import time
from collections.abc import Sequence

import numpy as np

from sim.planning.check import refined_check
from sim.planning.plan import plan
from sim.planning.simulation import simulate
from sim.scenes.cluttered import random_corner


def main(scenes: int, tolerance: float, facet_range: tuple[int, int], only: Sequence[int], seed: int) -> int:
    print("| scene | facets | patches | error estimated | actual | plan s | solution s |")
    print("|---|---|---|---|---|---|---|")
    kept = 0
    for number, facets in enumerate(np.geomspace(*facet_range, scenes).astype(int)):
        if only and number not in only:
            continue
        scene = random_corner(seed + number, int(facets))
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


def parsed() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", type=int, help="how many corners")
    parser.add_argument("tolerance", type=float, help="[%% of white]")
    parser.add_argument("fewest", type=int, help="facets")
    parser.add_argument("most", type=int, help="facets")
    parser.add_argument("only", type=int, nargs="*", help="numbers of scenes: all")
    parser.add_argument("--seed", type=int, default=0, help="of the first corner: 0")
    return parser.parse_args()


if __name__ == "__main__":
    given = parsed()
    sys.exit(main(given.scenes, given.tolerance, (given.fewest, given.most), given.only, given.seed))
