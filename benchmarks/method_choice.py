"""Does the planner take the fastest method? Every scene by its own choice, and by each method whether it pays or not.

    .venv/bin/python benchmarks/method_choice.py 3 1
    .venv/bin/python benchmarks/method_choice.py 3 --scenes paper-room sphere

Arguments: tolerances [% of white]. Processor seconds of plan and solution on one core, the least of three turns of all
methods where they take less than 2 s: on a busy machine the same work takes up to half as long again. A method that
takes more than three times as long as the planner's choice, and at least 3 s, is ended there. Exit status 1 where the
choice takes more than twice as long as the best method.
"""

import argparse
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from unittest.mock import patch

from sim.errors import SimulationError
from sim.geometry.surface import Surface
from sim.planning import plan as planning
from sim.planning import search
from sim.planning.simulation import simulate
from sim.scenes.catalogue import SURFACES
from sim.scenes.cluttered import corner_with_ball, random_corner
from sim.threads import set_threads

NAMES = ("paper-room", "room-with-box", "sloped-room", "furnished-room", "sphere")
SCENES: dict[str, Callable[[], Surface]] = {
    **{name: SURFACES[name].build for name in NAMES},
    "corner-with-ball, 200": lambda: corner_with_ball(200),
    "corner-with-ball, 500": lambda: corner_with_ball(500),
    "corner-with-ball, 2144": corner_with_ball,
    "corner-with-ball, 20000": lambda: corner_with_ball(20_000),
    "random-corner-1, 500": lambda: random_corner(1, 500),
    "random-corner-2, 2000": lambda: random_corner(2, 2000),
}
METHODS = ("auto", "exact", "compressed", "rays")
WORST = 2.0
PATIENCE, LEAST_S = 3.0, 3.0
UNTOLD = 0.05
"""Seconds below which no method is told from another."""
TURNS, SHORT_S = 3, 2.0


@contextmanager
def ended_after(seconds: float) -> Iterator[None]:
    """Raise TimeoutError once so much processor time is used."""

    def end(_number: int, _frame: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def seconds_of(scene: Surface, method: str, tolerance: float) -> tuple[float, str]:
    """Plan and simulate, and return the processor time [s] and the method."""
    light = "uniform" if scene.name.startswith(("corner-with", "random")) else "floor"
    with ExitStack() as forced:
        if method in ("exact", "compressed"):
            forced.enter_context(patch.object(search, "rays_pay", lambda *_, **__: False))
            forced.enter_context(patch.object(search, "compressing_pays", lambda *_: method == "compressed"))
        started = time.process_time()
        made = planning.plan(scene, tolerance, light, by_rays=method == "rays")
        simulate(made.cells, made.light, made.model)
        used_s = time.process_time() - started
    return used_s, made.model.method if made.model.compression is None else "compressed"


def row(name: str, tolerance: float) -> float:
    """Print a scene's row and return the choice's time over the best one's."""
    taken, choice = dict.fromkeys(METHODS, float("inf")), ""
    for turn in range(TURNS):
        for method in METHODS:
            if turn and taken[method] > SHORT_S:
                continue
            limit_s = 600.0 if method == "auto" else max(LEAST_S, PATIENCE * min(taken["auto"], 200.0))
            try:
                with ended_after(limit_s):
                    seconds, used = seconds_of(SCENES[name](), method, tolerance)
            except (TimeoutError, SimulationError):
                continue
            taken[method] = min(taken[method], seconds)
            choice = used if method == "auto" else choice
        if taken["auto"] == float("inf"):
            print(f"| {name} | {tolerance:g} | refused | – | – | – | – | |", flush=True)
            return 0.0
    ratio = max(taken["auto"], UNTOLD) / max(min(taken.values()), UNTOLD)
    times = " | ".join("–" if taken[method] == float("inf") else f"{taken[method]:.2f}" for method in METHODS)
    print(f"| {name} | {tolerance:g} | {choice} | {times} | {ratio:.2f} |", flush=True)
    return ratio


def main() -> int:
    """Print a table; 1 where a choice is too slow."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tolerances", type=float, nargs="+", metavar="PERCENT")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES), metavar="NAME")
    wanted = parser.parse_args()
    set_threads(1)  # threads that wait for each other on a busy machine take processor time, too
    planning.plan(SCENES["paper-room"](), 5.0)
    print(f"| scene | % | choice | {' | '.join(f'{method} s' for method in METHODS)} | over the best |")
    print("|---|---|---|---|---|---|---|---|")
    worst = max(row(name, tolerance) for name in wanted.scenes for tolerance in wanted.tolerances)
    print(f"\nslowest choice: {worst:.2f} x the best")
    return 0 if worst <= WORST else 1


if __name__ == "__main__":
    sys.exit(main())
