"""Light among glossy surfaces under a test lighting, from that of matte ones that send back as much."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.geometry.adaptive_patches import AdaptivePatches
from sim.geometry.rays import trace
from sim.geometry.surface import Surface
from sim.light.gloss.exchange import MOST_RAYS, RAYS_AT_A_TIME, glossy_form_factors
from sim.light.gloss.material import Gloss
from sim.light.gloss.walks import GlossySurface
from sim.light.lighting import Lighting
from sim.light.radiosity import Radiosity
from sim.planning.adapt import gradients
from sim.planning.check import Check, refined, squared_at_points
from sim.planning.cost import Cost
from sim.planning.gloss_places import places_on
from sim.planning.simulation import Model, Simulation, light_at, simulate
from sim.progress import OnProgress, part_of, unheard

RAYS, FEWEST_RAYS, LEAST_OF_ALL, ALL_RAYS = 256, 32, 1 << 14, 1 << 21
"""Pairs of rays from each glossy patch, half of them for each of two solutions whose difference tells their noise. Of
all of them together between the last two numbers, but 32 at least: patches of a fine mesh share what is around them."""
MOST_PAIRS = 1 << 24
"""Of all patches together, where less noise is asked for: two minutes of one core."""
NEEDED = 1.2
"""Pairs that are taken over those that the measured noise asks for, where it falls with the root of their number."""
LAMP_POINTS = 1 << 18
"""On all glossy patches at a time, from which the lamp's light goes on."""
FIRST_S, PAIR_S, PLACED_PAIR_S = 0.3, 4e-6, 1.1e-5
"""Of the table of albedos; of a pair of rays with the lamp's point that goes with it, in light from everywhere and from
a place, whose shadows are looked for: 3.5 to 7.1 and 7.7 to 12.6 microseconds of processor time, 6 to 2,144 patches
(benchmarks/gloss_honesty.py --pairs)."""
PAIR_MB, KEPT_MB = 1e-3, 2.5e-4
"""Memory of a pair at work, and of what is kept of it: 80 to 3,531 patches, all glossy."""
BEND = 2.5
"""What lobes add to the error that patches leave, in squares, over the share of all reflected light that they send. In
rooms of gloss 0.1 to 0.6 and roughness 0.1 to 0.8, on patches for 3 and 4 %, it was 0.9 to 2.1, and 2.4 where lobes
sent 0.14 of the light (benchmarks/gloss_honesty.py --bend)."""
OTHER_SEED = 1_000_033
MATTE_SHARE, PAIRS_SHARE = 0.3, 0.7
"""Of the work, roughly: a check's matte light, and of lobes the pairs of rays before the lamp's points."""
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
    halves: tuple[FloatArray, FloatArray]
    """(P, C) irradiances of two solutions by half of the rays each, of which everything here is the mean."""
    noise: float
    """RMS over the surface of the radiosity that the rays of lobes left, from those two; of the worst colour."""
    rays: int
    """Pairs from each glossy patch, of both together."""
    residual: float
    products: int

    def irradiance_at(self, pieces: AdaptivePatches) -> FloatArray:
        """Return the irradiance at the centres of pieces of the patches, as that of :class:`Simulation`."""
        return light_at(pieces, self.matte.cells, self.irradiance, self.slopes)

    def halves_at(self, pieces: AdaptivePatches) -> tuple[FloatArray, FloatArray]:
        """Return that of the two solutions by half of the rays each, whose noise is independent."""
        one, other = (light_at(pieces, self.matte.cells, half, _slopes(self.matte, half)) for half in self.halves)
        return one, other


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
    matte: Simulation,
    light: Lighting,
    gloss: Gloss,
    *,
    rays: int | None = None,
    noise: float | None = None,
    seed: int = 0,
    on_progress: OnProgress = unheard,
) -> GlossySimulation:
    """Return the light of a scene with glossy patches, from that of matte ones that send back as much of even light.

    It is solved twice, by half of the rays each: the mean is returned, and half of the difference is its noise.

    Parameters
    ----------
    matte : Simulation
        Its reflectance is ρ + ρ_s ā.
    light : Lighting
        That it was made for.
    gloss : Gloss
        Of its cells.
    rays : int, optional
        Pairs from each glossy patch, 32 at least; None: 256, fewer where there are many patches.
    noise : float, optional
        That they may leave, RMS over the surface; 1 = white. Where they leave more, it is done again by as many as
        that needs, twice as many at least, up to the most there are: the result says what they left. None: whatever
        they leave.
    seed : int
        Another one for other rays.
    on_progress : callable
        Is told the share that is done; where rays may have to be sent again, each time half of what is left.

    Returns
    -------
    GlossySimulation

    Raises
    ------
    SimulationError
        Where matte and glossy reflection together are above 1.
    """
    rays = rays_each(gloss, RAYS) if rays is None else rays
    most, begun = max(most_rays(gloss), rays), 0.0
    # The noise of few patches is itself not known well: it may take more than one step.
    while True:
        end = 1.0 if noise is None or rays == most else (1 + begun) / 2
        found = _by_halves(matte, light, gloss, rays=rays, seed=seed, on_progress=part_of(on_progress, begun, end))
        if noise is None or found.noise <= noise or rays == most:
            return found
        rays, begun = min(max(rays_for(found.noise, rays, noise), 2 * rays), most), end


