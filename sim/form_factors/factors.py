"""One function over the methods: closed form or the paper's quadrature, times the visible share."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sim.errors import SimulationError
from sim.form_factors import closed_form, paper
from sim.form_factors.visibility import visible_fraction
from sim.scene import FloatArray, Scene

Method = Literal["closed_form", "paper"]
Visibility = Literal["auto", "none", "rays"]

METHODS: Mapping[str, Callable[[Scene], FloatArray]] = {
    "closed_form": closed_form.exchange_areas,
    "paper": paper.exchange_areas,
}
"""Each gives the symmetric (P, P) exchange areas A_i F_ij of a scene without occluders [m²]."""


@dataclass(frozen=True, eq=False)
class FormFactors:
    """The matrix and what is known about its error."""

    matrix: FloatArray
    """(P, P) F[i, j]: share of the power leaving i that reaches j; A_i F_ij = A_j F_ji."""
    areas: FloatArray
    """(P,) patch areas [m²]."""
    closure_max: float
    """Closed convex scene: largest |row sum - 1|. Any other: largest excess of a row sum over 1."""
    method: str
    visibility: str
    """``none`` or ``rays``: what was really done."""
    seconds: float

    @property
    def row_sums(self) -> FloatArray:
        """(P,) share of each patch's power that meets any patch."""
        return np.asarray(self.matrix.sum(axis=1))


def form_factors(
    scene: Scene, method: Method = "closed_form", visibility: Visibility = "auto", rays_per_pair: int = 64
) -> FormFactors:
    """All form factors of a scene.

    Parameters
    ----------
    scene : Scene
    method : {"closed_form", "paper"}
        ``closed_form``: exact for parallel and perpendicular rectangles. ``paper``: 3x3 midpoint samples on
        both patches, kept for replication; it gains energy at shared edges (row sums up to 1.087 in the
        paper's room).
    visibility : {"auto", "none", "rays"}
        ``auto`` shoots rays only in scenes that are not convex.
    rays_per_pair : int
        Segments between two patches that an occluder may part.

    Raises
    ------
    SimulationError
        For an unknown method or visibility, or (closed form) faces neither parallel nor perpendicular.
    """
    if method not in METHODS:
        raise SimulationError(f"unknown form factor method {method!r}; there are {', '.join(METHODS)}")
    if visibility not in ("auto", "none", "rays"):
        raise SimulationError(f"unknown visibility {visibility!r}; there are auto, none, rays")
    started = time.perf_counter()
    exchange = METHODS[method](scene)
    rays = visibility == "rays" or (visibility == "auto" and not scene.convex)
    if rays:
        exchange *= visible_fraction(scene, exchange > 0, rays_per_pair)
    exchange /= scene.areas[:, None]
    seconds = time.perf_counter() - started
    closure = _closure_max(scene, exchange)
    return FormFactors(exchange, scene.areas, closure, method, "rays" if rays else "none", seconds)


def is_closed(scene: Scene) -> bool:
    """Tell if the faces' area vectors add up to nothing, as those of every closed surface do."""
    vector = (scene.areas[:, None] * scene.normals).sum(axis=0)
    return len(scene.faces) > 3 and bool(np.abs(vector).max() < 1e-9 * scene.areas.sum())


def _closure_max(scene: Scene, matrix: FloatArray) -> float:
    excess = matrix.sum(axis=1) - 1
    if scene.convex and is_closed(scene):
        return float(np.abs(excess).max())
    return float(max(excess.max(), 0.0))
