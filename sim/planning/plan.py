"""Model only what a scene needs: from a tolerance to patches, method, visibility, solver and bounces, and why.

The error is that of the light between the surfaces: the RMS over the surface of the radiosity, each patch's being
constant, or linear where rays found it, in percent of white (irradiance 1 on a white surface). Direct light is known at
every point and carries none. The plan is made from coarser solutions of the same scene (``sim.planning.adapt``): what
they show is corrected by what a still coarser plan missed against them, and multiplied by SAFETY.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from sim.arguments import array_of, check_kind, number_of
from sim.errors import SimulationError
from sim.form_factors import closed_form
from sim.form_factors.factors import Visibility
from sim.geometry.adaptive_patches import AdaptivePatches, coarsest_patches
from sim.geometry.surface import Surface
from sim.light.lighting import Lighting, PlacedProjector, make_test_lighting
from sim.planning.adapt import Refinement, SolvedPatches, uniform_patches
from sim.planning.cost import (
    COMPRESSED_PATCH_S,
    FEWEST_COMPRESSED,
    OTHER_PRODUCTS,
    Cost,
    StepTiming,
    compressed_cost,
    compressing_pays,
    dense_cost,
    dense_mb,
    largest_compressed,
    largest_dense,
    measured_machine,
    products_needed,
)
from sim.planning.methods import (
    RAY_PRODUCT_S,
    exact_s,
    largest_sampled,
    rays_needed,
    rays_pay,
    sampled_mb,
    sampled_s,
)
from sim.planning.sampled_patches import patches_by_rays
from sim.planning.simulation import Model, simulate

SAFETY = 1.25
"""The error that is expected over the error that a coarser solution shows; verified on all library scenes."""
FIRST_PROBE = 500
"""Patches of the first solution."""
REACH = 3
"""A plan has at most this many times the patches of the solution that it was made from."""
FAIR_TOLERANCE = 1.0
"""From this tolerance on, fair visibility is enough. [%]"""
ADVICE = 1.3
"""The tolerance that is advised where one does not fit, over the one that may just fit."""
FINEST_COMPRESSION, COARSEST_COMPRESSION = 1e-4, 1e-2
"""Limits of the tolerance that compressed form factors are asked for: half of the plan's."""
FINEST_PERCENT, COARSEST_PERCENT = 1e-6, 100.0
"""Limits of a tolerance: below, the solver's rounding counts; above, black would do."""
LEAST_MEMORY_MB = 1.0
"""Less than the smallest model takes."""
PATCHES_SHARE = 0.8
"""Share of the tolerance that patches may take where the form factors come from rays; in squares."""
LEAST_SAMPLING, MOST_SAMPLING, ROUNDING = 0.5, 0.9, 1e-9
"""Shares of the tolerance between which the rays' own error is chosen, and by which it stays below what is left."""
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
        if rho.ndim != 1 or not len(rho):
            raise SimulationError(f"reflectances of shape {rho.shape}; give one for each colour")
        whole = replace(whole, reflectance=np.full(whole.n_patches, max(reflectances)))
        colours = tuple(sorted(set(reflectances), reverse=True))
    chosen_light = make_test_lighting(light, whole)
    model = Model(
        method="closed_form" if closed_form.applies(whole) else "polygon",
        visibility=_visibility(whole, tolerance_percent),
        residual=SOLVER_SHARE * tolerance_percent / 100,
    )
    search = _Search(whole, chosen_light, model, tolerance=tolerance_percent / 100, memory_limit_mb=memory_limit_mb)
    search.run(by_rays)
    model = replace(search.model_for(search.cells), reflectances=colours)
    channels = 1 if colours is None else len(colours)
    radius = search.spectral_radius
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


