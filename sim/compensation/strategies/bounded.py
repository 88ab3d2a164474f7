"""The best image that the projector's range allows: bounded least squares with a certificate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from numpy.typing import ArrayLike

from sim.compensation.adjusted_target import AdjustedTarget
from sim.compensation.box_least_squares import BoxProblem, optimum
from sim.compensation.inverse import Inverse
from sim.compensation.result import Compensation, Problem, prepare
from sim.compensation.sampled_start import initial_image
from sim.compensation.split_transport import Transport
from sim.compensation.strategies.content_scale import scaled_target
from sim.compensation.strategies.remap import remapped_target
from sim.compensation.strategies.smooth_attenuation import attenuated_target
from sim.errors import SimulationError


def bounded(
    transport: Transport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    *,
    tolerance: float | None = None,
    limit: int | None = None,
    adjustment: str = "none",
) -> Compensation:
    """Minimise ||T p - c||² over lower <= p <= upper, to a certified share of the optimum.

    T has the projector's blur, if there is one: what would be blurred is sharpened as far as the range allows.

    How it is solved and certified: :mod:`sim.compensation.box_least_squares`.

    Limits: the optimum of this error and of this model. A target that is too bright comes out dull where it cannot
    be reached.

    Parameters
    ----------
    transport, target, lower, upper
        As in :func:`sim.compensate`.
    tolerance : float, optional
        Stop once the duality gap is within this share of the objective; default: 1e-6, or 1e-2 where the projector's
        picture is blurred.
    limit : int, optional
        Most steps; the best image so far is returned, and ``gap`` says how good it is. Default: 60, or 10 with a blur.
    adjustment : {"none", "remap", "content_scale", "smooth_attenuation"}
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
        For an unknown adjustment.

    References
    ----------
    Sheng, Yapo and Cutler, Global illumination compensation for spatially augmented reality, Eurographics 2010.
    """
    if adjustment not in ADJUSTMENTS:
        raise SimulationError(f"bounded: unknown adjustment {adjustment!r}; there are {', '.join(ADJUSTMENTS)}")
    problem = prepare(transport, target, lower, upper)
    adjusted = ADJUSTMENTS[adjustment](problem)
    box = BoxProblem(transport=problem.shown, target=adjusted.values, lower=lower, upper=upper)
    best = optimum(box, initial_image(box, adjusted.wanted), tolerance, limit)
    return problem.result(best.p, best.steps, best.notes | adjusted.notes, best.at_bounds)


def _unchanged(problem: Problem) -> AdjustedTarget:
    return AdjustedTarget(problem.target, Inverse(problem.transport).apply(problem.target), 1)


ADJUSTMENTS: Mapping[str, Callable[[Problem], AdjustedTarget]] = MappingProxyType(
    {
        "none": _unchanged,
        "remap": remapped_target,
        "content_scale": scaled_target,
        "smooth_attenuation": attenuated_target,
    }
)
