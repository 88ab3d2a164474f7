"""Is the planner honest? Each library scene at several tolerances: estimated and actual error, time and memory.

    python benchmarks/plan_honesty.py [TOLERANCE ...]

The actual error is measured against a solution on cells cut into 4 or 16. "honest" is tolerance / 10 <= actual
error <= tolerance; "fine" a scene that is better than that with its fewest patches.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from rig.offline.simulate import SimulationRequest, run_simulate
from rig.terminal import silent
from sim.scenes.catalogue import SURFACES

COLUMNS = "scene          tol %  patches  error est  actual    max   s est  actual   MB est  actual  verdict"


def verdict(error: float, tolerance: float) -> str:
    if error > tolerance:
        return "TOO COARSE"
    return "honest" if error >= tolerance / 10 else "fine"


def row(scene: str, tolerance: float) -> str:
    result = run_simulate(SimulationRequest(scene=scene, tolerance=tolerance), silent, check=True)
    estimated, actual = result.estimated, result.actual
    if actual is None or actual.error is None:
        raise RuntimeError(f"{scene}: was not simulated and checked")
    return (
        f"{scene:14} {tolerance:5.2f} {result.plan.patches:8d} {estimated.error:10.3f} {actual.error:7.3f} "
        f"{actual.error_max:6.2f} {estimated.seconds:7.3f} {actual.seconds:7.3f} {estimated.peak_mb:8.2f} "
        f"{actual.peak_mb:7.2f}  {verdict(actual.error, tolerance)}"
    )


def main(tolerances: Sequence[float]) -> None:
    print(COLUMNS)
    for scene in SURFACES:
        for tolerance in tolerances:
            print(row(scene, tolerance), flush=True)


def parsed() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "tolerances", type=float, nargs="*", default=[5.0, 2.0, 1.0, 0.5], help="[%% of white]: 5 2 1 0.5"
    )
    return parser.parse_args()


if __name__ == "__main__":
    main(parsed().tolerances)
