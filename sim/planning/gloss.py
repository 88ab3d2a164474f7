"""Light among glossy surfaces under a test lighting, from that of matte ones that send back as much."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.geometry.adaptive_patches import AdaptivePatches
from sim.geometry.rays import trace
from sim.geometry.surface import Surface
from sim.light.gloss.exchange import RAYS_AT_A_TIME, glossy_form_factors
from sim.light.gloss.material import Gloss
from sim.light.gloss.walks import GlossySurface
from sim.light.lighting import Lighting
from sim.light.radiosity import Radiosity
from sim.planning.adapt import gradients
from sim.planning.check import Check, refined, squared_at_points
from sim.planning.cost import Cost
from sim.planning.gloss_places import places_on
from sim.planning.simulation import Model, Simulation, light_at, simulate
from sim.progress import OnProgress, unheard

RAYS, FEWEST_RAYS, LEAST_OF_ALL, ALL_RAYS = 256, 16, 1 << 14, 1 << 21
"""Pairs of rays from each glossy patch: 0.4 % rms of the mean light in a room of 1,024 patches, 1,024 leave 0.2 %. Of
all of them together between the last two numbers, but 16 at least: patches of a fine mesh share what is around them."""
LAMP_POINTS = 1 << 18
"""On all glossy patches, from which the lamp's light goes on."""
FIRST_S, PAIR_S, PAIR_MB, KEPT_MB = 0.3, 7e-6, 1e-3, 2.5e-4
"""Of the table of albedos; of a pair of rays, with the lamp's point that goes with it; memory of a pair at work, and of
what is kept of it. Measured on 80 to 3,531 patches, all glossy, on two busy cores."""
BEND = 2.5
"""What lobes add to the error that patches leave, in squares, over the share of all reflected light that they send. In
rooms of gloss 0.1 to 0.6 and roughness 0.1 to 0.8, on patches for 3 and 4 %, it was 0.9 to 2.1, and 2.4 where lobes
sent 0.14 of the light (benchmarks/gloss_honesty.py --bend)."""
OTHER_SEED = 1_000_033
ABOVE = 1e-6
"""Of the surface's size: from there a cell looks down on the patch that it is part of."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GlossySimulation:
    """The light of a scene with glossy patches, brightest colour first."""

    matte: Simulation
    """With matte patches that send back as much of even light."""
    gloss: Gloss
    """Of the patches."""
    reflectance: FloatArray
    """(P, C) of the matte part."""
    by_gloss: FloatArray
    """(P,) irradiance by light that came straight from the lamp to glossy patches; 1 = white."""
    B: FloatArray
    """(P, C) radiosity of the matte part; 1 = white."""
    irradiance: FloatArray
    """(P, C) all but straight from the lamp; 1 = white."""
    slopes: FloatArray | None
    """(P, 3, C) gradients of the irradiance, as of :class:`Simulation`: those of the matte one, and of what lobes add
    those that neighbours tell. None: one number a patch."""
    residual: float
    products: int

    def irradiance_at(self, pieces: AdaptivePatches) -> FloatArray:
        """Return the irradiance at the centres of pieces of the patches, as that of :class:`Simulation`."""
        return light_at(pieces, self.matte.cells, self.irradiance, self.slopes)


def gloss_of_cells(cells: AdaptivePatches, surface: Surface, gloss: Gloss) -> Gloss:
    """Return the gloss of cells that a surface was cut into: that of the patch under each one's middle.

    Raises
    ------
    SimulationError
        If a cell lies on no patch of the surface.
    """
    if np.ptp(gloss.share) == 0 and np.ptp(gloss.roughness) == 0:
        n = cells.n_patches
        return Gloss(np.full(n, gloss.share[0]), np.full(n, gloss.roughness[0]))
    above_m = ABOVE * float(np.ptp(np.asarray(cells.vertices).reshape(-1, 3), axis=0).max())
    patch = trace(surface, cells.centres + above_m * cells.normals, -cells.normals).patch
    if (patch < 0).any():
        raise SimulationError(
            f"{surface.name}: {int((patch < 0).sum())} cells lie on none of its patches; give cells of this surface"
        )
    return Gloss(gloss.share[patch], gloss.roughness[patch])


def glossy_simulation(
    matte: Simulation, light: Lighting, gloss: Gloss, *, rays: int | None = None, seed: int = 0
) -> GlossySimulation:
    """Return the light of a scene with glossy patches, from that of matte ones that send back as much of even light.

    Parameters
    ----------
    matte : Simulation
        Its reflectance is ρ + ρ_s ā.
    light : Lighting
        That it was made for.
    gloss : Gloss
        Of its cells.
    rays : int, optional
        Pairs from each glossy patch; None: 256, fewer where there are many patches.
    seed : int
        Another one for other rays.

    Returns
    -------
    GlossySimulation

    Raises
    ------
    SimulationError
        Where matte and glossy reflection together are above 1.
    """
    rho = _matte_part(matte, gloss)
    cells = replace(matte.cells, reflectance=rho.max(axis=1))
    rays = rays_each(gloss, RAYS) if rays is None else rays
    points = int(np.clip(LAMP_POINTS // max(int(gloss.glossy.sum()), 1), FEWEST_RAYS, rays))
    factors = glossy_form_factors(cells, matte.factors, gloss, rays=rays, seed=seed)
    by_gloss = places_on(GlossySurface.of(cells, gloss), points, seed).lamp_by_gloss(light)
    direct = np.divide(matte.E, matte.reflectance, out=np.zeros_like(matte.E), where=matte.reflectance > 0)
    E = rho * (direct + by_gloss[:, None])
    solutions = [
        Radiosity(factors, column, tolerance=max(matte.residual, 1e-12)).solution(emitted)
        for column, emitted in zip(rho.T, E.T, strict=True)
    ]
    B = np.stack([solution.B for solution in solutions], axis=1)
    # What matte light is by each patch's own rays, and is not by factors made reciprocal; without rays nothing.
    own_rays = matte.irradiance - matte.factors.apply(matte.B)
    irradiance = np.maximum(factors.apply(B) + own_rays, 0.0) + by_gloss[:, None]
    return GlossySimulation(
        matte=matte,
        gloss=gloss,
        reflectance=rho,
        by_gloss=by_gloss,
        B=np.maximum(B + rho * own_rays, 0.0),
        irradiance=irradiance,
        slopes=_slopes(matte, irradiance),
        residual=max(solution.residual for solution in solutions),
        products=matte.products + sum(solution.products for solution in solutions),
    )


def refined_gloss_check(
    glossy: GlossySimulation,
    light: Lighting,
    model: Model,
    most_patches: int,
    *,
    rays: int | None = None,
    on_progress: OnProgress = unheard,
) -> Check:
    """Return the difference from a solution on finer cells with other rays, as ``refined_check`` does.

    Parameters
    ----------
    glossy, light, model
        The solution, and what its matte part was made by.
    most_patches : int
        Of the refined solution: cells are quartered, or quartered twice where this allows it. Where it does not and the
        model goes by rays, these tell how matte light varies within the quarters.
    rays : int, optional
        Pairs from each of the refined glossy patches; None: eight times as many in all as otherwise.
    on_progress : callable
        Is told the share that is done, where form factors are compressed or come from rays.

    Returns
    -------
    Check
    """
    coarse = glossy.matte.cells
    # With dense factors those by way of gloss, and the sum, are as large again.
    copies = 2 if model.sampling is None else 1
    times = 2 if copies * 16 * coarse.n_patches <= most_patches else 1
    fine, pieces = coarse, 4**times
    for _ in range(times):
        fine = fine.quarters()
    gloss = Gloss(np.tile(glossy.gloss.share, pieces), np.tile(glossy.gloss.roughness, pieces))
    rays = max(FEWEST_RAYS, 4 * rays_each(glossy.gloss, 2 * RAYS) // pieces) if rays is None else rays
    matte = simulate(fine, light, refined(model), on_progress)
    finer = glossy_simulation(matte, light, gloss, rays=rays, seed=OTHER_SEED)
    places = fine.quarters() if model.linear else fine
    difference = finer.irradiance_at(places) - glossy.irradiance_at(places)
    difference *= np.tile(matte.reflectance, (places.n_patches // fine.n_patches, 1))
    if model.sampling is not None and times == 1:
        at_points = glossy.irradiance_at(fine.quarters().quarters())
        squared = squared_at_points(matte, finer.irradiance, at_points, seed=OTHER_SEED)
    else:
        squared = (places.areas[:, None] * difference**2).sum(axis=0)
    squared *= pieces / (pieces - 1) / fine.areas.sum()
    return Check(float(np.sqrt(max(squared.max(), 0.0))), float(np.abs(difference).max()), fine.n_patches)


def bend_by_lobes(surface: Surface, gloss: Gloss) -> float:
    """Return how many times as large the error of patches may be where they are glossy, over that of matte ones.

    Matte patches send light evenly; lobes cast images of bright places and of shadows, that vary within patches where
    even light does not. sqrt(1 + (BEND s)²), s the share of all light sent back that lobes send back, was as much or
    more in rooms whose solutions were held against sixteenths.

    Parameters
    ----------
    surface : Surface
        Whose reflectance is its matte part.
    gloss : Gloss

    Returns
    -------
    float
        At least 1.
    """
    areas = np.asarray(surface.areas)
    glossy, matte = float(areas @ gloss.mean_albedo), float(areas @ np.asarray(surface.reflectance))
    return float(np.hypot(1.0, BEND * glossy / max(glossy + matte, np.finfo(float).tiny)))


def rays_each(gloss: Gloss, most: int) -> int:
    """Return the pairs of rays from each glossy patch."""
    glossy = max(int(gloss.glossy.sum()), 1)
    return int(np.clip(ALL_RAYS // glossy, FEWEST_RAYS, max(most, LEAST_OF_ALL // glossy)))


def gloss_cost(gloss: Gloss) -> Cost:
    """Return what gloss adds to a simulation, by constants measured on one core of two."""
    pairs = int(gloss.glossy.sum()) * rays_each(gloss, RAYS)
    return Cost(seconds=FIRST_S + PAIR_S * pairs, peak_mb=PAIR_MB * min(pairs, RAYS_AT_A_TIME) + KEPT_MB * pairs)


def _slopes(matte: Simulation, irradiance: FloatArray) -> FloatArray | None:
    """(P, 3, C) of the irradiance among glossy patches, where that among matte ones has some."""
    if matte.slopes is None:
        return None
    added = (irradiance - matte.irradiance).T
    return matte.slopes + np.stack([gradients(matte.cells, column)[0] for column in added], axis=2)


def _matte_part(matte: Simulation, gloss: Gloss) -> FloatArray:
    """(P, C) reflectance without the lobes."""
    rho = matte.reflectance - gloss.mean_albedo[:, None]
    if rho.min() < -1e-9 or (rho + gloss.share[:, None]).max() > 1 + 1e-9:
        raise SimulationError(
            f"{matte.cells.name}: matte reflectance {rho.min():.4g} ... {rho.max():.4g} beside a gloss of up to "
            f"{gloss.share.max():.4g}; both must lie in 0 ... 1, and so must their sum"
        )
    return np.asarray(np.clip(rho, 0.0, 1 - gloss.share[:, None]))
