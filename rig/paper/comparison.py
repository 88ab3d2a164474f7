"""Every strategy on the paper's six configurations, without any device: `rig compare-strategies --paper`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.files.atomic import write_bytes
from rig.paper.experiments import CONFIGURATIONS, SHAPE, Configuration, desired_picture, paper_factors, paper_transport
from rig.stages.compensation import check_strategies
from rig.stages.error_tree import one_error_tree
from rig.stages.picture_errors import WHITE, perceived_errors, picture_errors
from rig.strategies.comparison import warnings_of
from rig.terminal import OnStep
from sim.compensation import STRATEGIES, Compensation, compensate
from sim.form_factors import FormFactors

FloatArray = NDArray[np.float64]


def compare_on_paper(
    strategies: Sequence[str],
    page: Path | None,
    on_step: OnStep,
    configurations: Sequence[Configuration] = CONFIGURATIONS,
) -> dict[str, Any]:
    """Compute and judge every strategy on every configuration.

    Parameters
    ----------
    strategies
        None: all that there are.
    page
        HTML file to write.

    Returns
    -------
    dict
        ``pictures`` and ``warnings`` as :func:`compare_strategies`, with ``predicted`` errors only; ``elapsed_s``.

    Raises
    ------
    UsageError, SessionError, CalibrationFailed
        Unknown strategy; no place for the page; a strategy that refuses.
    """
    from rig.strategies.page import paper_page

    started_s = time.perf_counter()
    names = check_strategies(tuple(strategies) or tuple(STRATEGIES))
    pictures, images = [], {}
    with one_error_tree():
        factors = {ceiling: paper_factors(ceiling) for ceiling in {each.ceiling for each in configurations}}
        for k, configuration in enumerate(configurations):
            on_step("the paper's configurations", k, len(configurations))
            rows, shown = _compared(configuration, factors[configuration.ceiling], names)
            pictures.append({"name": configuration.name, "title": configuration.title, "rows": rows})
            images[configuration.name] = shown
    on_step("the paper's configurations", len(configurations), len(configurations))
    result: dict[str, Any] = {"pictures": pictures, "loops": [], "perfect": [], "ratios": {}}
    result["warnings"] = warnings_of(pictures)
    if page is not None:
        write_bytes(page, paper_page(result, images).encode())
        result["report"] = str(page)
    return {**result, "elapsed_s": time.perf_counter() - started_s}


def _compared(
    configuration: Configuration, factors: FormFactors, names: Sequence[str]
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    transport = paper_transport(configuration, factors, SHAPE)
    seen = (transport.pixel_patch >= 0).reshape(SHAPE)
    desired = np.where(seen, desired_picture(configuration.image, SHAPE), 0.0)
    solutions = {name: compensate(name, transport, desired.ravel(), 0.0, WHITE) for name in names}
    rows = [_row(name, solution, desired, seen) for name, solution in solutions.items()]
    shown = {
        "desired": desired,
        "seen": seen,
        "projected": {name: solution.projector_image.reshape(SHAPE) for name, solution in solutions.items()},
        "predicted": {name: solution.predicted.reshape(SHAPE) for name, solution in solutions.items()},
    }
    return rows, shown


def _row(name: str, solution: Compensation, desired: FloatArray, seen: NDArray[np.bool_]) -> dict[str, Any]:
    predicted = solution.predicted.reshape(SHAPE)
    return {
        "strategy": name,
        "predicted": picture_errors(predicted, desired, seen) | perceived_errors(predicted, desired, seen),
        "clipped_share": float(solution.clipped[seen.ravel()].mean()),
        "gain": float(solution.notes.get("gain", 1.0)),
        "seconds": solution.seconds,
        "iterations": solution.iterations,
        "notes": dict(solution.notes),
    }
