"""How soon does Ctrl-C end a long computation? Processes at work on large scenes get SIGINT at random moments.

    .venv/bin/python benchmarks/interrupts.py 5 0.5

Each process first says that it is at
work; what is measured goes from the signal to the end of the process, the end of the interpreter included. Seconds of
the wall are shown beside them: on a busy machine they are many times as long.
"""

import argparse
import random
import resource
import signal
import subprocess
import sys
import time

import psutil

START = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
import numpy as np
def again(work):
    print("at work", flush=True)
    try:
        while True:
            work()
    except KeyboardInterrupt:
        sys.exit(130)
"""
JOBS = {
    "closed form": """
from sim.scenes.gridded import paper_room
from sim.form_factors import form_factors
room = paper_room(0.08)
again(lambda: form_factors(room))
""",
    "polygons": """
from sim.scenes.cluttered import corner_with_ball
from sim.form_factors import form_factors
ball = corner_with_ball(6000)
again(lambda: form_factors(ball, method="polygon", visibility="none"))
""",
    "exact occlusion": """
from sim.scenes.cluttered import corner_with_ball
from sim.form_factors import form_factors
ball = corner_with_ball(2144)
again(lambda: form_factors(ball, method="polygon", visibility="exact"))
""",
    "compressed": """
from sim.scenes.gridded import furnished_room
from sim.form_factors.compressed import compressed_form_factors
room = furnished_room(0.05, 0.7)
again(lambda: compressed_form_factors(room, 1e-3))
""",
    "rays": """
from sim.scenes.cluttered import corner_with_ball
from sim.light.sampled_light import sampled_light
ball = corner_with_ball(20_000)
again(lambda: sampled_light(ball, ball.reflectance, ball.reflectance, error=0.002))
""",
    "plan and solution": """
from sim.scenes.cluttered import random_corner
from sim.planning.plan import plan
from sim.planning.simulation import simulate
def work():
    corner = random_corner(2, 5000)
    made = plan(corner, 1.0, "uniform")
    simulate(made.cells, made.light, made.model)
again(work)
""",
    "lobes": """
from sim.light.lighting import make_test_lighting
from sim.geometry.adaptive_patches import coarsest_patches
from sim.light.gloss.material import Gloss
from sim.planning.gloss import glossy_simulation
from sim.planning.simulation import Model, simulate
from sim.scenes.cluttered import corner_with_ball
cells = coarsest_patches(corner_with_ball(20_000))
light = make_test_lighting("uniform", cells)
matte = simulate(cells, light, Model(method="rays", visibility="rays", residual=1e-5, sampling=0.02))
again(lambda: glossy_simulation(matte, light, Gloss.of(cells, 0.1, 0.3)))
""",
    "trees": """
from sim import _kernel
from sim.scenes.cluttered import corner_with_ball
corners = np.ascontiguousarray(corner_with_ball(100_000).vertices)
corners = np.concatenate([corners + k * 1e-3 for k in range(10)])
again(lambda: _kernel.RayTree(corners))
""",
    "pictures": """
import sim
from sim.light.transport_of_scene import area_emission
from sim.scenes.cluttered import corner_with_ball
ball = corner_with_ball(20_000)
lens = sim.Lens.from_horizontal_field_of_view(1920, 1200, 60.0)
pose = sim.Pose.look_at((1.9, 1.9, 1.5), (0.5, 0.5, 0.5))
again(lambda: area_emission(ball, lens, pose, subsamples=4, convention="physical"))
""",
    "simplification": """
from sim.geometry.mending.mend import facets_of
from sim.geometry.mending.simplification import simplified
from sim.scenes.cluttered import corner_with_ball
ball = corner_with_ball(300_000)
points, numbers = np.unique(ball.vertices[:, :3].reshape(-1, 3), axis=0, return_inverse=True)
facets = facets_of(points, numbers.reshape(-1, 3), ball.reflectance)
again(lambda: simplified(facets, 6000))
""",
}
LONGEST_WORK_S = 3.0
"""Before the signal; jobs go on until it comes."""


def children_s() -> float:
    """Processor time of processes that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def seconds_to_end(name: str, wait_s: float) -> tuple[float, float]:
    """Start a job, interrupt it after some seconds, and return what it still took: of a processor, by the wall [s]."""
    ended_s = children_s()
    process = subprocess.Popen(
        [sys.executable, "-c", START + JOBS[name]], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    if process.stdout is None or process.stdout.readline() != "at work\n":
        raise RuntimeError(f"{name} did not start: {process.communicate()[1]}")
    try:
        raise RuntimeError(f"{name} ended by itself: {process.communicate(timeout=wait_s)[1]}")
    except subprocess.TimeoutExpired:
        pass
    before, started = psutil.Process(process.pid).cpu_times(), time.perf_counter()
    process.send_signal(signal.SIGINT)
    try:
        error = process.communicate(timeout=60)[1]
    finally:
        process.kill()
    if process.returncode != 130:
        raise RuntimeError(f"{name} ended with {process.returncode}: {error}")
    wall_s = time.perf_counter() - started
    return max(children_s() - ended_s - before.user - before.system, 0.0), wall_s


def main(times: int, most_s: float, names: list[str]) -> int:
    """Print a table; 1 where a job took longer than allowed."""
    rng = random.Random(0)
    slowest = 0.0
    print("| job | processor seconds to the end | slowest | slowest by the wall |\n|---|---|---|---|")
    for name in names or list(JOBS):
        taken = [seconds_to_end(name, rng.uniform(0.0, LONGEST_WORK_S)) for _ in range(times)]
        used_s, wall_s = zip(*taken, strict=True)
        slowest = max(slowest, *used_s)
        print(
            f"| {name} | {' '.join(f'{s:.2f}' for s in used_s)} | {max(used_s):.2f} | {max(wall_s):.2f} |", flush=True
        )
    return 0 if slowest <= most_s else 1


def parsed() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("times", type=int, help="of each job")
    parser.add_argument("most_s", type=float, help="of processor time that none may take")
    parser.add_argument("jobs", nargs="*", help=f"of {', '.join(JOBS)}: all")
    return parser.parse_args()


if __name__ == "__main__":
    given = parsed()
    sys.exit(main(given.times, given.most_s, given.jobs))
