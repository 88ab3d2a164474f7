"""The search for patches: from solution to finer solution by exact factors, or by rays where those are faster."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from sim.errors import SimulationError
from sim.geometry.adaptive_patches import AdaptivePatches
from sim.light.lighting import Lighting
from sim.planning.adapt import Refinement, SolvedPatches, uniform_patches
from sim.planning.cost import (
    COMPRESSED_PATCH_S,
    FEWEST_COMPRESSED,
    StepTiming,
    compressing_pays,
    largest_compressed,
    largest_dense,
)
from sim.planning.methods import (
    EVEN_PATCHES,
    FIRST_PROBE,
    exact_s,
    largest_sampled,
    planning_s,
    probe_s,
    rays_pay,
    rays_s,
    usual_patches,
)
from sim.planning.sampled.patches import patches_by_rays
from sim.planning.simulation import Model, simulate
from sim.progress import OnProgress, unheard

SAFETY = 1.25
"""The error that is expected over the error that a coarser solution shows; verified on all library scenes."""
REACH = 3
"""A plan has at most this many times the patches of the solution that it was made from."""
ADVICE = 1.3
"""The tolerance that is advised where one does not fit, over the one that may just fit."""
FINEST_COMPRESSION, COARSEST_COMPRESSION = 1e-4, 1e-2
"""Limits of the tolerance that compressed form factors are asked for: half of the plan's."""
GROWTH = 4
"""Rays may cut the patches of a room into so many: where these may not fit, exact factors are taken."""
PATCHES_SHARE = 0.8
"""Share of the tolerance that patches may take where the form factors come from rays; in squares."""
LEAST_SAMPLING, MOST_SAMPLING, ROUNDING = 0.5, 0.9, 1e-9
"""Shares of the tolerance between which the rays' own error is chosen, and by which it stays below what is left."""
LEFT_TO_RAYS = (1 - PATCHES_SHARE**2) ** 0.5
"""Share of the tolerance that patches leave to rays, whose memory goes by it."""
PROBE_SHARE = 0.2
"""A solution that takes at most this share of what rays are expected to is made first: it tells how many patches are
needed, of which rays know only what is usual. A sphere at 0.1 % needs a hundredth of that."""


class Search:
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
            self._most_by_rays,
        )
        self.timing = self.dense_timing = StepTiming(1, 0.0, 0.0)
        self.correction = 1.0
        self.on_progress: OnProgress = unheard
        self.one_number = False
        """Rays, whose light may have to be linear within patches, do not take the place of exact factors in rooms."""

    def run(self, by_rays: bool = False) -> None:
        """Find the patches."""
        adapted = self.whole.n_patches >= FIRST_PROBE
        probe_cells = self.begin = self.whole if adapted else uniform_patches(self.whole, FIRST_PROBE)
        usual = min(self._usual_patches, REACH * probe_cells.n_patches)
        planning_s = self._planning_s(probe_cells.n_patches, usual, adapted)
        if by_rays or (self._rays_pay(planning_s, self.begin.n_patches) and not self._probe_is_cheap(usual)):
            return self._go_by_rays()
        while True:
            probe = self._solve(probe_cells)
            self.refinement = Refinement.start(self.whole, probe, self.light)
            self.correction = self._missed(probe)
            self._meet_tolerance(probe)
            needed = self._needed()
            self.on_progress(min(1.0, probe_cells.n_patches / needed))
            if needed <= probe_cells.n_patches * (REACH if adapted else 0.5):
                break
            if needed > self.most_cells:
                raise SimulationError(self._refusal(needed))
            finer = min(max(needed // REACH + 1, FIRST_PROBE), REACH * probe_cells.n_patches)
            if self._rays_pay(self._planning_s(finer, needed, True), needed):
                return self._go_by_rays()
            refinement = Refinement.start(self.whole, probe, self.light)
            refinement.refine(0.0, finer)
            probe_cells, adapted = refinement.cells, True
        self._check_size(self.cells.n_patches)
        if self._rays_pay(self._factors_s(self.cells.n_patches), self.cells.n_patches):
            self._go_by_rays()

    def _go_by_rays(self) -> None:
        """Find the patches by rays, and what the rays of the model may leave of the tolerance."""
        self.by_rays = True
        self.most_cells = self._most_by_rays
        started = time.perf_counter()
        self.sampled = patches_by_rays(
            self.begin,
            self.light,
            goal=PATCHES_SHARE * self.tolerance,
            check_size=self._check_size,
            seed=self.model.seed,
            on_progress=self.on_progress,
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

    def _rays_pay(self, left_s: float, patches: int) -> bool:
        """Tell if rays beat what is left to do by exact factors [s].

        By constants, not by what was timed: the same plan whatever else the machine does.
        """
        patches = self._patches_by_rays(patches)
        tight = GROWTH * patches > self._most_by_rays
        if (tight or self.one_number) and self.whole.n_patches < FIRST_PROBE:
            return False
        return rays_pay(patches, self.sampling, left_s, linear=self._linear)

    def _probe_is_cheap(self, usual: int) -> bool:
        """Tell if the first solution takes little beside rays for the patches that are usual, and these fit.

        Where they do not, rays are refused at once, and no solution is waited for.
        """
        patches = self._patches_by_rays(usual)
        by_rays_s = rays_s(patches, self.sampling, linear=self._linear)
        cheap = probe_s(self._factors_s, self.begin.n_patches) <= PROBE_SHARE * by_rays_s
        return cheap and patches <= self._most_by_rays

    @property
    def _linear(self) -> bool:
        """Whether light by rays will have to be linear within patches."""
        return self.begin.n_patches < EVEN_PATCHES * self._usual_patches

    def _patches_by_rays(self, patches: int) -> int:
        """Where exact factors take so many."""
        patches = max(patches, self.begin.n_patches)
        # The error of linear light falls as the patches' number, that of one number a patch as its root.
        return int(np.ceil(np.sqrt(self.begin.n_patches * patches))) if self._linear else patches

    @property
    def _most_by_rays(self) -> int:
        return largest_sampled(self.memory_limit_mb, LEFT_TO_RAYS * self.tolerance)

    @property
    def _usual_patches(self) -> int:
        return usual_patches(self.tolerance, float(np.average(self.whole.reflectance, weights=self.whole.areas)))

    def _planning_s(self, probe: int, needed: int, adapted: bool) -> float:
        """From a solution on so many patches to the one on those that are needed, by exact factors [s]."""
        return planning_s(self._factors_s, probe, needed, adapted=adapted)

    def _factors_s(self, patches: int) -> float:
        model, occluders = self.model, len(self.whole.occluders)
        seconds = exact_s(patches, method=model.method, visibility=model.visibility, occluders=occluders)
        if model.visibility != "none" and patches >= FEWEST_COMPRESSED:
            return min(seconds, COMPRESSED_PATCH_S * patches)
        return seconds

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
