"""Compensation strategies on one light transport, all ``strategy(transport, target, lower, upper, ...)``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from numpy.typing import ArrayLike

from sim.compensation.result import Compensation
from sim.compensation.split_transport import Transport
from sim.compensation.strategies.block_fixed_point import block_fixed_point
from sim.compensation.strategies.bounded import bounded
from sim.compensation.strategies.content_scale import content_scale
from sim.compensation.strategies.direct import direct
from sim.compensation.strategies.dual import dual
from sim.compensation.strategies.exact import exact
from sim.compensation.strategies.none import none
from sim.compensation.strategies.paper import paper
from sim.compensation.strategies.perceptual import perceptual
from sim.compensation.strategies.remap import remap
from sim.compensation.strategies.reverse_radiosity import reverse_radiosity
from sim.compensation.strategies.series import series
from sim.compensation.strategies.smooth_attenuation import smooth_attenuation
from sim.compensation.strategies.tikhonov import tikhonov
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