def _by_halves(
    matte: Simulation, light: Lighting, gloss: Gloss, *, rays: int, seed: int, on_progress: OnProgress
) -> GlossySimulation:
    rho = _matte_part(matte, gloss)
    both = [
        _solved(
            *(matte, light, gloss, rho),
            rays=rays // 2,
            seed=2 * seed + half,
            on_progress=part_of(on_progress, half / 2, (half + 1) / 2),
        )
        for half in (0, 1)
    ]
    irradiance = (both[0].irradiance + both[1].irradiance) / 2
    glossy = GlossySimulation(
        matte=matte,
        gloss=gloss,
        reflectance=rho,
        by_gloss=(both[0].by_gloss + both[1].by_gloss) / 2,
        B=(both[0].B + both[1].B) / 2,
        irradiance=irradiance,
        slopes=_slopes(matte, irradiance),
        halves=(both[0].irradiance, both[1].irradiance),
        noise=0.0,
        rays=rays,
        residual=max(half.residual for half in both),
        products=matte.products + sum(half.products for half in both),
    )
    return replace(glossy, noise=_noise(glossy))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Solved:
    """Light by some rays."""

    by_gloss: FloatArray
    B: FloatArray
    irradiance: FloatArray
    residual: float
    products: int


def _solved(
    matte: Simulation,
    light: Lighting,
    gloss: Gloss,
    rho: FloatArray,
    *,
    rays: int,
    seed: int,
    on_progress: OnProgress,
) -> _Solved:
    cells = replace(matte.cells, reflectance=rho.max(axis=1))
    told = part_of(on_progress, 0.0, PAIRS_SHARE)
    factors = glossy_form_factors(cells, matte.factors, gloss, rays=rays, seed=seed, on_progress=told)
    told = part_of(on_progress, PAIRS_SHARE, 1.0)
    by_gloss = _lamp_by_gloss(GlossySurface.of(cells, gloss), light, rays, seed=seed, on_progress=told)
    direct = np.divide(matte.E, matte.reflectance, out=np.zeros_like(matte.E), where=matte.reflectance > 0)
    E = rho * (direct + by_gloss[:, None])
    solutions = [
        Radiosity(factors, column, tolerance=max(matte.residual, 1e-12)).solution(emitted)
        for column, emitted in zip(rho.T, E.T, strict=True)
    ]
    B = np.stack([solution.B for solution in solutions], axis=1)
    # What matte light is by each patch's own rays, and is not by factors made reciprocal; without rays nothing.
    own_rays = matte.irradiance - matte.factors.apply(matte.B)
    return _Solved(
        by_gloss=by_gloss,
        B=np.maximum(B + rho * own_rays, 0.0),
        irradiance=np.maximum(factors.apply(B) + own_rays, 0.0) + by_gloss[:, None],
        residual=max(solution.residual for solution in solutions),
        products=sum(solution.products for solution in solutions),
    )


