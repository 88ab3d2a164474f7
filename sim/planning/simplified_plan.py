"""Plans of meshes of very many facets: on as few as the tolerance needs, judged on all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from sim.arrays import IntArray
from sim.geometry.adaptive_patches import AdaptivePatches
from sim.geometry.mending.mend import MendedMesh
from sim.geometry.mending.remarks import Facets
from sim.geometry.mending.simplification import (
    SimplificationError,
    TracedPoints,
    simplification_error,
    simplified,
)
from sim.planning.plan import Plan
from sim.planning.simulation import Simulation, simulate

PLANNED_AS_THEY_ARE = 60_000
"""Facets up to which a mesh is not simplified: its plan takes seconds."""
COARSEST, FINER = 6_000, 4
"""Facets of the first try, and times as many of each next one."""
PLAN_SHARE = 0.7
"""Of the tolerance, for the plan on the simpler mesh; as much, in squares, is left to what simplifying costs."""

MakePlan = Callable[[MendedMesh, float], Plan]
"""From a mesh and a tolerance [% of white] to its plan."""
OnPart = Callable[[str, float], None]
"""Is told which part of the work is being done, and the share of it that is."""
SIMPLIFY, MEND, JUDGE = "simplify the mesh", "mend the mesh", "hold it against all facets"
COLLAPSED, TURNED, TRACED = 0.5, 0.7, 0.9
"""Shares of them, roughly: once there are fewer facets; once all are turned alike, and rays are traced."""


def unheard_part(label: str, share: float) -> None:
    """Tell nobody."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SimplifiedPlan:
    """A plan on a simpler mesh."""

    plan: Plan
    mesh: MendedMesh
    error: SimplificationError | None
    """None: on all facets."""


@dataclass(eq=False, kw_only=True)
class SimplifyingPlanner:
    """Meshes of fewer and fewer facets in the place of one, each made once."""

    original: Facets
    """All facets, cleaned."""
    mend: Callable[[Facets], MendedMesh]
    """Makes a mesh of some of them."""
    oriented: Callable[[Facets], Facets]
    """Lights the sides of facets that a mesh of them would light."""
    make_plan: MakePlan
    on_part: OnPart = unheard_part
    """Is told what is done beside plans."""
    _points: TracedPoints | None = field(default=None, init=False)
    _meshes: dict[int, MendedMesh] = field(default_factory=dict, init=False)

    def plan(self, tolerance_percent: float) -> SimplifiedPlan:
        """Return the plan on the fewest facets whose error on all of them is within the tolerance.

        Raises
        ------
        SimulationError
            As ``sim.planning.plan.plan`` does, or if the library that simplifies is missing.
        """
        for count in self._counts():
            mesh = self._mesh(count)
            made = self.make_plan(mesh, PLAN_SHARE * tolerance_percent)
            error = self._error(made)
            if 100 * error.light <= tolerance_percent:
                reason = (
                    f"{self.original.n_facets:,} facets simplified to {mesh.mesh.n_patches:,} patches, "
                    f"95 % of the surface within {1e3 * error.distance_m:.2g} mm: "
                    f"{100 * error.light:.2g} % expected in all, by rays on the file's own facets"
                )
                expected = max(100 * error.light, made.error_percent)
                reasons = (*made.reasons, reason)
                made = replace(made, tolerance_percent=tolerance_percent, error_percent=expected, reasons=reasons)
                return SimplifiedPlan(plan=made, mesh=mesh, error=error)
        mesh = self._mesh(self.original.n_facets)
        return SimplifiedPlan(plan=self.make_plan(mesh, tolerance_percent), mesh=mesh, error=None)

    def _counts(self) -> Iterator[int]:
        """Facets to try, in ascending order; none for a mesh that is small enough."""
        count = COARSEST
        while self.original.n_facets > PLANNED_AS_THEY_ARE and count <= self.original.n_facets / 2:
            yield count
            count *= FINER

    def _mesh(self, count: int) -> MendedMesh:
        if count not in self._meshes:
            label = SIMPLIFY if count < self.original.n_facets else MEND
            self.on_part(label, 0.0)
            fewer = simplified(self.original, count) if count < self.original.n_facets else self.original
            self.on_part(label, COLLAPSED)
            self._meshes[count] = self.mend(fewer)
            self.on_part(label, 1.0)
        return self._meshes[count]

    def _error(self, made: Plan) -> SimplificationError:
        self.on_part(JUDGE, 0.0)
        if self._points is None:
            turned = self.oriented(self.original)
            self.on_part(JUDGE, TURNED)
            self._points = TracedPoints.of(turned)
        self.on_part(JUDGE, TRACED)
        solved = simulate(made.cells, made.light, made.model)
        facets, cell = _in_triangles(made.cells, solved)
        error = simplification_error(
            self._points,
            facets,
            solved.B[cell, 0],
            solved.irradiance[cell, 0],
            spectral_radius=solved.spectral_radius,
        )
        self.on_part(JUDGE, 1.0)
        return error


def _in_triangles(cells: AdaptivePatches, solved: Simulation) -> tuple[Facets, IntArray]:
    """All patches as triangles, and the patch of each."""
    quads = np.flatnonzero(~cells.triangular)
    corners = np.concatenate([cells.vertices[:, :3], cells.vertices[quads][:, [0, 2, 3]]])
    cell = np.concatenate([np.arange(cells.n_patches), quads])
    numbers = np.arange(3 * len(corners)).reshape(-1, 3)
    facets = Facets(
        points=corners.reshape(-1, 3), triangles=numbers, reflectance=solved.reflectance[cell, 0], source=cell
    )
    return facets, cell
