"""Furnished rooms of up to 100,000 patches: python benchmarks/hundred_thousand.py [PATCHES ...] [--finer N] [--csv].

A projector lights a wall and a part of the floor; white is the light leaving a lit patch. Each size runs in a
process of its own, so that its peak memory is its own. Two errors are told in % of white: ``rows`` is what the
radiosity lacks of the balance B = E + rho F B in 200 whole rows evaluated again several times finer; ``finer``, for
sizes up to N, is its difference from the radiosity of a matrix of a tenth of the tolerance. The growth is the
slope of log time and log memory from the first size to the last.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress

from sim.arrays import FloatArray
from sim.form_factors.compressed import CompressedFormFactors, compressed_form_factors, exact_rows
from sim.geometry.scene import Scene
from sim.light.radiosity import Radiosity
from sim.scenes.gridded import furnished_room

Row = dict[str, float]
SIZES = (12_500, 25_000, 50_000, 100_000)
TOTAL_AREA_M2 = 111.55
REFLECTANCE = 0.7
CSV_FILE = Path(__file__).parents[1] / "docs" / "benchmarks" / "hundred_thousand.csv"


def scene_of(patches: int) -> Scene:
    """Build the furnished room with about so many patches, at least."""
    patch_size_m = math.sqrt(TOTAL_AREA_M2 / patches)
    while (scene := furnished_room(patch_size_m, REFLECTANCE)).n_patches < patches:
        patch_size_m *= 0.998
    return scene


def light_of(scene: Scene) -> FloatArray:
    """White on the middle of the wall x1 and on a part of the floor."""
    x, y, z = scene.centres.T
    on_wall = (x > 4.799) & (abs(y - 2.4) < 1.5) & (abs(z - 1.2) < 0.8)
    return np.where(on_wall | ((z < 1e-3) & (abs(x - 0.8) < 0.5) & (abs(y - 1.0) < 0.5)), 1.0, 0.0)


def built(scene: Scene, tolerance: float) -> CompressedFormFactors:
    """Compress, with a bar of progress on the error stream."""
    with Progress(console=Console(stderr=True), transient=True) as progress:
        bar = progress.add_task(f"{scene.n_patches} patches, tolerance {tolerance:g}", total=1.0)
        return compressed_form_factors(scene, tolerance, lambda done: progress.update(bar, completed=done))


def cpu_seconds() -> float:
    """User time of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_utime


def measure(patches: int, tolerance: float, finer: bool) -> Row:
    """Build, solve and check one size."""
    scene = scene_of(patches)
    E = light_of(scene)
    before = cpu_seconds()
    factors = built(scene, tolerance)
    after, started = cpu_seconds(), time.perf_counter()
    solution = Radiosity(factors, scene.reflectance, tolerance=1e-8).solution(E)
    seconds_solve = time.perf_counter() - started
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024e-6
    rows = np.random.default_rng(1).choice(scene.n_patches, 200, replace=False)
    lack = E[rows] + REFLECTANCE * exact_rows(factors, rows, solution.B[:, None])[:, 0] - solution.B[rows]
    row = {
        "patches": scene.n_patches,
        "tolerance": tolerance,
        "seconds_build": factors.seconds_build,
        "seconds_check": factors.seconds - factors.seconds_build,
        "cpu_seconds_build_and_check": after - before,
        "seconds_solve": seconds_solve,
        "iterations": solution.iterations,
        "stored_mb": factors.stored_mb,
        "peak_mb": peak_mb,
        "product_error_max": factors.error.max,
        "product_error_rms": factors.error.rms,
        "rows_max_percent_of_white": 100 * float(np.abs(lack).max()),
        "rows_rms_percent_of_white": 100 * float(np.sqrt((lack**2).mean())),
        "row_sum_excess": factors.closure_max,
    }
    return row | (against_finer(scene, solution.B, tolerance) if finer else {})


def against_finer(scene: Scene, B: FloatArray, tolerance: float) -> Row:
    """Compare with the radiosity of a tenth of the tolerance."""
    exact = Radiosity(built(scene, tolerance / 10), scene.reflectance, tolerance=1e-8).solve(light_of(scene))
    difference = B - exact
    return {
        "finer_max_percent_of_white": 100 * float(np.abs(difference).max()),
        "finer_rms_percent_of_white": 100 * float(np.sqrt((difference**2).mean())),
    }


def growth(rows: list[Row]) -> Row:
    """Exponents of the number of patches, from the first size to the last."""
    first, last = rows[0], rows[-1]
    ratio = math.log(last["patches"] / first["patches"])
    keys = ("seconds_build", "cpu_seconds_build_and_check", "stored_mb", "peak_mb")
    return {key: math.log(last[key] / first[key]) / ratio for key in keys}


def measured_alone(patches: int, tolerance: float, finer: bool) -> Row:
    """Measure in a new process."""
    command = [sys.executable, __file__, str(patches), "--tolerance", str(tolerance), "--alone"]
    done = subprocess.run(command + ["--finer", str(patches)] * finer, stdout=subprocess.PIPE, check=True, text=True)
    row: Row = json.loads(done.stdout)
    return row


def main() -> None:
    """Measure the sizes asked for; print a table and the growth."""
    parser = argparse.ArgumentParser(description="Furnished rooms of up to 100,000 patches.")
    parser.add_argument("patches", type=int, nargs="*", default=SIZES)
    parser.add_argument("--tolerance", type=float, default=1e-3)
    parser.add_argument("--finer", type=int, default=0, metavar="N", help="check up to N patches with a finer matrix")
    parser.add_argument("--csv", action="store_true", help="write docs/benchmarks/hundred_thousand.csv")
    parser.add_argument("--alone", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.alone:
        print(json.dumps(measure(asked.patches[0], asked.tolerance, asked.finer > 0)))
        return
    rows = []
    for patches in asked.patches:
        rows.append(measured_alone(patches, asked.tolerance, patches <= asked.finer))
        print(", ".join(f"{key} {value:.4g}" for key, value in rows[-1].items()), flush=True)
    if len(rows) > 1:
        print("growth:", ", ".join(f"{key} N^{value:.2f}" for key, value in growth(rows).items()))
    if asked.csv:
        CSV_FILE.parent.mkdir(parents=True, exist_ok=True)
        with CSV_FILE.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, fieldnames=list(dict.fromkeys(key for row in rows for key in row)))
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
