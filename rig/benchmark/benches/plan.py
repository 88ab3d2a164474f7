"""``rig bench plan``: what the planner promises of each library scene, and what it keeps."""

from __future__ import annotations

import statistics
import time

from rig.benchmark.records import Criterion, Outcome, Point, Size
from rig.benchmark.timing import peak_mb
from rig.terminal import OnStep
from sim.planning.check import refined_check
from sim.planning.plan import Plan, plan
from sim.planning.simulation import simulate
from sim.scenes.gridded import LIBRARY

TOLERANCES = {"quick": (3.0,), "default": (3.0, 1.0), "full": (3.0, 1.0, 0.3, 0.1)}
"""[% of white]"""
SCENES = {"quick": ("corner", "furnace"), "default": tuple(LIBRARY), "full": tuple(LIBRARY)}
REFINED_PATCHES = {"quick": 4_000, "default": 9_000, "full": 16_000}
"""Most patches of the finer solution that the actual error is measured against."""
PITCH_M = 0.4
"""Patches of the scene that is handed over; the planner cuts the faces anew."""
MOST = 0.5
"""Share of the plans that may not model more than the scene needs: an error of a tenth of the tolerance or more."""


def run(size: Size, on_step: OnStep) -> Outcome:
    """Measure all that ``rig bench plan`` shows."""
    cases = [(scene, tolerance) for scene in SCENES[size] for tolerance in TOLERANCES[size]]
    points = []
    for number, (scene, tolerance) in enumerate(cases):
        on_step(f"{scene}, {tolerance:g} %", number, len(cases))
        points.append(_point(scene, tolerance, REFINED_PATCHES[size]))
    on_step("plan", len(cases), len(cases))
    return Outcome(points=tuple(points), criteria=tuple(_bars(points)))


def _point(scene: str, tolerance: float, most_patches: int) -> Point:
    started = time.perf_counter()
    planned = plan(LIBRARY[scene](PITCH_M), tolerance)
    between = time.perf_counter()
    simulation = simulate(planned.cells, planned.light, planned.model)
    seconds = time.perf_counter() - between
    check = refined_check(simulation, planned.light, planned.model, most_patches)
    memory = peak_mb(lambda: simulate(planned.cells, planned.light, planned.model))
    detail = {"tolerance": tolerance, "plan_s": between - started, **_promised(planned)}
    return Point(
        problem=scene,
        method=f"tolerance {tolerance:g} %",
        n=planned.patches,
        seconds=seconds,
        error=100 * check.rms,
        peak_mb=memory,
        error_of="% of white, rms",
        detail=detail,
    )


def _promised(planned: Plan) -> dict[str, float | str]:
    return {
        "expected_error": planned.error_percent,
        "expected_seconds": planned.seconds,
        "expected_mb": planned.peak_mb,
        "form_factors": planned.model.method,
        "visibility": planned.model.visibility,
        "solver": planned.solver,
    }


def _bars(points: list[Point]) -> list[Criterion]:
    criteria = []
    for point in points:
        tolerance = float(point.detail["tolerance"])
        criteria.append(
            Criterion(
                what=f"{point.problem} at {tolerance:g} %: actual error",
                value=point.error or 0.0,
                limit=tolerance,
                unit="%",
            )
        )
    no_more = [(point.error or 0.0) >= float(point.detail["tolerance"]) / 10 for point in points]
    share = statistics.mean(map(float, no_more))
    return [
        *criteria,
        Criterion(
            what="plans with an error of a tenth of the tolerance or more", value=share, limit=MOST, at_least=True
        ),
    ]
