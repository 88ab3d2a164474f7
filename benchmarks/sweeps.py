"""What a sweep costs beside a bare loop, what a second worker is worth, and whether kills and clusters change anything.

    python benchmarks/sweeps.py [--points 1000] [--parts speed kills cluster list]

One point: 576 patches, pictures of 160 x 120, four strategies. "speed" compares the processor time of a bare loop with
that of all processes of a sweep (start of the workers apart: it is the same for any number of points), and the time
that passes on one worker and on two; on a machine that does something else only processor time means anything.
"kills" ends a worker by signal at ten random moments. "cluster" starts a Dask cluster of two workers here and compares
every bit. "list" writes 100,000 finished points and starts `rig sweep` on them.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before NumPy loads: the bare loop has what a worker has

from rig.sweeps.design import settings_of  # noqa: E402
from rig.sweeps.executors import ExecutorChoice  # noqa: E402
from rig.sweeps.folder import POINTS, read_lines, sealed  # noqa: E402
from rig.sweeps.records import SweepResult  # noqa: E402
from rig.sweeps.run import SweepRequest, run_sweep  # noqa: E402
from rig.sweeps.study import read_study  # noqa: E402
from rig.sweeps.subjects import subject_of  # noqa: E402

STUDY = """
schema = 1
subject = "paper"
[fixed]
strategies = ["none", "paper", "exact", "bounded"]
[grid]
reflectance = [0.3, 0.5, 0.7, 0.9]
photograph = ["outdoor", "indoor"]
[latin_hypercube]
points = {samples}
[latin_hypercube.ranges]
x_m = [0.4, 2.0]
y_m = [0.4, 2.0]
hfov_deg = [80.0, 115.0]
"""
PLACES = 8
"""Of the grid: points of each sample."""
LISTED = 100_000


def own_s() -> float:
    return time.process_time()


def children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def figures_of(folder: Path) -> dict[str, dict[str, object]]:
    return {line.id: dict(line.figures) for line in read_lines(folder)}


def swept(study: Path, folder: Path, **where: object) -> SweepResult:
    result = run_sweep(SweepRequest(study=study, folder=folder, where=ExecutorChoice(**where)))
    for process in multiprocessing.active_children():
        process.join()  # their processor time is known when they have ended
    return result


def bare_loop(study: Path) -> tuple[float, float]:
    """(processor seconds, seconds that passed) of all points, without anything around them."""
    subject = subject_of("paper")
    points = [subject.complete(settings, None) for settings in settings_of(read_study(study))]
    subject.evaluate(points[0], None)  # what each process loads once
    started_s, passed_s = own_s(), time.perf_counter()
    for point in points:
        subject.evaluate(point, None)
    return own_s() - started_s, time.perf_counter() - passed_s


def speed(study: Path, folder: Path) -> None:
    bare_s, bare_passed_s = bare_loop(study)
    print(f"bare loop: {bare_s:.1f} s of processor time, {bare_passed_s:.1f} s passed")
    passed = {}
    for workers in (1, 2):
        one = study.with_name("one.toml")
        one.write_text(study.read_text().partition("[grid]")[0], encoding="utf-8")
        before = own_s(), children_s()
        swept(one, folder / f"start-{workers}", workers=workers)
        start_s = own_s() - before[0] + workers * (children_s() - before[1])
        before, begun_s = (own_s(), children_s()), time.perf_counter()
        swept(study, folder / f"workers-{workers}", workers=workers)
        passed[workers] = time.perf_counter() - begun_s
        time_of_all_s = own_s() - before[0] + children_s() - before[1]
        points_s = sum(line.seconds for line in read_lines(folder / f"workers-{workers}"))
        print(
            f"{workers} worker(s): {passed[workers]:.1f} s passed; {time_of_all_s:.1f} s of processor time, of it "
            f"{points_s:.1f} s in points and about {start_s:.1f} s to start and to draw: "
            f"overhead {100 * ((time_of_all_s - start_s) / points_s - 1):+.1f} % over the points, "
            f"{100 * ((time_of_all_s - start_s) / bare_s - 1):+.1f} % over the bare loop"
        )
    print(f"two workers: {passed[1] / passed[2]:.2f} x as fast as one, by the time that passed")
    same = figures_of(folder / "workers-1") == figures_of(folder / "workers-2")
    print(f"one worker and two: {'the same bits' if same else 'DIFFERENT BITS'}")


def kills(study: Path, folder: Path) -> None:
    ended, kept = threading.Event(), random.Random(1)
    count = 0

    def kill() -> None:
        nonlocal count
        while count < 10 and not ended.wait(kept.uniform(2.0, 6.0)):
            workers = multiprocessing.active_children()
            if workers:
                os.kill(kept.choice(workers).pid, signal.SIGKILL)
                count += 1

    killer = threading.Thread(target=kill)
    killer.start()
    result = swept(study, folder / "killed", workers=2)
    ended.set()
    killer.join()
    names = [line.id for line in read_lines(folder / "killed")]
    print(
        f"{count} kills: {len(names)} lines, {len(set(names))} points of {result.points}, "
        f"{result.killed} given up, {sum(line.tries > 1 for line in read_lines(folder / 'killed'))} tried again"
    )


@contextmanager
def dask_cluster(folder: Path) -> Iterator[str]:
    """Address of a scheduler with two workers."""
    address = "tcp://127.0.0.1:18917"
    command = [sys.executable, "-m"]
    started = [
        subprocess.Popen(
            [*command, "distributed.cli.dask_scheduler", "--port", "18917", "--no-dashboard"],
            cwd=folder,
            stderr=subprocess.DEVNULL,
        )
    ]
    time_out = time.monotonic() + 60
    worker = ["distributed.cli.dask_worker", address, "--nworkers", "2", "--nthreads", "1", "--no-dashboard"]
    started.append(subprocess.Popen([*command, *worker], cwd=folder, stderr=subprocess.DEVNULL))
    from distributed import Client

    with Client(address, timeout=60, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=max(time_out - time.monotonic(), 1))
    try:
        yield address
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait()


def cluster(study: Path, folder: Path) -> None:
    if not (folder / "workers-2").exists():
        swept(study, folder / "workers-2", workers=2)
    with dask_cluster(folder) as address:
        begun_s = time.perf_counter()
        swept(study, folder / "cluster", scheduler=address)
        print(f"Dask, two workers: {time.perf_counter() - begun_s:.1f} s passed")
    same = figures_of(folder / "workers-2") == figures_of(folder / "cluster")
    print(f"processes and the Dask cluster: {'the same bits' if same else 'DIFFERENT BITS'}")


def listed(study: Path, folder: Path) -> None:
    many = study.with_name("many.toml")
    many.write_text(STUDY.format(samples=LISTED // PLACES), encoding="utf-8")
    few = study.with_name("few.toml")
    few.write_text(STUDY.format(samples=1), encoding="utf-8")
    swept(few, folder / "few", workers=1)
    line = next(read_lines(folder / "few"))
    from rig.sweeps.records import point_id

    subject = subject_of("paper")
    draw = random.Random(1)
    target = folder / "many"
    target.mkdir()
    with (target / POINTS).open("wb") as file:
        for settings in settings_of(read_study(many)):
            inputs = subject.complete(settings, None)
            figures = {name: value * draw.uniform(0.5, 1.5) for name, value in line.figures.items()}
            changed = line.as_json() | {"inputs": inputs, "figures": figures}
            changed["id"] = point_id("paper", line.version, inputs)
            file.write(sealed(json.dumps(changed).encode()) + b"\n")
    for what in ("listed and plotted", "started again"):
        before, begun_s = children_s(), time.perf_counter()
        command = [sys.executable, "-m", "rig", "sweep", str(many), "--folder", str(target), "--json"]
        found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        print(
            f"{found['points']} finished points {what}, {found['computed_now']} computed: "
            f"{children_s() - before:.1f} s of processor time, {time.perf_counter() - begun_s:.1f} s passed"
        )


def again(study: Path, folder: Path) -> None:
    before, begun_s = children_s(), time.perf_counter()
    done = next((folder / name for name in ("workers-2", "killed") if (folder / name).exists()), None)
    if done is None:
        return
    subprocess.run(
        [sys.executable, "-m", "rig", "sweep", str(study), "--folder", str(done)], check=True, capture_output=True
    )
    print(
        f"second start on {len(figures_of(done))} points: {children_s() - before:.2f} s of processor time, "
        f"{time.perf_counter() - begun_s:.2f} s passed"
    )


PARTS = {"speed": speed, "kills": kills, "cluster": cluster, "list": listed}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=1000)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="sweeps-") as name:
        folder = Path(name)
        study = folder / "study.toml"
        study.write_text(STUDY.format(samples=max(given.points // PLACES, 1)), encoding="utf-8")
        for part in given.parts:
            PARTS[part](study, folder)
        again(study, folder)


if __name__ == "__main__":
    main()
