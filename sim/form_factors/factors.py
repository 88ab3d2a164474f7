"""One function over the methods: closed form, polygons or the paper's quadrature, times the visible share; or rays."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim import _kernel
from sim.arguments import check_kind, word_of
from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.form_factors import closed_form, paper, polygon
from sim.form_factors.occlusion import Quality, visible_fraction
from sim.form_factors.sampled import RaySample, sampled_form_factors
from sim.form_factors.visibility import visible_fraction_by_rays
from sim.geometry.surface import Surface

Method = Literal["auto", "closed_form", "polygon", "paper", "rays"]
Visibility = Literal["auto", "none", "exact", "fair", "quick", "rays"]
METHODS = ("auto", "closed_form", "polygon", "paper", "rays")
VISIBILITIES = ("auto", "none", "exact", "fair", "quick", "rays")
DEFECT_TO_WARN = 1e-3
"""Row sums off by more than this: the light is wrong by rho / (1 - rho) times as much."""

_ROUNDING = 1e-9
"""Of a row's sum: boxes are off by less."""

Fill = Callable[[Surface, FloatArray, FloatArray], None]
FILLS: Mapping[str, Fill] = {"closed_form": closed_form.fill, "paper": paper.fill}
"""Each fills the (P, P) factors without occluders and their (P,) row sums."""


