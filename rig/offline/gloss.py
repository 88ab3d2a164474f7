"""The gloss of a simulation: from its request or its mesh file, and whether matte patches would be enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from rig.errors import UsageError
from rig.offline.records import GlossSummary
from sim.errors import SimulationError
from sim.geometry.mesh import Mesh
from sim.geometry.scene import Scene
from sim.geometry.surface import Surface
from sim.light.gloss.material import Gloss, matte_equivalent
from sim.light.lighting import Lighting, PlacedProjector
from sim.planning.cost import Cost
from sim.planning.gloss import (
    FEWEST_RAYS,
    RAYS,
    GlossySimulation,
    bend_by_lobes,
    gloss_cost,
    gloss_of_cells,
    glossy_simulation,
    most_rays,
    rays_each,
    rays_for,
)
from sim.planning.gloss_effect import GlossEffect, gloss_effect
from sim.planning.plan import Plan, plan
from sim.planning.simulation import Simulation, simulate
from sim.progress import OnProgress, unheard

if TYPE_CHECKING:
    from pathlib import Path

    from rig.files.mesh import TriangleSoup

_Planned = TypeVar("_Planned")

PROBE_PERCENT = 4.0
"""Tolerance of the plan on which the error of matte patches is estimated: tens of patches in the library's rooms."""
SAFETY = 1.25
"""On the largest figure of such a plan: finer ones found 1.03 times as much (benchmarks/gloss_honesty.py)."""
DEFAULT_ROUGHNESS = 0.3
PATCHES_SHARE, NOISE_SHARE = 0.9, 0.43
"""Of a tolerance, that patches and the rays of lobes may leave; together, in squares, less than 1. Four times the pairs
halve the noise, and four times the patches the error that they leave, at more cost each."""
NOISE_SAFETY = 1.2
"""On the noise that the coarse plan's rays left: halves of 256 pairs tell it within some 20 % (16 tries, two rooms)."""
FAR_TOO_MANY = 2.0
"""Times the most pairs, beyond which it is not worth trying."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GlossyScene:
    """A surface whose reflectance is its matte part, and its gloss; None: it has none."""

    surface: Scene | Mesh
    gloss: Gloss | None

    @property
    def as_matte(self) -> Scene | Mesh:
        """The surface with matte patches that send back as much of even light."""
        if self.gloss is None:
            return self.surface
        return self.surface.with_reflectance(matte_equivalent(self.surface, self.gloss))

    def reflectances(self, matte: tuple[float, ...]) -> tuple[float, ...] | None:
        """Return what patches reflect in all, for one number a colour of their matte part; None for none.

        Raises
        ------
        UsageError
            If the patches' gloss differs: then their reflectance in all does.
        """
        if not matte or self.gloss is None:
            return matte or None
        more = self.gloss.mean_albedo
        if np.ptp(more) > 0 and len(matte) > 1:
            raise UsageError(
                "--reflectance: several colours need one --gloss for all patches; give one number, or both"
            )
        return None if np.ptp(more) > 0 else tuple(min(value + float(more[0]), 1.0) for value in matte)


def with_gloss(
    surface: Scene | Mesh, gloss: float | None, roughness: float | None, reflectances: tuple[float, ...]
) -> GlossyScene:
    """Give all patches one gloss. Raises UsageError where it does not go with their reflectance."""
    if gloss is None:
        if roughness is not None:
            raise UsageError("--roughness says how rough a gloss is; give --gloss too")
        return GlossyScene(surface=surface, gloss=None)
    try:
        matte = surface.with_reflectance(max(reflectances)) if reflectances else surface
        lobe = Gloss.of(matte, gloss, DEFAULT_ROUGHNESS if roughness is None else roughness)
    except SimulationError as error:
        raise UsageError(f"--gloss: {error}") from error
    return GlossyScene(surface=matte, gloss=lobe if gloss > 0 else None)


def gloss_of_mesh(path: Path, soup: TriangleSoup, mesh: Mesh, reflectances: tuple[float, ...]) -> GlossyScene:
    """Give the patches of a mesh the gloss of its file's materials. Raises UsageError."""
    from rig.files.mesh_gloss import gloss_of_patches

    if not soup.gloss.any():
        return GlossyScene(surface=mesh, gloss=None)
    found = gloss_of_patches(soup, mesh)
    try:
        matte = mesh.with_reflectance(max(reflectances)) if reflectances else mesh
        return GlossyScene(surface=matte, gloss=Gloss.of(matte, found.gloss, found.roughness))
    except SimulationError as error:
        raise UsageError(f"{path}: {error}; lower --reflectance, or give --gloss 0") from error


def summary_of_gloss(
    scene: GlossyScene,
    planned: Plan,
    *,
    memory_mb: float,
    allowed: float | None,
    lamp: str | PlacedProjector | None = None,
    on_progress: OnProgress = unheard,
) -> GlossSummary | None:
    """Estimate on a coarse plan by how much matte patches would be wrong, and how many rays lobes need.

    ``allowed`` is the noise that those may leave in % of white; None: what the usual number leaves. ``lamp`` is what
    was planned for; None: the test lighting of that name. Raises SimulationError.
    """
    if scene.gloss is None:
        return None
    tolerance = max(planned.tolerance_percent, PROBE_PERCENT)
    coarse = plan(scene.as_matte, tolerance, lamp or planned.light.name, memory_limit_mb=memory_mb)
    probe = _lobes_on(coarse, scene.surface, scene.gloss, on_progress)
    effect = gloss_effect(probe, coarse.light)
    rays = probe.rays if allowed is None else max(rays_for(100 * probe.noise, probe.rays, allowed), FEWEST_RAYS)
    noise = 100 * NOISE_SAFETY * probe.noise * float(np.sqrt(probe.rays / rays))
    matte_error = float(np.hypot(planned.error_percent, 100 * SAFETY * effect.largest))
    between, seen, highlight = (100 * value for value in (effect.between, effect.seen, effect.highlight))
    return GlossSummary(
        area_share=effect.area_share,
        matte_between=between,
        matte_seen=seen,
        matte_highlight=highlight,
        matte_error=matte_error,
        needed=matte_error > planned.tolerance_percent,
        bend=bend_by_lobes(scene.surface, scene.gloss),
        rays=rays,
        noise=noise,
    )


