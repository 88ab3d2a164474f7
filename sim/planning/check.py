"""What a simulation's error was: against a solution on finer patches, with other rays, at more points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray
from sim.form_factors.factors import Visibility
from sim.geometry.adaptive_patches import PIECES, AdaptivePatches
from sim.light.lighting import Lighting
from sim.planning.cost import largest_dense
from sim.planning.linear_light import FREE, Senders, gathered, variance_of_product
from sim.planning.methods import largest_sampled
from sim.planning.simulation import SLOPES_NOISE, Model, Simulation, simulate
from sim.progress import OnProgress, part_of, unheard

OTHER_SEED = 1_000_003
"""Added to a model's seed for the rays that check it."""
FINER_SAMPLING, EACH_OF_TWO = 4, 2
"""Times less error than the model's that the rays of a check leave, and those of either of two whose noise is
independent: the product of the differences from both has no bias by it, and they take a third of the memory."""
BOTH_KEPT = 1.5
"""Times the memory of one solution, that two take of which one is kept while the other is made."""
MOST_DENSE = 16_000
"""Patches of a check without rays: its dense factors take 2 GB."""
POINT_RAYS, MOST_POINT_RAYS, MORE_POINT_RAYS = 16, 1024, 4
"""Of each sixteenth of a refined patch, twice, and times as many where noise hides the error: at 3 % the first tell it
to 2 %; of a random corner at 0.5 % they told 0.31 to 0.49 %."""
POINT_DOUBT = 0.1
"""Standard deviation by noise that the squared error may have, over it: then the error is known to 5 %."""


@dataclass(frozen=True)
class Check:
    """Difference from a refined solution; 1 = white."""

    rms: float
    """Over the surface."""
    max: float
    patches: int
    """Of the refined solution."""
    noise: float = 0.0
    """RMS over the surface that the rays of lobes left of the refined solution; ``rms`` is free of it."""


def largest_check(model: Model, memory_mb: float, *, once: bool = False) -> int:
    """Return the most patches of a refined solution that fit in memory [MB], and that a check should take.

    ``once``: there is one refined solution, as among glossy surfaces, not two.
    """
    if model.sampling is None:
        return min(MOST_DENSE, largest_dense(memory_mb))
    finer, kept = (FINER_SAMPLING, 1.0) if once else (EACH_OF_TWO, BOTH_KEPT)
    error = model.sampling / finer / (SLOPES_NOISE if model.linear else 1.0)
    return largest_sampled(memory_mb / kept, error)


def refined(model: Model, finer: float = FINER_SAMPLING, number: int = 1) -> Model:
    """Return a model of a check: rays of another number, that leave so many times less error, or exact visibility."""
    if model.sampling is not None:
        return replace(model, sampling=model.sampling / finer, seed=model.seed + number * OTHER_SEED)
    visibility: Visibility = "none" if model.visibility == "none" else "exact"
    return replace(model, visibility=visibility, compression=None)


