"""Compensation strategies on one light transport, all ``strategy(transport, target, lower, upper, ...)``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from numpy.typing import ArrayLike

from sim.compensation.bounded import bounded
from sim.compensation.direct import direct
from sim.compensation.exact import exact
from sim.compensation.none import none
from sim.compensation.paper import paper
from sim.compensation.result import Compensation
from sim.errors import SimulationError
from sim.light_transport import LightTransport

__all__ = ["STRATEGIES", "Compensation", "compensate"]

STRATEGIES: Mapping[str, Callable[..., Compensation]] = MappingProxyType(
    {"none": none, "direct": direct, "paper": paper, "exact": exact, "bounded": bounded}
)


def compensate(
    name: str,
    transport: LightTransport,
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
