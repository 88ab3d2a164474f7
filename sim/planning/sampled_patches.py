"""Patches for form factors by rays: judged by rays that leave their quarters, refined until those agree.

The irradiance of a patch is one number; by how much the true one varies within is measured, not guessed from
neighbours: rays leave each quarter of each patch, twice, independently. The product of both deviations from the patch's
mean has no bias by noise, so that its sum over thousands of patches is known well where hardly one is. It also sees
what no gradient tells: a patch that another one pierces or covers in part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.form_factors.sampled import FEWEST_RAYS, RaySample
from sim.geometry.adaptive_patches import AdaptivePatches
from sim.light.lighting import Lighting
from sim.planning.adapt import Refinement, SolvedPatches
from sim.planning.simulation import Model, Simulation, simulate

QUARTERS = 4
SEEN_BY_QUARTERS = 0.75
"""Share of the squared variation of a linear field that shows between the quarters of a patch."""
SURE = 4.0
"""Standard deviations of noise from which a single patch's measured variation is believed."""
TOTAL_SURE = 2.0
"""Standard deviations that are added to the sum of all."""
SAFETY = 1.15
"""The error that is expected over the one measured."""
GROWTH = 4
"""A round has at most this many times the patches of the one before."""
ENOUGH = 0.7
"""Share of the patches from which on a coarser plan is not worth a round."""
MOST_ROUNDS = 12
FAR_OFF, SLOWEST = 2.0, 0.2
"""Times the goal beyond which progress is looked at, and the power of the patches' number with which an error must
fall: 2^5 times as many patches for half of it are not worth a round. Smooth light has 1/2, an edge in patches 1/4."""
ADVICE = 1.6
"""The tolerance that is advised over the error reached: 1.25 for the patches' share, the rest for safety."""
OTHER_STREAM = 7919
"""Seeds of measuring rays lie this far from those of the form factors."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledPatches:
    """Patches, their solution by rays, and what their number costs."""

    cells: AdaptivePatches
    solved: Simulation
    error: float
    """Expected of light that is one number a patch, RMS over the surface, with safety; 1 = white."""


@dataclass(frozen=True, eq=False)
class _Variation:
    """Of the irradiance within patches, squared and averaged over each: unbiased, and its standard deviation."""

    squared: FloatArray
    deviation: FloatArray


def patches_by_rays(
    start: AdaptivePatches,
    light: Lighting,
    model: Model,
    *,
    whole: AdaptivePatches,
    goal: float,
    check_size: Callable[[int], None],
) -> SampledPatches:
    """Return the fewest patches whose light is within ``goal`` of the one that varies within them.

    Parameters
    ----------
    start : AdaptivePatches
        To begin with.
    light : Lighting
    model : Model
        With rays.
    whole : AdaptivePatches
        The coarsest patches that there may be.
    goal : float
        RMS over the surface; 1 = white.
    check_size : callable
        Raises an error where so many patches are too many.

    Returns
    -------
    SampledPatches
        After some rounds the error may still be above the goal.
    """
    cells, before = start, None
    for _ in range(MOST_ROUNDS):
        check_size(cells.n_patches)
        solved = simulate(cells, light, model)
        probe, variation = _probe(solved, _variation_within(solved, model.seed + OTHER_STREAM))
        refinement = Refinement.start(whole, probe, light)
        squared = variation + refinement.squared_light_edge(cells)
        error = SAFETY * float(np.sqrt(squared / cells.areas.sum()))
        found = SampledPatches(cells=cells, solved=solved, error=error)
        _check_progress(before, found, goal)
        before = found
        correction = error / max(probe.error, 1e-12) if error > goal else 1.0
        refinement.refine(0.9 * goal / (SAFETY * max(correction, 1.0)), GROWTH * cells.n_patches)
        if error <= goal and refinement.cells.n_patches >= ENOUGH * cells.n_patches:
            return found
        # From here on patches are only cut further.
        cells = replace(refinement.cells, whole=np.arange(refinement.cells.n_patches))
        whole = cells
    return found


def _check_progress(before: SampledPatches | None, now: SampledPatches, goal: float) -> None:
    """Raise SimulationError where more patches hardly help: light jumps within them, wherever they are cut."""
    if before is None or now.error <= FAR_OFF * goal or now.cells.n_patches < 2 * before.cells.n_patches:
        return
    more = now.cells.n_patches / before.cells.n_patches
    if np.log(before.error / now.error) < SLOWEST * np.log(more):
        raise SimulationError(
            f"{before.cells.n_patches:,} patches leave {100 * before.error:.2g} %, {now.cells.n_patches:,} still "
            f"{100 * now.error:.2g} %, and {100 * goal:.2g} % are wanted: where surfaces cut through each other light "
            f"jumps within patches; try a tolerance of {100 * ADVICE * now.error:.2g} %, or cut them where they meet"
        )


def _variation_within(solved: Simulation, seed: int) -> _Variation:
    cells = solved.cells
    quarters = cells.quarters()
    B = np.tile(solved.B[:, 0], QUARTERS)
    means = []
    for number in (seed, seed + 1):
        sample = RaySample(quarters, number)
        sample.lengthen(FEWEST_RAYS)
        means.append(sample.halves(B).mean.reshape(QUARTERS, -1))
    share = quarters.areas.reshape(QUARTERS, -1) / cells.areas
    one, other = (mean - (share * mean).sum(axis=0) for mean in means)
    noise = (share * (one - other) ** 2).sum(axis=0) / 2
    squared = (share * one * other).sum(axis=0) / SEEN_BY_QUARTERS
    # Of a product of two means of three free deviations each.
    return _Variation(squared, noise / np.sqrt(QUARTERS - 1) / SEEN_BY_QUARTERS)


def _probe(solved: Simulation, variation: _Variation) -> tuple[SolvedPatches, float]:
    """The solution as refinement takes it, and the squared variation of all patches times their area."""
    cells = solved.cells
    probe = SolvedPatches.of(cells, solved.irradiance[:, 0])
    measured, deviation = cells.areas * variation.squared, cells.areas * variation.deviation
    sure = measured > probe.within + SURE * deviation
    slope = cells.variation(probe.gradient)
    roughness = np.where(sure, np.maximum(measured - slope, 0.0) / cells.polar_moments, probe.roughness)
    within = np.where(sure, measured, probe.within)
    probe = replace(probe, roughness=roughness, within=within)
    weight = cells.reflectance**2
    total = float((weight * measured).sum()) + TOTAL_SURE * float(np.sqrt(((weight * deviation) ** 2).sum()))
    return probe, total
