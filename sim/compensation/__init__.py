"""Compensation strategies on one light transport, all ``strategy(transport, target, lower, upper, ...)``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from numpy.typing import ArrayLike

from sim.compensation.block_fixed_point import block_fixed_point
from sim.compensation.bounded import bounded
from sim.compensation.content_scale import content_scale
from sim.compensation.direct import direct
from sim.compensation.dual import dual
from sim.compensation.exact import exact
from sim.compensation.none import none
from sim.compensation.paper import paper
from sim.compensation.perceptual import perceptual
from sim.compensation.remap import remap
from sim.compensation.result import Compensation
from sim.compensation.reverse_radiosity import reverse_radiosity
from sim.compensation.series import series
from sim.compensation.smooth_attenuation import smooth_attenuation
from sim.compensation.tikhonov import tikhonov
from sim.compensation.view import Transport
from sim.errors import SimulationError

__all__ = ["STRATEGIES", "Compensation", "Transport", "compensate"]

STRATEGIES: Mapping[str, Callable[..., Compensation]] = MappingProxyType(
    {
        strategy.__name__: strategy
        for strategy in (
            none,
            direct,
            paper,
            exact,
            reverse_radiosity,
            block_fixed_point,
            tikhonov,
            series,
            dual,
            bounded,
            perceptual,
            remap,
            content_scale,
            smooth_attenuation,
        )
    }
)


def compensate(
    name: str,
    transport: Transport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    **options: Any,
) -> Compensation:
    """Run a strategy by name.

    Raises
    ------
    SimulationError
        For an unknown name, or a target or transport that does not fit.
    """
    if name not in STRATEGIES:
        raise SimulationError(f"unknown compensation {name!r}; there are {', '.join(STRATEGIES)}")
    return STRATEGIES[name](transport, target, lower, upper, **options)