def effect_on(coarse: Plan, surface: Surface, gloss: Gloss) -> GlossEffect:
    """Return what matte patches are wrong by on the cells of a plan."""
    return gloss_effect(_lobes_on(coarse, surface, gloss), coarse.light)


def _lobes_on(coarse: Plan, surface: Surface, gloss: Gloss, on_progress: OnProgress = unheard) -> GlossySimulation:
    cells = gloss_of_cells(coarse.cells, surface, gloss)
    matte = simulate(coarse.cells, coarse.light, coarse.model)
    return glossy_simulation(matte, coarse.light, cells, on_progress=on_progress)


@dataclass(frozen=True, eq=False, kw_only=True)
class Lobes:
    """How the lobes of a plan's cells are simulated."""

    gloss: Gloss
    """Of the cells."""
    rays: int
    """Pairs from each glossy one."""
    allowed: float | None
    """Noise that they may leave, % of white; None: whatever they leave."""
    noise: float
    """That they are expected to leave, % of white."""

    def cost(self, light: Lighting) -> Cost:
        """Return what they add to a simulation."""
        return gloss_cost(self.gloss, self.rays, light)

    def simulated(
        self, matte: Simulation, light: Lighting, tolerance: float, on_progress: OnProgress
    ) -> GlossySimulation:
        """Return the light with lobes. Raises UsageError where even the most rays leave more noise than allowed."""
        allowed = None if self.allowed is None else self.allowed / 100
        found = glossy_simulation(matte, light, self.gloss, rays=self.rays, noise=allowed, on_progress=on_progress)
        if allowed is not None and found.noise > allowed:
            raise UsageError(_too_noisy(tolerance, 100 * found.noise, found.rays))
        return found


def lobes_for(summary: GlossSummary, cells: Gloss, allowed: float | None, tolerance: float) -> Lobes:
    """Return how the lobes of cells are simulated, by no more pairs of rays than there may be.

    Raises
    ------
    UsageError
        If the noise that is allowed asks for many times the most.
    """
    most = most_rays(cells)
    if allowed is not None and summary.rays > FAR_TOO_MANY * most:
        raise UsageError(_too_noisy(tolerance, summary.noise * float(np.sqrt(summary.rays / most)), most))
    usual = rays_each(cells, RAYS)
    rays = usual if allowed is None else min(max(summary.rays, usual), most)
    noise = summary.noise * float(np.sqrt(summary.rays / rays))
    return Lobes(gloss=cells, rays=rays, allowed=allowed, noise=noise if allowed is None else min(noise, allowed))


def _too_noisy(tolerance: float, noise: float, rays: int) -> str:
    return (
        f"{tolerance:.3g} % with gloss: {rays:,} pairs of rays from each glossy patch leave {noise:.2g} % noise, "
        f"{NOISE_SHARE * tolerance:.2g} % is allowed; try a tolerance of {noise / NOISE_SHARE * 1.1:.2g} %"
    )


def planned_for_lobes(tolerance: float, bend: float, planner: Callable[[float], _Planned]) -> _Planned:
    """Return a plan fine enough for light that varies ``bend`` times as much, beside rays' noise. Raises UsageError."""
    wanted = PATCHES_SHARE * tolerance / bend
    try:
        return planner(wanted)
    except SimulationError as error:
        raise UsageError(
            f"{tolerance:g} % with gloss needs patches for {wanted:.3g} %, as its light varies up to "
            f"{bend:.2f} times as much within them, and rays leave noise: {error}"
        ) from error


def seconds_of_lobes(scene: GlossyScene, planned: Plan) -> float:
    """Return what lobes are expected to add to a plan's solution, by the usual number of rays; 0 without gloss [s]."""
    if scene.gloss is None:
        return 0.0
    cells = gloss_of_cells(planned.cells, scene.surface, scene.gloss)
    return gloss_cost(cells, rays_each(cells, RAYS), planned.light).seconds


def reason_of(summary: GlossSummary, tolerance: float) -> str:
    """Say whether matte is enough, and by how much it would be wrong."""
    figures = (
        f"{summary.matte_between:.2g} % between surfaces, {summary.matte_seen:.2g} % as seen, "
        f"{summary.matte_highlight:.2g} % in highlights"
    )
    share = f"{100 * summary.area_share:.0f} % of the surface is glossy"
    if summary.needed:
        return (
            f"{share}: matte patches would be wrong by {figures}, in all {summary.matte_error:.2g} %, "
            f"{tolerance:.3g} % is allowed: lobes by rays, {summary.rays:,} pairs a patch for a noise of "
            f"{summary.noise:.2g} %, on patches for {PATCHES_SHARE * tolerance / summary.bend:.3g} %, as their light "
            f"may vary {summary.bend:.2f} times as much"
        )
    return (
        f"{share}: matte patches that reflect as much are wrong by {figures}, in all {summary.matte_error:.2g} %: "
        f"enough for {tolerance:.3g} %"
    )
