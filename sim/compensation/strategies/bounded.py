"""The best image that the projector's range allows: bounded least squares with a certificate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from numpy.typing import ArrayLike

from sim.compensation.adjusted_target import AdjustedTarget
from sim.compensation.box_least_squares import BoxProblem, optimum
from sim.compensation.inverse import Inverse
from sim.compensation.result import Compensation, Problem, prepare
from sim.compensation.sampled_start import start_of
from sim.compensation.split_transport import Transport
from sim.compensation.strategies.content_scale import scaled
from sim.compensation.strategies.remap import remapped
from sim.compensation.strategies.smooth_attenuation import attenuated
from sim.errors import SimulationError


def bounded(
    transport: Transport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    tolerance: float = 1e-6,
    limit: int = 60,
    goal: str = "target",
) -> Compensation:
    """Minimise ||T p - c||² over lower <= p <= upper, to a certified share of the optimum.

    References: Sheng, Yapo and Cutler, Global illumination compensation for spatially augmented reality, Eurographics
    2010, for the problem; :mod:`sim.compensation.box_least_squares` for how it is solved and certified.

    Limits: the optimum of this error and of this model. A target that is too bright comes out dull where it cannot
    be reached.

    Parameters
    ----------
    tolerance : float
        Stop once the duality gap is within this share of the objective.
    limit : int
        Most steps; the best image so far is returned, and ``gap`` says how good it is.
    goal : {"target", "remap", "content_scale", "smooth_attenuation"}
        What to come near: the target, or the target as that strategy changes it, so that one too bright stays a
        picture. The residual is from the target all the same.

    Returns
    -------
    Compensation
        Its notes hold ``gap`` (relative), ``kkt_residual`` (relative, 0 at the optimum), ``optimal_rms_at_least`` and
        ``short_of_optimum``: by which share, at most, the RMS residual is above the optimum; ``products`` counts those
        with TᵀT.

    Raises
    ------
    SimulationError
        For an unknown goal.
    """
    if goal not in GOALS:
        raise SimulationError(f"bounded: unknown goal {goal!r}; there are {', '.join(GOALS)}")
    task = prepare(transport, target, lower, upper)
    changed = GOALS[goal](task)
    problem = BoxProblem(task.view, changed.values, lower, upper)
    result = optimum(problem, start_of(problem, changed.wanted), tolerance, limit)
    return task.finished(result.p, result.steps, result.notes | changed.notes, result.held)


def _unchanged(task: Problem) -> AdjustedTarget:
    return AdjustedTarget(task.target, Inverse(task.view).apply(task.target), 1)


GOALS: Mapping[str, Callable[[Problem], AdjustedTarget]] = MappingProxyType(
    {"target": _unchanged, "remap": remapped, "content_scale": scaled, "smooth_attenuation": attenuated}
)
