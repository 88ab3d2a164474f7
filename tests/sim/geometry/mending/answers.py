"""What the model answers to a damaged mesh, and whether that answer may stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.errors import SimulationError
from sim.geometry.mending.mend import cleaned_facets, facets_of, mended
from sim.geometry.mending.remarks import DamagedMesh
from sim.planning.plan import plan
from sim.planning.simulation import simulate
from tests.sim.geometry.mending.damaged_meshes import Damaged

RHO = 0.8
MEMORY_MB = 20.0
"""Where a tolerance needs more than this holds, the planner says so, and which one would not."""


@dataclass(frozen=True)
class Answer:
    outcome: str
    """``solved``, ``refused``, or ``too fine`` a tolerance for the memory."""
    kinds: frozenset[str]
    light_share: float
    """All light over that of a closed room with the same emission; none may have more."""
    faults: tuple[str, ...]


def answer_to(mesh: Damaged, tolerance_percent: float) -> Answer:
    try:
        facets, cleaned = cleaned_facets(mesh.name, facets_of(mesh.points, mesh.triangles, np.array(RHO)))
        made = mended(mesh.name, facets)
    except DamagedMesh as error:
        kinds = frozenset(remark.kind for remark in error.remarks)
        kinds |= {"scale"} if "scale:" in str(error) else set()
        faults = () if kinds & mesh.says or not mesh.says else (f"expected one of {sorted(mesh.says)}: {error}",)
        return Answer("refused", kinds, 0.0, faults)
    kinds = frozenset(remark.kind for remark in (*cleaned, *made.remarks))
    unsaid = (f"said {sorted(kinds)}, expected one of {sorted(mesh.says)}",)
    faults = () if kinds & mesh.says or not mesh.says else unsaid
    try:
        planned = plan(made.mesh, tolerance_percent, "uniform", memory_limit_mb=MEMORY_MB, by_rays=made.by_rays)
    except SimulationError as error:
        too_fine = "try a tolerance of" in str(error)
        return Answer("too fine" if too_fine else "refused", kinds, 0.0, faults if too_fine else (str(error),))
    solved = simulate(planned.cells, planned.light, planned.model)
    areas, bound = planned.cells.areas, RHO / (1 - RHO)
    share = float(areas @ solved.B[:, 0] / areas.sum() / bound)
    if solved.spectral_radius > RHO * (1 + 1e-3):
        faults += (f"spectral radius {solved.spectral_radius:.4f} above {RHO}",)
    if share > 1 + 1e-3 or not np.isfinite(solved.B).all():
        faults += (f"light grows: {share:.4f} of the bound",)
    return Answer("solved", kinds, share, faults)
