"""Compensation strategies on one light transport, in one list: ``STRATEGIES``."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from numpy.typing import ArrayLike

from sim.arguments import word_of
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
from sim.compensation.strategy import Solve, Strategy
from sim.errors import SimulationError

__all__ = ["STRATEGIES", "Compensation", "Strategy", "Transport", "compensate", "register", "strategy"]

_known: dict[str, Strategy] = {}

STRATEGIES: Mapping[str, Strategy] = MappingProxyType(_known)
"""All strategies by name, in the order of pages and tables; those that other packages register come last."""


def register(new: Strategy) -> None:
    """Add a strategy of another package to ``STRATEGIES``; the same one may come again.

    Parameters
    ----------
    new : Strategy

    Raises
    ------
    SimulationError
        If another strategy has its name.
    """
    if _known.setdefault(new.name, new) != new:
        raise SimulationError(f"strategy {new.name!r} is there already: {_known[new.name].summary}; give another name")


def strategy(name: str) -> Strategy:
    """Return the strategy of a name.

    Parameters
    ----------
    name : str
        A key of ``STRATEGIES``.

    Returns
    -------
    Strategy

    Raises
    ------
    SimulationError
        For an unknown name.
    """
    return STRATEGIES[word_of("compensation", name, STRATEGIES)]


def compensate(
    name: str,
    transport: Transport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    **options: Any,
) -> Compensation:
    """Return the projector image that a strategy finds for a wanted camera image.

    Parameters
    ----------
    name : str
        A key of ``STRATEGIES``.
    transport : LightTransport or ColourTransport
        Of the projector's view: one camera value a projector pixel, direct light on the diagonal.
    target : (n,) or (n, C) array
        Camera image wanted, in the transport's unit; (n, C) for a ColourTransport of C bands.
    lower, upper : float
        Darkest and brightest value of a projector pixel, linear light.
    **options
        Of the strategy; its ``solve`` documents them.

    Returns
    -------
    Compensation

    Raises
    ------
    SimulationError
        For an unknown name, or a target or transport that does not fit.
    """
    return strategy(name).compensate(transport, target, lower=lower, upper=upper, **options)


def _own(solve: Solve, summary: str, publication: str = "", version: str = "1") -> Strategy:
    return Strategy(name=solve.__name__, solve=solve, summary=summary, publication=publication, version=version)


for _each in (
    _own(none, "the target itself, at one gain"),
    _own(direct, "each pixel by its own brightness, interreflection left out", "Nayar et al. 2003"),
    _own(paper, "emission by patch, faults as published", "Dehos et al. 2014"),
    _own(exact, "the exact inverse of the light transport, clamped", "Mukaigawa et al. 2006", version="2"),
    _own(reverse_radiosity, "projected Jacobi steps, damped", "Bimber et al. 2006"),
    _own(block_fixed_point, "a fixed point of interreflection that is known by blocks", "Habe et al. 2007"),
    _own(tikhonov, "the inverse, regularised against noise", "Wetzstein & Bimber 2007"),
    _own(series, "the first terms of the inverse's series, damped", "Bai et al. 2010"),
    _own(dual, "one gather of the target itself", "Bai et al. 2010"),
    _own(
        bounded, "the least squares optimum within the projector's range, certified", "Sheng et al. 2010", version="2"
    ),
    _own(perceptual, "that optimum for the difference in CIELAB", "Sheng et al. 2010", version="2"),
    _own(remap, "the largest contrast that stays in range: one gain, one offset", "Dehos et al. 2014"),
    _own(content_scale, "one scale, as large as clipping stays unseen", "Wang et al. 2005"),
    _own(smooth_attenuation, "a picture dimmed smoothly where it cannot be shown", "Ashdown et al. 2006"),
):
    register(_each)
