"""``rig bench compensate``: seconds against error of every strategy, on the paper's room and on it in colour."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.benchmark.records import Criterion, Detail, Outcome, Point, Size
from rig.benchmark.timing import median_seconds
from rig.paper.experiments import CONFIGURATIONS, Configuration, desired_picture, paper_factors, paper_transport
from rig.stages.picture_errors import WHITE
from rig.terminal import OnStep
from sim.compensation import STRATEGIES, Compensation, Transport, compensate
from sim.form_factors import FormFactors
from sim.light.colour import ColourTransport

FloatArray = NDArray[np.float64]

SHAPES = {"quick": (60, 80), "default": (120, 160), "full": (360, 480)}
NAMES = {
    "quick": ("reference", "grey"),
    "default": ("reference", "grey", "dark_walls"),
    "full": tuple(configuration.name for configuration in CONFIGURATIONS),
}
"""Configurations of the paper."""
BUDGET_S = {"quick": 0.0, "default": 2.0, "full": 20.0}
"""For repeats of each problem; 0: one call is all. [s]"""
COLOUR = "reference in colour"
BAND_REFLECTANCES = (0.75, 0.7, 0.6)
MIXING = ((0.9, 0.08, 0.02), (0.05, 0.9, 0.05), (0.02, 0.08, 0.9))
GAP = 1e-6
"""Most that the certificate of the bounded optimum may leave open, relative."""
BEATEN = 1e-6
"""By how much of its RMS error, or of a grey level, another may be below the bounded optimum."""


def run(size: Size, on_step: OnStep) -> Outcome:
    """Measure all that ``rig bench compensate`` shows."""
    chosen = [each for each in CONFIGURATIONS if each.name in NAMES[size]]
    factors = {ceiling: paper_factors(ceiling) for ceiling in {each.ceiling for each in chosen}}
    points: list[Point] = []
    for k, configuration in enumerate(chosen):
        on_step(configuration.title, k, len(chosen) + 1)
        transport, target = grey_problem(configuration, factors[configuration.ceiling], SHAPES[size])
        points += measured(configuration.name, transport, target, BUDGET_S[size])
    on_step(COLOUR, len(chosen), len(chosen) + 1)
    points += measured(COLOUR, *colour_problem(factors[True], SHAPES[size]), BUDGET_S[size])
    on_step("compensate", len(chosen) + 1, len(chosen) + 1)
    return Outcome(points=tuple(points), criteria=tuple(criteria(points)), notes=NOTES)


NOTES = (
    "The interreflection between patches is computed once a room, before the clock starts. Errors are the model's own: "
    "rig compare-strategies measures them",
)


def grey_problem(
    configuration: Configuration, factors: FormFactors, shape: tuple[int, int]
) -> tuple[Transport, FloatArray]:
    """Transport and target (n,) of one of the paper's configurations."""
    transport = paper_transport(configuration, factors, shape)
    desired = desired_picture(configuration.image, shape).ravel()
    return transport, np.where(transport.pixel_patch >= 0, desired, 0.0)


def colour_problem(factors: FormFactors, shape: tuple[int, int]) -> tuple[Transport, FloatArray]:
    """The reference with a reflectance for each band, channels that leak into each other, and a tinted target."""
    reference = CONFIGURATIONS[0]
    bands = [paper_transport(replace(reference, reflectance=rho), factors, shape) for rho in BAND_REFLECTANCES]
    grey = desired_picture(reference.image, shape).ravel()
    return ColourTransport(bands, MIXING), np.stack([grey, 0.9 * grey, 0.75 * grey], axis=-1)


def measured(problem: str, transport: Transport, target: FloatArray, budget_s: float) -> list[Point]:
    """A point for each strategy; all take turns on the clock."""
    solutions = {name: compensate(name, transport, target, lower=0.0, upper=WHITE) for name in STRATEGIES}

    def timed(name: str) -> Any:
        return lambda: compensate(name, transport, target, lower=0.0, upper=WHITE)

    seconds = {name: solution.seconds for name, solution in solutions.items()}
    if budget_s > 0:
        seconds = median_seconds({name: timed(name) for name in STRATEGIES}, budget_s, repeats=5)
    patches = int(np.unique(transport.pixel_patch[transport.pixel_patch >= 0]).size)
    return [
        Point(
            problem=problem,
            method=name,
            n=patches,
            seconds=seconds[name],
            error=float(np.abs(solution.predicted - target).mean()),
            error_of="mean |predicted - target|, grey levels of 255",
            detail=_detail(solution, target),
        )
        for name, solution in solutions.items()
    ]


def _detail(solution: Compensation, target: FloatArray) -> Detail:
    numbers = {key: value for key, value in solution.notes.items() if isinstance(value, int | float)}
    return {
        "pixels": len(target),
        "rms": float(np.sqrt(np.mean((solution.predicted - target) ** 2))),
        "clipped_share": float(solution.clipped.mean()),
        "iterations": solution.iterations,
        **{f"note_{key}": float(value) for key, value in numbers.items()},
    }


def criteria(points: Sequence[Point]) -> list[Criterion]:
    """What the certificate promises, and what the optimum is worth."""
    by_problem: dict[str, dict[str, Point]] = {}
    for point in points:
        by_problem.setdefault(point.problem, {})[point.method] = point
    found = []
    for problem, methods in by_problem.items():
        optimum = methods["bounded"]
        found.append(
            Criterion(what=f"{problem}: bounded, certified gap", value=float(optimum.detail["note_gap"]), limit=GAP)
        )
        found.append(
            Criterion(what=f"{problem}: bounded RMS over the least of all", value=_beaten(methods), limit=1 + BEATEN)
        )
    reference, grey = by_problem.get("reference"), by_problem.get("grey")
    if reference:
        share = (reference["bounded"].error or 0.0) / (reference["paper"].error or 1.0)
        found.append(Criterion(what="reference: error of bounded over that of paper", value=share, limit=0.45))
    if grey:
        found.append(
            Criterion(what="grey: error of bounded", value=grey["bounded"].error or 0.0, limit=0.1, unit="grey levels")
        )
    return found


def _beaten(methods: Mapping[str, Point]) -> float:
    """The optimum's RMS error over the least; 1 where all is roundoff of a grey level."""
    rms = {name: float(point.detail["rms"]) + BEATEN for name, point in methods.items()}
    return rms["bounded"] / min(rms.values())
