"""The verbs of the command line for scripts: each does what is missing of one stage of a session.

All take an open rig and an open session and tell their progress to ``on_step``; errors are those of
:mod:`rig.errors`.
The heavy parts are imported when a verb is called, so that ``import rig`` stays quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rig.capture.rig import Rig
from rig.session import Session
from rig.stages.error_tree import one_error_tree
from rig.terminal import OnStep, silent

STRATEGIES = ("none", "direct", "paper", "exact", "bounded")


@one_error_tree()
def calibrate(rig: Rig, session: Session, on_step: OnStep = silent) -> None:
    """Find exposure, response curves, correspondence, lenses, poses and walls."""
    from rig.stages.correspondence import decode_gray_code, fit_geometry, photograph_gray_code
    from rig.stages.radiometry import find_exposure, measure_responses

    for step in (find_exposure, measure_responses, photograph_gray_code, decode_gray_code, fit_geometry):
        step(rig, session, on_step)


@one_error_tree()
def separate(rig: Rig, session: Session, on_step: OnStep = silent) -> None:
    """Tell direct from global light by shifted checkers. Needs `calibrate`."""
    from rig.stages.separation import separate_light

    separate_light(rig, session, on_step)


@one_error_tree()
def model(rig: Rig, session: Session, on_step: OnStep = silent) -> None:
    """Model the room in patches: reflectance, vignetting, brightness scale. Needs `separate`."""
    from rig.stages.model import build_model

    build_model(rig.profile, session, on_step)


@one_error_tree()
def compensate(
    rig: Rig,
    session: Session,
    target: str | Path | None = None,
    strategies: Sequence[str] = STRATEGIES,
    on_step: OnStep = silent,
    *,
    fit: bool = False,
) -> None:
    """Compute each strategy's projector image for a target and predict its camera image. Needs `model`.

    Parameters
    ----------
    target
        A picture of the projector's size; default: a photograph that ships with scikit-image.
    strategies
        Of ``none, direct, paper, exact, bounded``; ``none`` is always among them.
    fit
        Scale and crop a picture of another size.
    """
    from rig.stages.compensation import check_strategies, compute_compensation
    from rig.stages.target import load_target

    channels = rig.profile.camera.channels
    picture = load_target(None if target is None else Path(target), rig.projector.shape, fit, channels)
    compute_compensation(session, picture, check_strategies(tuple(strategies)), on_step)


@one_error_tree()
def compare(rig: Rig, session: Session, on_step: OnStep = silent) -> dict[str, Any]:
    """Project and photograph every strategy, and write and return the metrics. Needs `compensate`."""
    from rig.run.results import collect_metrics
    from rig.stages.comparison import compare_all, project_and_photograph

    project_and_photograph(rig, session, on_step)
    compare_all(session, on_step)
    metrics = collect_metrics(session, rig, "compare")
    session.write_metrics(metrics)
    return metrics


def write_report(session: Session, on_step: OnStep = silent) -> Path:
    """Write report.html of a compared session and return its path."""
    from rig.report.page import write_report as write_page

    metrics = session.read_metrics()
    path = write_page(session, metrics, on_step)
    session.write_metrics({**metrics, "report": path.name})
    return path