class ClosureWarning(UserWarning):
    """The form factors create light, or lose some in a closed scene."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FormFactors:
    """The matrix and what is known about its error."""

    matrix: FloatArray
    """(P, P) F[i, j]: share of the power leaving i that reaches j; A_i F_ij = A_j F_ji."""
    areas: FloatArray
    """(P,) patch areas [m²]."""
    row_sums: FloatArray
    """(P,) share of each patch's power that meets any patch."""
    closure_max: float
    """Closed scene: largest ``|row sum - 1|``. Any other: largest excess of a row sum over 1."""
    method: str
    """What was really done, as for ``visibility``."""
    visibility: str
    seconds: float

    def apply(self, x: ArrayLike) -> FloatArray:
        """Return F x: what each patch receives from radiosities x.

        Parameters
        ----------
        x : (P,) or (P, K) array
            Radiosities, one column for each of K lights.

        Returns
        -------
        (P,) or (P, K) array
            Irradiances, in the unit of x.
        """
        values = np.ascontiguousarray(x, dtype=np.float64)
        if values.ndim == 1:
            return self.exchange(values) / self.areas
        return np.asarray(self.matrix @ values)

    def exchange(self, x: FloatArray) -> FloatArray:
        """Return diag(A) F x, the symmetric product, of which only half of F need be read.

        Parameters
        ----------
        x : (P,) or (P, K) array
            Radiosities.

        Returns
        -------
        (P,) or (P, K) array
            In the unit of x times m².
        """
        if x.ndim == 1:
            out = np.empty(len(self.areas))
            starts, ranges = self._occupied
            _kernel.reciprocal_product(
                self.matrix, self.areas, starts=starts, ranges=ranges, x=np.ascontiguousarray(x), out=out
            )
            return out
        return np.asarray(self.areas[:, None] * (self.matrix @ x))

    @cached_property
    def _occupied(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Where the matrix is not 0, for products."""
        return _kernel.occupied_columns(self.matrix)

    def in_single_precision(self) -> FormFactors:
        """Return the same factors with a matrix of half the size; sums over rows still run in double precision.

        Returns
        -------
        FormFactors
            Their matrix is (P, P) float32.
        """
        single: Any = self.matrix.astype(np.float32)
        return replace(self, matrix=single)

    @cached_property
    def spectral_radius(self) -> float:
        """Largest eigenvalue of F, by power iteration: 1 in a closed scene, above 1 where light is created."""
        root = np.sqrt(self.areas)
        x, radius = root / np.linalg.norm(root), 0.0
        for _ in range(500):
            y = self.exchange(x / root) / root
            previous, radius = radius, float(np.linalg.norm(y))
            if radius == 0 or abs(radius - previous) <= 1e-10 * radius:
                break
            x = y / radius
        return radius


def form_factors(
    surface: Surface,
    method: Method = "auto",
    visibility: Visibility = "auto",
    *,
    rays: int = 256,
    rays_per_pair: int = 64,
    tolerance: float = 1e-6,
    samples: int | None = None,
    keep_within_closure: bool = False,
) -> FormFactors:
    """Return all form factors of a scene or mesh.

    Parameters
    ----------
    surface : Surface
        A ``Scene``, a ``Mesh`` or ``AdaptivePatches``.
    method : {"auto", "closed_form", "polygon", "paper", "rays"}
        ``closed_form``: exact for rectangles along three axes. ``polygon``: any flat triangles and quads, to
        ``tolerance``. ``auto``: the closed form where it applies, else polygons. ``paper``: 3x3 midpoint samples
        on both patches, kept for replication; it gains energy at shared edges (row sums up to 1.087 in the
        paper's room) and warns. ``rays``: counted by cosine-weighted rays, shadows and all; for scenes that hide much
        of themselves (``sim.form_factors.sampled`` has the same without a dense matrix).
    visibility : {"auto", "none", "exact", "fair", "quick", "rays"}
        ``exact``, ``fair``, ``quick``: shadows clipped as polygons, at ever fewer points. ``rays``: segments between
        random points, the plain reference. ``auto``: ``exact``, and nothing at all in convex scenes.
    rays : int
        For the method ``rays``: of each patch, a power of 2.
    rays_per_pair : int
        For the visibility ``rays``: segments between two patches that an occluder may part.
    tolerance : float
        For ``polygon``: relative error allowed in each pair.
    samples : int, optional
        For ``polygon``: points on one patch of a near pair at most, a square (9, 25), instead of the tolerance.
    keep_within_closure : bool
        Rows that sum to more than 1 are divided by their sums, and their columns, too: A_i F_ij stays symmetric, and no
        light grows. ``closure_max`` keeps the defect that there was.

    Returns
    -------
    FormFactors

    Raises
    ------
    SimulationError
        For an unknown method or visibility, or a method that cannot do this surface.

    Warns
    -----
    ClosureWarning
        If row sums are off by more than 1e-3.

    References
    ----------
    Ehlert and Smith, View factors for perpendicular and parallel rectangular plates, Journal of Thermophysics and Heat
    Transfer 7, 1993: the closed form.
    Sparrow, A new and simpler formulation for radiative angle factors, Journal of Heat Transfer 85, 1963: polygons.
    Dehos, Zéghers, Sarry, Rousselle and Renaud, Immersive front-projection analysis using a radiosity-based simulation
    method, Virtual Reality 18(2), 2014: ``paper``.
    """
    check_kind("form factors", surface, "vertices", "a scene or mesh")
    _check_choices(method, visibility)
    if method == "rays":
        return _by_rays(surface, visibility, rays)
    started = time.perf_counter()
    if method == "auto":
        method = "closed_form" if closed_form.applies(surface) else "polygon"
    visibility = _visibility_needed(surface, visibility)
    n = surface.n_patches
    matrix, row_sums = np.empty((n, n)), np.empty(n)
    if method == "polygon":
        polygon.fill_exchange_areas(surface, matrix, samples, tolerance)
        _kernel.divide_rows(matrix, surface.areas, row_sums)
    else:
        FILLS[method](surface, matrix, row_sums)
    if visibility != "none":
        _occlude(surface, matrix, visibility, rays_per_pair)
        np.sum(matrix, axis=1, out=row_sums)
    seconds = time.perf_counter() - started
    closure = _closure_max(surface, row_sums)
    if closure > DEFECT_TO_WARN:
        warnings.warn(_defect(surface, row_sums, method, visibility), ClosureWarning, stacklevel=2)
    if keep_within_closure and row_sums.max() > 1 + _ROUNDING:
        kept = kept_within_closure(row_sums)
        matrix *= kept[:, None]
        matrix *= kept
        np.sum(matrix, axis=1, out=row_sums)
    return FormFactors(
        matrix=matrix,
        areas=surface.areas,
        row_sums=row_sums,
        closure_max=closure,
        method=method,
        visibility=visibility,
        seconds=seconds,
    )


def _by_rays(surface: Surface, visibility: Visibility, rays: int) -> FormFactors:
    if visibility not in ("auto", "rays"):
        raise SimulationError(
            f"method 'rays' finds shadows itself; visibility {visibility!r} is not for it: use 'auto'"
        )
    started = time.perf_counter()
    sample = RaySample(surface=surface)
    sample.lengthen(rays)
    sampled = sampled_form_factors(sample)
    matrix = sampled.exchange_areas.toarray()
    matrix /= sampled.areas[:, None]
    return FormFactors(
        matrix=matrix,
        areas=sampled.areas,
        row_sums=sampled.row_sums,
        closure_max=sampled.closure_max,
        method="rays",
        visibility="rays",
        seconds=time.perf_counter() - started,
    )


def _check_choices(method: str, visibility: str) -> None:
    word_of("form factor method", method, METHODS)
    word_of("visibility", visibility, VISIBILITIES)


def _visibility_needed(surface: Surface, visibility: Visibility) -> Visibility:
    if visibility != "auto":
        return visibility
    return "none" if surface.convex or not len(surface.occluders) else "exact"


def _occlude(surface: Surface, matrix: FloatArray, visibility: Visibility, rays_per_pair: int) -> None:
    if visibility == "rays":
        matrix *= visible_fraction_by_rays(surface, matrix > 0, rays_per_pair)
    else:
        visible_fraction(surface, matrix, cast(Quality, visibility)).apply(matrix)


def kept_within_closure(row_sums: FloatArray) -> FloatArray:
    """(P,) by which to multiply rows and columns, so that no row is above 1 and A_i F_ij stays symmetric."""
    return np.asarray(1 / np.maximum(row_sums, 1.0))


def _closure_max(surface: Surface, row_sums: FloatArray) -> float:
    excess = row_sums - 1
    return float(np.abs(excess).max()) if surface.closed else float(max(excess.max(), 0.0))


def _defect(surface: Surface, row_sums: FloatArray, method: str, visibility: str) -> str:
    cure = "use method 'auto' for exact factors"
    if visibility == "none" and not surface.convex:
        cure = "its occluders are left out: use visibility 'exact'"
    elif visibility != "none" and method != "paper":
        cure = "use visibility 'exact', or more rays"
    return (
        f"{surface.name}: row sums of the {method} form factors run from {row_sums.min():.4f} to "
        f"{row_sums.max():.4f}; above 1 they create light, and at reflectance rho the error grows to "
        f"{row_sums.max() - 1:.2g} rho / (1 - rho); {cure}"
    )
