"""Every strategy on the paper's six configurations, without any device: `rig compare-strategies --paper`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.files.atomic import check_output, write_bytes
from rig.paper.experiments import CONFIGURATIONS, SHAPE, Configuration, desired_picture, paper_factors, paper_transport
from rig.stages.error_tree import one_error_tree
from rig.stages.picture_errors import WHITE
from rig.stages.target import check_strategies
from rig.strategies.closed_loop import judged_errors
from rig.strategies.comparison import warnings_of
from rig.strategies.page import PaperPictures, paper_page
from rig.strategies.records import ComparedPicture, ComparisonResult, StrategyRow
from rig.terminal import OnStep
from sim.compensation import STRATEGIES, Compensation, compensate
from sim.form_factors import FormFactors

FloatArray = NDArray[np.float64]


def compare_on_paper(
    strategies: Sequence[str],
    page: Path | None,
    on_step: OnStep,
    configurations: Sequence[Configuration] = CONFIGURATIONS,
) -> ComparisonResult:
    """Compute and judge every strategy on every configuration.

    Parameters
    ----------
    strategies
        None: all that there are.
    page
        HTML file to write.

    Returns
    -------
    ComparisonResult
        With predicted errors only.

    Raises
    ------
    UsageError, SessionError, CalibrationFailed
        Unknown strategy; no place for the page; a strategy that refuses.
    """
    started_s = time.perf_counter()
    if page is not None:
        check_output(page)
    names = check_strategies(tuple(strategies) or tuple(STRATEGIES))
    pictures, images = [], {}
    with one_error_tree():
        factors = {ceiling: paper_factors(ceiling) for ceiling in {each.ceiling for each in configurations}}
        for k, configuration in enumerate(configurations):
            on_step("the paper's configurations", k, len(configurations))
            rows, shown = _compared(configuration, factors[configuration.ceiling], names)
            pictures.append(ComparedPicture(name=configuration.name, title=configuration.title, rows=rows))
            images[configuration.name] = shown
    on_step("the paper's configurations", len(configurations), len(configurations))
    result = ComparisonResult(pictures=tuple(pictures), ratios={}, warnings=warnings_of(pictures))
    if page is not None:
        write_bytes(page, paper_page(result, images).encode())
        result = replace(result, report=str(page))
    return replace(result, elapsed_s=time.perf_counter() - started_s)


def _compared(
    configuration: Configuration, factors: FormFactors, names: Sequence[str]
) -> tuple[tuple[StrategyRow, ...], PaperPictures]:
    transport = paper_transport(configuration, factors, SHAPE)
    seen = (transport.pixel_patch >= 0).reshape(SHAPE)
    desired = np.where(seen, desired_picture(configuration.image, SHAPE), 0.0)
    solutions = {name: compensate(name, transport, desired.ravel(), lower=0.0, upper=WHITE) for name in names}
    rows = tuple(_row(name, solution, desired, seen) for name, solution in solutions.items())
    shown = PaperPictures(
        desired=desired,
        seen=seen,
        projected={name: solution.projector_image.reshape(SHAPE) for name, solution in solutions.items()},
        predicted={name: solution.predicted.reshape(SHAPE) for name, solution in solutions.items()},
    )
    return rows, shown


def _row(name: str, solution: Compensation, desired: FloatArray, seen: NDArray[np.bool_]) -> StrategyRow:
    predicted = solution.predicted.reshape(SHAPE)
    return StrategyRow(
        strategy=name,
        predicted=judged_errors(predicted, desired, seen),
        clipped_share=float(solution.clipped[seen.ravel()].mean()),
        gain=float(solution.notes.get("gain", 1.0)),
        seconds=solution.seconds,
        iterations=solution.iterations,
        notes=dict(solution.notes),
    )
