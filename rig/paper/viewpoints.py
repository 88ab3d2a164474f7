"""One of the paper's experiments from any viewpoint, on small pictures: what a study of many asks."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.paper.experiments import (
    CONFIGURATIONS,
    Configuration,
    Viewpoint,
    coverage_of,
    desired_picture,
    paper_factors,
    paper_transport,
)
from rig.paper.records import Ends
from rig.paper.scores import WHITE
from rig.records import Record
from sim.compensation import compensate
from sim.form_factors import FormFactors
from sim.light.criteria import (
    Difference,
    Spread,
    difference,
    indirect_radiosity,
    overall_once_reflected_share,
    spread,
)
from sim.light.transport import LightTransport

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """What one experiment is: a viewpoint, a room, a picture, and the rules that compensate."""

    viewpoint: Viewpoint
    photograph: str
    """``outdoor``, ``indoor`` or ``grey``."""
    reflectance: float
    ceiling: bool
    shape: tuple[int, int]
    """Height and width of the pictures [px]."""
    strategies: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class ExperimentErrors(Record):
    """|visible - desired| under a strategy, grey levels of 255, over the pixels that light a surface."""

    mean: float
    sd: float
    max: float
    rms: float
    clipped_share: float
    gap: float | None = None
    """Of ``bounded``: how far its sum of squares can be from the least."""


@dataclass(frozen=True, kw_only=True)
class ExperimentResult(Record):
    """The paper's criteria of one experiment; light in grey levels of 255."""

    coverage: float
    pixels_on_surface: float
    indirect: Spread
    share_white: float
    required_emission: Ends | None = None
    """None where the paper's rule was not asked for."""
    uncompensated: Difference
    """The desired image itself is projected."""
    strategies: tuple[tuple[str, ExperimentErrors], ...]


@dataclass(frozen=True, eq=False)
class ExperimentPictures:
    """What an experiment shows; (H, W) grey levels of 255, by name."""

    desired: FloatArray
    uncompensated: FloatArray
    visible: tuple[tuple[str, FloatArray], ...]


def direction_of(azimuth_deg: float, elevation_deg: float) -> tuple[float, float, float]:
    """Return the unit vector of an azimuth (from x to y) and an elevation (upwards)."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    flat = math.cos(elevation)
    return (flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation))


def run_experiment(wanted: Experiment) -> tuple[ExperimentResult, ExperimentPictures]:
    """Compute one experiment with the paper's quadrature and rules.

    Raises
    ------
    UsageError
        The projector lights no surface.
    """
    configuration = replace(
        CONFIGURATIONS[0],
        image=wanted.photograph,
        hfov_deg=wanted.viewpoint.hfov_deg,
        ceiling=wanted.ceiling,
        reflectance=wanted.reflectance,
    )
    transport = _transport(configuration, wanted.viewpoint, wanted.shape)
    seen = transport.pixel_patch >= 0
    if not seen.any():
        raise UsageError(f"no pixel of the projector lights a surface from {wanted.viewpoint}; turn it to a wall")
    desired = np.where(seen, _picture(wanted.photograph, wanted.shape).ravel(), 0.0)
    uncompensated = np.asarray(transport @ desired)
    solutions = {name: compensate(name, transport, desired, lower=0.0, upper=WHITE) for name in wanted.strategies}
    errors = tuple(
        (
            name,
            ExperimentErrors(
                **asdict(difference(solution.predicted[seen], desired[seen])),
                clipped_share=float(solution.clipped[seen].mean()),
                gap=float(solution.notes["gap"]) if "gap" in solution.notes else None,
            ),
        )
        for name, solution in solutions.items()
    )
    notes = solutions["paper"].notes if "paper" in solutions else None
    result = ExperimentResult(
        coverage=coverage_of(transport),
        pixels_on_surface=float(seen.mean()),
        indirect=spread(indirect_radiosity(transport, desired)),
        share_white=overall_once_reflected_share(transport, np.full(desired.shape, WHITE)),
        required_emission=None
        if notes is None
        else Ends(min=float(notes["required_emission_min"]), max=float(notes["required_emission_max"])),
        uncompensated=difference(uncompensated[seen], desired[seen]),
        strategies=errors,
    )
    shown = ExperimentPictures(
        desired.reshape(wanted.shape),
        uncompensated.reshape(wanted.shape),
        tuple((name, solution.predicted.reshape(wanted.shape)) for name, solution in solutions.items()),
    )
    return result, shown


@lru_cache(maxsize=2)
def _factors(ceiling: bool) -> FormFactors:
    return paper_factors(ceiling)


@lru_cache(maxsize=8)
def _picture(image: str, shape: tuple[int, int]) -> FloatArray:
    return desired_picture(image, shape)


def _transport(configuration: Configuration, viewpoint: Viewpoint, shape: tuple[int, int]) -> LightTransport:
    return paper_transport(
        configuration,
        _factors(configuration.ceiling),
        shape,
        position_m=viewpoint.position_m,
        direction=viewpoint.direction,
    )
