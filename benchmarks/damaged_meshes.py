"""Damaged meshes: does each get an answer, in time, with no light created, that says what was wrong?

    .venv/bin/python benchmarks/damaged_meshes.py 100

The generator is that of the tests. Seconds are processor time.
"""

import argparse
import resource
import sys
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.sim.geometry.mending.answers import answer_to
from tests.sim.geometry.mending.damaged_meshes import damaged

LONGEST_S = 60.0


def main(count: int, first: int) -> int:
    print("| seed | mesh | facets | answer | kinds | share of the bound | s | faults |")
    print("|---|---|---|---|---|---|---|---|")
    outcomes: Counter[str] = Counter()
    for seed in range(first, first + count):
        mesh, started = damaged(seed), time.process_time()
        answer = answer_to(mesh, tolerance_percent=5.0)
        seconds = time.process_time() - started
        faults = [*answer.faults, *(["too slow"] if seconds > LONGEST_S else [])]
        outcomes["fault" if faults else answer.outcome] += 1
        print(
            f"| {seed} | {mesh.name} | {len(mesh.triangles)} | {answer.outcome} | {', '.join(sorted(answer.kinds))} "
            f"| {answer.light_share:.4f} | {seconds:.2f} | {' '.join(faults).splitlines()[:1]} |",
            flush=True,
        )
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(f"\n{dict(outcomes)}, peak {peak_mb:.0f} MB")
    return 1 if outcomes["fault"] else 0


def parsed() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int, help="how many")
    parser.add_argument("first", type=int, nargs="?", default=0, help="seed of the first: 0")
    return parser.parse_args()


if __name__ == "__main__":
    given = parsed()
    sys.exit(main(given.count, given.first))