class _Search:
    """From solution to finer solution, until one is fine enough to tell the patches that a tolerance needs."""

    def __init__(
        self, whole: AdaptivePatches, light: Lighting, model: Model, *, tolerance: float, memory_limit_mb: float
    ) -> None:
        self.whole, self.light, self.model, self.tolerance = whole, light, model, tolerance
        self.memory_limit_mb = memory_limit_mb
        self.sampling, self.by_rays = LEAST_SAMPLING * tolerance, False
        self.most_cells = max(
            largest_dense(memory_limit_mb),
            largest_compressed(memory_limit_mb),
            largest_sampled(memory_limit_mb, self.sampling),
        )
        self.timing = self.dense_timing = StepTiming(1, 0.0, 0.0)
        self.correction = 1.0

    def run(self, by_rays: bool = False) -> None:
        """Find the patches."""
        if by_rays or self._rays_pay(max(FIRST_PROBE, self.whole.n_patches)):
            return self._go_by_rays()
        many = self.whole.n_patches >= FIRST_PROBE
        probe_cells, adapted = self.whole if many else uniform_patches(self.whole, FIRST_PROBE), many
        while True:
            probe = self._solve(probe_cells)
            self.refinement = Refinement.start(self.whole, probe, self.light)
            self.correction = self._missed(probe)
            self._meet_tolerance(probe)
            needed = self._needed()
            if needed <= probe_cells.n_patches * (REACH if adapted else 0.5):
                break
            if needed > self.most_cells:
                raise SimulationError(self._refusal(needed))
            finer = Refinement.start(self.whole, probe, self.light)
            finer.refine(0.0, min(max(needed // REACH + 1, FIRST_PROBE), REACH * probe_cells.n_patches))
            probe_cells, adapted = finer.cells, True
        self._check_size(self.cells.n_patches)
        if self._rays_pay(self.cells.n_patches):
            self._go_by_rays()

    def _go_by_rays(self) -> None:
        """Find the patches by rays, and what the rays of the model may leave of the tolerance."""
        self.by_rays = True
        self.most_cells = largest_sampled(self.memory_limit_mb, self.sampling)
        started = time.perf_counter()
        self.sampled = patches_by_rays(
            uniform_patches(self.whole, FIRST_PROBE) if self.whole.n_patches < FIRST_PROBE else self.whole,
            self.light,
            goal=PATCHES_SHARE * self.tolerance,
            check_size=self._check_size,
            seed=self.model.seed,
        )
        self.timing = StepTiming(self.cells.n_patches, 0.0, time.perf_counter() - started)
        self.spectral_radius = self.sampled.spectral_radius
        left = (1 - ROUNDING) * np.sqrt(max(self.tolerance**2 - self.patches_error**2, 0.0)) / self.tolerance
        self.sampling = self.tolerance * float(np.clip(left, LEAST_SAMPLING, MOST_SAMPLING))

    def _check_size(self, patches: int) -> None:
        if patches > self.most_cells:
            raise SimulationError(self._refusal(patches))

    @property
    def cells(self) -> AdaptivePatches:
        """The patches that meet the tolerance."""
        return self.sampled.cells if self.by_rays else self.refinement.cells

    @property
    def patches_error(self) -> float:
        """Expected of light that is one number a patch, with safety; 1 = white."""
        return self.sampled.error if self.by_rays else SAFETY * self.correction * self.refinement.error

    @property
    def error(self) -> float:
        """Expected, with safety; 1 = white."""
        sampling = self.model_for(self.cells).sampling or 0.0
        return float(np.hypot(self.patches_error, sampling))

    def model_for(self, cells: AdaptivePatches) -> Model:
        """Give the cheapest model for so many patches that fits."""
        if not self.by_rays:
            return self._exact_for(cells)
        linear = self.sampled.linear
        return replace(self.model, method="rays", visibility="rays", sampling=self.sampling, linear=linear)

    def _rays_pay(self, patches: int) -> bool:
        """By constants, not by what was timed: the same plan whatever else the machine does."""
        model, occluders = self.model, len(self.whole.occluders)
        seconds = exact_s(patches, method=model.method, visibility=model.visibility, occluders=occluders)
        if model.visibility != "none" and patches >= FEWEST_COMPRESSED:
            seconds = min(seconds, COMPRESSED_PATCH_S * patches)
        return rays_pay(patches, self.sampling, seconds)

    def _exact_for(self, cells: AdaptivePatches) -> Model:
        """Whole matrix, or compressed where that is faster, or where the matrix does not fit."""
        slow = self.model.visibility != "none" and compressing_pays(cells.n_patches, self.dense_timing)
        if slow or cells.n_patches > largest_dense(self.memory_limit_mb):
            compression = float(np.clip(self.tolerance / 2, FINEST_COMPRESSION, COARSEST_COMPRESSION))
            return replace(self.model, compression=compression)
        return self.model

    def _solve(self, cells: AdaptivePatches) -> SolvedPatches:
        model = self.model_for(cells)
        solved = simulate(cells, self.light, model)
        self.spectral_radius = solved.spectral_radius
        self.timing = StepTiming(cells.n_patches, solved.factors_s, solved.light_s)
        if model.compression is None and model.sampling is None:
            self.dense_timing = self.timing
        return SolvedPatches.of(cells, solved.irradiance[:, 0])

    def _missed(self, probe: SolvedPatches) -> float:
        """Error that a plan of a quarter of the probe's patches shows against the probe, over what it expected."""
        if self.whole.n_patches > probe.cells.n_patches // REACH:
            return 1.0
        coarse = Refinement.start(self.whole, probe, self.light)
        coarse.refine(0.0, max(probe.cells.n_patches // REACH, self.whole.n_patches + 1))
        if coarse.error <= 1e-9:
            return 1.0
        return max(1.0, self._measured(coarse) / coarse.error)

    def _measured(self, refinement: Refinement) -> float:
        model = self.model_for(refinement.cells)
        return refinement.measured_error(simulate(refinement.cells, self.light, model).irradiance[:, 0])

    def _meet_tolerance(self, probe: SolvedPatches) -> None:
        goal = self.tolerance / SAFETY
        most = 2 * REACH * probe.cells.n_patches
        self.refinement.refine(goal / self.correction, most)
        # A plan coarser than the probe is measured against it, and refined until that is within the goal.
        while self.cells.n_patches <= probe.cells.n_patches // 2 and self.refinement.error > 1e-9:
            measured = self._measured(self.refinement)
            self.correction = measured / self.refinement.error
            if measured <= goal:
                return
            self.refinement.refine(0.9 * goal / self.correction, most)

    def _needed(self) -> int:
        """Patches that the tolerance needs; where they were not all made, from error ~ patches^(-1/2)."""
        return int(self.cells.n_patches * max(1.0, self.patches_error / self.tolerance) ** 2)

    def _refusal(self, needed: int) -> str:
        possible = 100 * self.tolerance * ADVICE * np.sqrt(needed / self.most_cells)
        return (
            f"{100 * self.tolerance:g} % needs about {needed:,} patches, "
            f"{self.memory_limit_mb:.0f} MB hold {self.most_cells:,}; try a tolerance of {possible:.2g} %"
        )


def _cost(search: _Search, model: Model, products: int, channels: int) -> Cost:
    patches = search.cells.n_patches
    if model.sampling is not None:
        solve_s = channels * (products + OTHER_PRODUCTS) * patches * rays_needed(model.sampling) * RAY_PRODUCT_S
        light_s = search.timing.light_s * patches / search.timing.patches
        return Cost(sampled_s(patches, model.sampling) + light_s + solve_s, sampled_mb(patches, model.sampling))
    if model.compression is not None:
        return compressed_cost(patches, products, channels, timing=search.timing)
    return dense_cost(patches, products, channels, timing=search.dense_timing, machine=measured_machine())


def _visibility(cells: AdaptivePatches, tolerance_percent: float) -> Visibility:
    if cells.convex or len(cells.occluders) == 0:
        return "none"
    return "fair" if tolerance_percent >= FAIR_TOLERANCE else "exact"


def bounces_needed(spectral_radius: float, tolerance_percent: float) -> int:
    """Return the bounces after which what is left, r^(n + 1) / (1 - r), is below a tenth of the tolerance."""
    if spectral_radius <= 0:
        return 0
    left = tolerance_percent / 1000 * (1 - spectral_radius)
    return max(1, int(np.ceil(np.log(left) / np.log(spectral_radius))) - 1) if left < spectral_radius else 1


def _reasons(search: _Search, *, channels: int, bounces: int, products: int) -> tuple[str, ...]:
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
