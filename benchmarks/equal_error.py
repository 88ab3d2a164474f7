"""Light by rays against the plain method with Embree and numpy: seconds of processor time to the same error, one core.

    python benchmarks/equal_error.py                  # corner with a ball, 2,144 facets
    python benchmarks/equal_error.py 2000 6000        # of about so many facets
    python benchmarks/equal_error.py 2000 --corners 1 2    # random corners of these seeds instead

Embree's trial sends 64, 256 and 1,024 rays a facet. Ours is solved to five tolerances around each of its errors, and
the time at the same error is read from a line through their logarithms. Both are held against a solution of very many
rays, in white light; times are the least of some runs. Needs the extra `peers`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from copy import copy
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rig.benchmark.benches import meshes
from sim.geometry.mesh import Mesh
from sim.light.sampled_light import sampled_light
from sim.scenes.cluttered import corner_with_ball, random_corner
from sim.threads import set_threads

FloatArray = NDArray[np.float64]
TRUE_ERROR = 4e-4
OTHER_SEED = 77
RAYS = (64, 256, 1024)
TIMES_THE_ERROR = np.geomspace(1.0, 1.9, 5)
"""Tolerances: estimates are a little above what the errors are."""


def least_s(work: Callable[[Mesh], FloatArray], scene: Mesh, runs: int) -> tuple[float, FloatArray]:
    """Return the least processor time of some runs, and the last result."""
    seconds = []
    for _ in range(runs):
        fresh = copy(scene)  # of which no tree and no rays are kept
        started = time.process_time()
        found = work(fresh)
        seconds.append(time.process_time() - started)
    return min(seconds), found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("facets", type=int, nargs="*", default=[2144])
    parser.add_argument("--corners", type=int, nargs="+", default=[], metavar="SEED")
    wanted = parser.parse_args()
    set_threads(1)
    for facets in wanted.facets:
        for scene in [random_corner(seed, facets) for seed in wanted.corners] or [corner_with_ball(facets)]:
            compare(scene)


def compare(scene: Mesh) -> None:
    """Print one line for each number of Embree's rays."""
    white = scene.reflectance

    def ours(fresh: Mesh, error: float) -> FloatArray:
        return sampled_light(fresh, white, white, error=error).B

    truth = meshes.MeshTruth(scene, sampled_light(scene, white, white, error=TRUE_ERROR, seed=OTHER_SEED).B)
    for rays in RAYS:
        peer_s, peer = least_s(partial(meshes.embree_radiosity, rays=rays), scene, 3)
        wanted = truth.error(peer)
        runs = [least_s(partial(ours, error=wanted / 100 * times), scene, 5) for times in TIMES_THE_ERROR]
        errors, seconds = np.log([truth.error(B) for _, B in runs]), np.log([s for s, _ in runs])
        own_s = float(np.exp(np.polyval(np.polyfit(errors, seconds, 1), np.log(wanted))))
        print(
            f"{scene.name}, {scene.n_patches} facets, {wanted:.3f} % of white: Embree with {rays} rays {peer_s:.3f} s, "
            f"ours {own_s:.3f} s, {peer_s / own_s:.2f} times as fast",
            flush=True,
        )


if __name__ == "__main__":
    main()