def _lamp_by_gloss(
    glossy: GlossySurface, light: Lighting, points: int, *, seed: int, on_progress: OnProgress
) -> FloatArray:
    """(P,) irradiance by light that came straight from the lamp to glossy patches, from some points on each."""
    glossy_patches = max(int(glossy.gloss.glossy.sum()), 1)
    parts = -(-points * glossy_patches // LAMP_POINTS)
    each = max(points // parts, 1)
    found = []
    for part in range(parts):
        found.append(places_on(glossy, each, (seed, part)).lamp_by_gloss(light))
        on_progress((part + 1) / parts)
    return np.asarray(np.mean(found, axis=0))


def _noise(glossy: GlossySimulation) -> float:
    """RMS over the surface of half the difference of two halves, where light is linear on quarters of patches."""
    cells = glossy.matte.cells
    pieces = cells if glossy.slopes is None else cells.quarters()
    one, other = glossy.halves_at(pieces)
    rho = np.tile(glossy.matte.reflectance, (pieces.n_patches // cells.n_patches, 1))
    squared = pieces.areas @ (rho * (one - other) / 2) ** 2
    return float(np.sqrt(squared.max() / pieces.areas.sum()))


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

    The finer solution's two halves are compared apart, and the differences multiplied: the noise of its own rays leaves
    no bias, that of the solution itself is part of its error.

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
        Is told the share that is done.

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
    if rays is None:
        rays = max(FEWEST_RAYS, 4 * max(rays_each(glossy.gloss, 2 * RAYS), glossy.rays) // pieces)
    matte = simulate(fine, light, refined(model), part_of(on_progress, 0.0, MATTE_SHARE))
    told = part_of(on_progress, MATTE_SHARE, 1.0)
    finer = glossy_simulation(matte, light, gloss, rays=rays, seed=OTHER_SEED, on_progress=told)
    places = fine.quarters() if model.linear else fine
    ours, rho = glossy.irradiance_at(places), np.tile(matte.reflectance, (places.n_patches // fine.n_patches, 1))
    one, other = (rho * (half - ours) for half in finer.halves_at(places))
    if model.sampling is not None and times == 1:
        at_points = glossy.irradiance_at(fine.quarters().quarters())
        squared = squared_at_points((matte, matte), finer.halves, at_points, sampling=model.sampling, seed=OTHER_SEED)
    else:
        squared = (places.areas[:, None] * one * other).sum(axis=0)
    squared *= pieces / (pieces - 1) / fine.areas.sum()
    largest = float(np.abs(one + other).max() / 2)
    return Check(float(np.sqrt(max(squared.max(), 0.0))), largest, fine.n_patches, finer.noise)


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


def most_rays(gloss: Gloss) -> int:
    """Return the most pairs of rays from each glossy patch."""
    return int(np.clip(MOST_PAIRS // max(int(gloss.glossy.sum()), 1), FEWEST_RAYS, 2 * MOST_RAYS))


def rays_for(noise: float, rays: int, allowed: float) -> int:
    """Return the pairs from each glossy patch that leave ``allowed`` noise where ``rays`` left ``noise``."""
    return int(np.ceil(NEEDED * rays * (noise / allowed) ** 2))


def gloss_cost(gloss: Gloss, rays: int, light: Lighting) -> Cost:
    """Return what gloss adds to a simulation by pairs of rays each, by constants measured on one core."""
    pairs = int(gloss.glossy.sum()) * rays
    pair_s = PAIR_S if light.source_m is None else PLACED_PAIR_S
    return Cost(seconds=FIRST_S + pair_s * pairs, peak_mb=PAIR_MB * min(pairs, RAYS_AT_A_TIME) + KEPT_MB * pairs)


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
