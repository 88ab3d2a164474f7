"""Run one bench by name; what it found as one JSON-able answer, and as a table of points for spreadsheets."""

from __future__ import annotations

import csv
import io
import os
import platform
import time
import warnings
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path

import numpy as np

from rig.benchmark import peers
from rig.benchmark.records import BenchmarkMachine, BenchResult, Outcome, Point, Size
from rig.errors import UsageError
from rig.files.atomic import write_bytes
from rig.records import Json
from rig.stages.error_tree import one_error_tree
from rig.terminal import OnStep, silent
from sim.form_factors.factors import ClosureWarning
from sim.threads import threads

BENCHES: Mapping[str, str] = {
    name: name.replace("-", "_")
    for name in ("form-factors", "solve", "image", "plan", "compensate", "live", "decode", "meshes")
}
"""The module of `benches` that each bench is in: none is loaded before it is asked for."""
COLUMNS = ("problem", "method", "n", "tolerance", "seconds", "error", "peak_mb", "error_of")


def run_bench(name: str, size: Size = "default", table: Path | None = None, on_step: OnStep = silent) -> BenchResult:
    """Measure, hold against the criteria, describe.

    Parameters
    ----------
    name : str
        A key of ``BENCHES``.
    size : {"quick", "default", "full"}
        Seconds for tests; about a minute; as long as it takes.
    table : Path, optional
        CSV file to write the points to.
    on_step : callable (label, done, total)

    Returns
    -------
    BenchResult

    Raises
    ------
    UsageError
        For an unknown name.
    """
    if name not in BENCHES:
        raise UsageError(f"unknown bench {name!r}; there are {', '.join(BENCHES)}")
    started = time.perf_counter()
    with one_error_tree(), warnings.catch_warnings():
        # Benches do on purpose what form factors warn of, and print the defect beside the rest.
        warnings.simplefilter("ignore", ClosureWarning)
        outcome: Outcome = import_module(f"rig.benchmark.benches.{BENCHES[name]}").run(size, on_step)
    if table is not None:
        write_bytes(table, _csv(outcome.points).encode())
    return BenchResult(
        bench=name,
        size=size,
        points=outcome.points,
        criteria=outcome.criteria,
        notes=outcome.notes,
        peers=peers.versions(),
        machine=machine(),
        within_limits=outcome.accurate,
        elapsed_s=time.perf_counter() - started,
    )


def machine() -> BenchmarkMachine:
    """Return what seconds are measured on here."""
    return BenchmarkMachine(
        processor=_processor(),
        processors=os.cpu_count() or 1,
        threads=threads(),
        system=f"{platform.system()} {platform.machine()}",
        python=platform.python_version(),
        numpy=np.__version__,
    )


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.is_file():
        for line in information.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown"


def _csv(points: Sequence[Point]) -> str:
    """One line a point; the columns that all have, then the further ones by name."""
    rows = [point.as_json() for point in points]
    further = sorted({key for row in rows for key in row} - set(COLUMNS))
    text = io.StringIO()
    writer = csv.DictWriter(text, [*COLUMNS, *further], restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _cell(value) for key, value in row.items()} for row in rows)
    return text.getvalue()


def _cell(value: Json) -> Json:
    return f"{value:.6g}" if isinstance(value, float) else "" if value is None else value