def refined_check(
    simulation: Simulation, light: Lighting, model: Model, most_patches: int, *, on_progress: OnProgress = unheard
) -> Check:
    """Return the difference from a solution on cells quartered, or quartered twice where ``most_patches`` allows it.

    The finer patches still miss 1/4 (or 1/16) of the squared variation within a patch of the coarser ones: their
    squared difference is multiplied by 4/3 (16/15). The refined solution has the whole matrix and exact visibility;
    where the model goes by rays, there are two by other rays, which leave half of the error each, and their noise adds
    none. Where light is linear within patches, solutions are compared on quarters of the refined ones' patches, where
    they may bend.

    Light that steps within a patch shows half of what it leaves on quarters. A model by rays is therefore compared at
    sixteenths at least: where the solution on them does not fit, rays that leave sixteenths of the quarters bring them
    the light of the one on quarters.

    Parameters
    ----------
    simulation, light, model
        What :func:`simulate` gave and took.
    most_patches : int
        Of the refined solution.
    on_progress : callable
        Is told the share that is done, where form factors are compressed or come from rays.

    Returns
    -------
    Check
    """
    coarse = simulation.cells
    times = 2 if 16 * coarse.n_patches <= most_patches else 1
    fine = coarse
    for _ in range(times):
        fine = fine.quarters()
    one, other = (refined(model, EACH_OF_TWO, number) for number in (1, 2))
    by_rays = model.sampling is not None
    finer = simulate(fine, light, one, part_of(on_progress, 0.0, 0.5 if by_rays else 1.0))
    both = finer, simulate(fine, light, other, part_of(on_progress, 0.5, 1.0)) if by_rays else finer
    pieces = 4**times
    places = fine.quarters() if model.linear else fine
    ours, rho = simulation.irradiance_at(places), np.tile(finer.reflectance, (places.n_patches // fine.n_patches, 1))
    differences = [rho * (each.irradiance_at(places) - ours) for each in both]
    largest = float(np.abs(differences[0] + differences[1]).max() / 2)
    if model.sampling is not None and times == 1:
        at_points = simulation.irradiance_at(fine.quarters().quarters())
        means = (both[0].irradiance, both[1].irradiance)
        squared = squared_at_points(both, means, at_points, sampling=model.sampling, seed=other.seed)
    else:
        squared = (places.areas[:, None] * differences[0] * differences[1]).sum(axis=0)
    squared *= pieces / (pieces - 1) / places.areas.sum()
    return Check(float(np.sqrt(max(squared.max(), 0.0))), largest, fine.n_patches)


def squared_at_points(
    both: tuple[Simulation, Simulation],
    means: tuple[FloatArray, FloatArray],
    coarse: FloatArray,
    *,
    sampling: float,
    seed: int,
) -> FloatArray:
    """Return the squared difference of radiosity times area at sixteenths of the patches of a finer solution.

    Rays leave all sixteenths of a patch in the same directions: they tell well how the light varies about its mean,
    which the finer solutions know better than they. Two streams of them leave no bias by their noise, and there are
    more rays until that hides little of the sum.

    Parameters
    ----------
    both : two Simulations
        Of the same patches, whose light either stream of rays brings; the same one twice where only one is known.
    means : two (P, C) arrays
        Irradiance of its patches; 1 = white. Where it is noisy, two whose noise is independent.
    coarse : (16 P, C) array
        Irradiance at the sixteenths that it is compared with; 1 = white.
    sampling : float
        Error that the rays of the coarser solution may leave: smaller ones need not be known as well; 1 = white.
    seed : int
        Of the rays.

    Returns
    -------
    (C,) array
        [m²]; 1 = white.
    """
    finer = both[0]
    areas, least = finer.cells.sixteenths().areas.reshape(PIECES, -1), sampling**2 * float(finer.cells.areas.sum())
    squared = []
    for channel in range(finer.reflectance.shape[1]):
        of_means, ours = [mean[:, channel] for mean in means], coarse[:, channel].reshape(PIECES, -1)
        rays, doubt, known = POINT_RAYS // MORE_POINT_RAYS, np.inf, 0.0
        while doubt > POINT_DOUBT * max(known, least) and rays < MOST_POINT_RAYS:
            rays *= MORE_POINT_RAYS
            light = [_light_at_points(each, channel, rays, seed + k) for k, each in enumerate(both, 1)]
            known, doubt = _squared(light, of_means, ours, areas=areas, rho=finer.reflectance[:, channel])
        squared.append(known)
    return np.array(squared)


def _squared(
    light: list[FloatArray], means: list[FloatArray], ours: FloatArray, *, areas: FloatArray, rho: FloatArray
) -> tuple[float, float]:
    """Squared difference times area of one colour, and its standard deviation by the noise of the rays [m²]."""
    weight, share = areas * rho**2, areas / areas.sum(axis=0)
    within = [each - (share * each).sum(axis=0) for each in light]
    one, other = (mean - ours + each for mean, each in zip(means, within, strict=True))
    squared = (weight * one * other).sum(axis=0)
    noise = (weight * (within[0] - within[1]) ** 2).sum(axis=0) / 2 / np.sqrt(FREE)
    return float(squared.sum()), float(np.sqrt(variance_of_product(squared, noise).sum()))


def _light_at_points(finer: Simulation, channel: int, rays: int, stream: int) -> FloatArray:
    """(16, P) what rays bring to the sixteenths of the patches of a solution from itself."""
    cells: AdaptivePatches = finer.cells
    slopes = np.zeros((cells.n_patches, 3))
    if finer.slopes is not None:
        slopes = finer.reflectance[:, channel, None] * finer.slopes[:, :, channel]
    senders = Senders(surface=cells, B=finer.B[:, channel], slopes=slopes)
    return gathered(cells, np.arange(cells.n_patches), senders, rays=rays, stream=stream)[..., 1]
