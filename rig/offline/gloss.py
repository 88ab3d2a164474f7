"""The gloss of a simulation: from its request or its mesh file, and whether matte patches would be enough."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rig.errors import UsageError
from rig.offline.records import GlossSummary
from sim.errors import SimulationError
from sim.geometry.mesh import Mesh
from sim.geometry.scene import Scene
from sim.geometry.surface import Surface
from sim.light.gloss.material import Gloss, matte_equivalent
from sim.planning.gloss import bend_by_lobes, gloss_of_cells, glossy_simulation
from sim.planning.gloss_effect import GlossEffect, gloss_effect
from sim.planning.plan import Plan, plan
from sim.planning.simulation import simulate

if TYPE_CHECKING:
    from pathlib import Path

    from rig.files.mesh import TriangleSoup

PROBE_PERCENT = 4.0
"""Tolerance of the plan on which the error of matte patches is estimated: tens of patches in the library's rooms."""
SAFETY = 1.25
"""On the largest figure of such a plan: finer ones found 1.03 times as much (benchmarks/gloss_honesty.py)."""
DEFAULT_ROUGHNESS = 0.3


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


def summary_of_gloss(scene: GlossyScene, planned: Plan, memory_mb: float) -> GlossSummary | None:
    """Estimate on a coarse plan by how much matte patches would be wrong. Raises SimulationError."""
    if scene.gloss is None:
        return None
    tolerance = max(planned.tolerance_percent, PROBE_PERCENT)
    coarse = plan(scene.as_matte, tolerance, planned.light.name, memory_limit_mb=memory_mb)
    effect = effect_on(coarse, scene.surface, scene.gloss)
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
    )


def effect_on(coarse: Plan, surface: Surface, gloss: Gloss) -> GlossEffect:
    """Return what matte patches are wrong by on the cells of a plan."""
    cells = gloss_of_cells(coarse.cells, surface, gloss)
    matte = simulate(coarse.cells, coarse.light, coarse.model)
    return gloss_effect(glossy_simulation(matte, coarse.light, cells), coarse.light)


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
            f"{tolerance:.3g} % is allowed: lobes by rays, "
            f"on patches for {tolerance / summary.bend:.3g} %, as their light may vary {summary.bend:.2f} times as much"
        )
    return (
        f"{share}: matte patches that reflect as much are wrong by {figures}, in all {summary.matte_error:.2g} %: "
        f"enough for {tolerance:.3g} %"
    )
