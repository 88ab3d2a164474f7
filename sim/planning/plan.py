"""Model only what a scene needs: from a tolerance to patches, method, visibility, solver and bounces, and why.

The error is that of the light between the surfaces: the RMS over the surface of the radiosity, each patch's being
constant, or linear where rays found it, in percent of white (irradiance 1 on a white surface). Direct light is known at
every point and carries none. The plan is made from coarser solutions of the same scene (``sim.planning.adapt``): what
they show is corrected by what a still coarser plan missed against them, and multiplied by SAFETY
(``sim.planning.search``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim.arguments import array_of, check_kind, number_of
from sim.errors import SimulationError
from sim.form_factors import closed_form
from sim.form_factors.factors import Visibility
from sim.geometry.adaptive_patches import AdaptivePatches, coarsest_patches
from sim.geometry.surface import Surface
from sim.light.lighting import Lighting, PlacedProjector, make_test_lighting
from sim.planning.cost import (
    OTHER_PRODUCTS,
    Cost,
    compressed_cost,
    dense_cost,
    dense_mb,
    light_mb,
    measured_machine,
    products_needed,
)
from sim.planning.methods import RAY_PRODUCT_S, bounces_needed, rays_needed, sampled_mb, sampled_s
from sim.planning.search import SAFETY, Search
from sim.planning.simulation import Model
from sim.progress import OnProgress, unheard

FAIR_TOLERANCE = 1.0
"""From this tolerance on, fair visibility is enough. [%]"""
FINEST_PERCENT, COARSEST_PERCENT = 1e-6, 100.0
"""Limits of a tolerance: below, the solver's rounding counts; above, black would do."""
LEAST_MEMORY_MB = 1.0
"""Less than the smallest model takes."""
SOLVER_SHARE = 1e-4
"""Share of the tolerance that is left to the solver."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan:
    """The cheapest model that meets a tolerance, and what it is expected to cost."""

    cells: AdaptivePatches
    light: Lighting
    model: Model
    solver: str
    channels: int
    """Solves: different reflectances of the colours."""
    bounces: int
    """After which less than a tenth of the tolerance is left."""
    reasons: tuple[str, ...]
    """A sentence for each choice."""
    tolerance_percent: float
    error_percent: float
    """Expected, RMS over the surface. [% of white]"""
    seconds: float
    """Expected."""
    peak_mb: float
    """Expected peak memory. [MB = 1e6 bytes]"""

    @property
    def patches(self) -> int:
        """Number of patches."""
        return self.cells.n_patches


def plan(
    surface: Surface,
    tolerance_percent: float,
    light: str | PlacedProjector = "projector",
    *,
    memory_limit_mb: float = 4096.0,
    reflectances: tuple[float, ...] | None = None,
    by_rays: bool = False,
    one_number: bool = False,
    on_progress: OnProgress = unheard,
) -> Plan:
    """Return the cheapest model of a surface that meets a tolerance.

    Parameters
    ----------
    surface : Surface
        A scene, whose faces are cut anew, or a mesh, whose patches are the coarsest ones.
    tolerance_percent : float
        Error allowed, RMS over the surface. [% of white]
    light : str or PlacedProjector
        One of ``sim.light.lighting.TEST_LIGHTINGS``, or a projector of one's own.
    memory_limit_mb : float
        What may be used. [MB = 1e6 bytes]
    reflectances : tuple of float, optional
        One for each colour, the same on all surfaces, instead of the surface's own.
    by_rays : bool
        Form factors by rays whatever they cost: they create no light where patches cut or cover each other.
    one_number : bool
        Light is one number within each patch of a room, whatever that costs: of light by lobes no slopes are known.
    on_progress : callable
        Is told the share that is done, as far as it can be known.

    Returns
    -------
    Plan

    Raises
    ------
    SimulationError
        For a tolerance outside of 1e-6 ... 100 %, an unknown light, or a model that does not fit in memory.
    """
    check_kind("plan", surface, "vertices", "a scene or mesh")
    _check_demands(number_of("tolerance", tolerance_percent), memory_limit_mb)
    whole = coarsest_patches(surface)
    colours = None
    if reflectances is not None:
        rho = array_of("reflectances", reflectances)
        if rho.ndim != 1 or not len(rho) or not ((rho >= 0) & (rho <= 1)).all():
            raise SimulationError(f"reflectances {rho.tolist()}; give a number from 0 to 1 for each colour")
        whole = replace(whole, reflectance=np.full(whole.n_patches, max(reflectances)))
        colours = tuple(sorted(set(reflectances), reverse=True))
    chosen_light = make_test_lighting(light, whole)
    model = Model(
        method="closed_form" if closed_form.applies(whole) else "polygon",
        visibility=_visibility(whole, tolerance_percent),
        residual=SOLVER_SHARE * tolerance_percent / 100,
    )
    search = Search(whole, chosen_light, model, tolerance=tolerance_percent / 100, memory_limit_mb=memory_limit_mb)
    search.on_progress, search.one_number = on_progress, one_number
    search.run(by_rays)
    model = replace(search.model_for(search.cells), reflectances=colours)
    channels, radius = 1 if colours is None else len(colours), search.spectral_radius
    products = products_needed(radius, model.residual)
    cost = _cost(search, model, products, channels)
    bounces = bounces_needed(radius, tolerance_percent)
    return Plan(
        cells=search.cells,
        light=chosen_light,
        model=model,
        solver="conjugate gradients",
        channels=channels,
        bounces=bounces,
        reasons=_reasons(search, channels=channels, bounces=bounces, products=products),
        tolerance_percent=tolerance_percent,
        error_percent=100 * search.error,
        seconds=cost.seconds,
        peak_mb=cost.peak_mb,
    )


def _check_demands(tolerance_percent: float, memory_limit_mb: float) -> None:
    if not FINEST_PERCENT <= tolerance_percent <= COARSEST_PERCENT:
        raise SimulationError(
            f"a tolerance of {tolerance_percent:g} % of white; it must be above 0: {FINEST_PERCENT:g} ... "
            f"{COARSEST_PERCENT:g} %"
        )
    if not LEAST_MEMORY_MB <= number_of("memory", memory_limit_mb):
        raise SimulationError(
            f"a memory of {memory_limit_mb:g} MB; give a finite number of at least {LEAST_MEMORY_MB:g} MB"
        )


def _cost(search: Search, model: Model, products: int, channels: int) -> Cost:
    patches = search.cells.n_patches
    if model.sampling is not None:
        solve_s = channels * (products + OTHER_PRODUCTS) * patches * rays_needed(model.sampling) * RAY_PRODUCT_S
        light_s = search.timing.light_s * patches / search.timing.patches
        peak_mb = sampled_mb(patches, model.sampling) + light_mb(patches)
        return Cost(sampled_s(patches, model.sampling) + light_s + solve_s, peak_mb)
    if model.compression is not None:
        return compressed_cost(patches, products, channels, timing=search.timing)
    return dense_cost(patches, products, channels, timing=search.dense_timing, machine=measured_machine())


def _visibility(cells: AdaptivePatches, tolerance_percent: float) -> Visibility:
    if cells.convex or len(cells.occluders) == 0:
        return "none"
    return "fair" if tolerance_percent >= FAIR_TOLERANCE else "exact"


def _reasons(search: Search, *, channels: int, bounces: int, products: int) -> tuple[str, ...]:
    cells, patches = search.cells, search.cells.n_patches
    radius, sizes_m = search.spectral_radius, np.sqrt(cells.areas)
    method = {
        "closed_form": "rectangles along three perpendicular directions: closed form factors, exact",
        "polygon": "faces at any angle: exact factor of a point to a polygon, at Gauss points of the other patch",
    }
    chosen = search.model_for(cells)
    if chosen.sampling is not None:
        method["rays"] = (
            f"{patches} patches: form factors by about {rays_needed(chosen.sampling):.0f} rays each, more where the "
            f"light needs them, to {100 * chosen.sampling:.2g} % of white"
        )
    if chosen.compression is not None:
        method[chosen.method] = (
            f"{patches} patches: blocks of the form factors compressed, "
            f"instead of {dense_mb(patches):.0f} MB for the whole matrix"
        )
    occluders = len(search.whole.occluders)
    visibility = {
        "none": "nothing stands between two points: no visibility test",
        "fair": f"{occluders} occluders, and {FAIR_TOLERANCE:g} % or more is allowed: fair visibility",
        "rays": f"{occluders} occluders: shafts between clusters, rays where a pair is partly hidden",
        "exact": f"{occluders} occluders and a tight tolerance: exact visibility",
    }
    colours = (
        "one reflectance for all colours: one solve" if channels == 1 else f"{channels} different colours: a solve each"
    )
    return (
        f"light: {search.light.description}",
        f"{patches} patches of {sizes_m.min():.2g} to {sizes_m.max():.2g} m, small where light changes fast: "
        f"{100 * search.error:.2g} % expected, {100 * search.tolerance:g} % allowed",
        f"planned on a solution of {search.timing.patches} patches; expected error x {SAFETY:g} for safety",
        method[chosen.method],
        "the rays find the shadows" if chosen.sampling is not None else visibility[chosen.visibility_done],
        f"conjugate gradients to a residual of {search.model.residual:.0e}: about {products} products with the matrix",
        colours,
        f"each bounce keeps {100 * radius:.0f} % of the light: {bounces} bounces leave less than a tenth of the "
        "tolerance; the solver leaves less",
    )
