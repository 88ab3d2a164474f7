"""Model only what a scene needs: from a tolerance to patch size, visibility, solver and bounces, and why.

The error law is measured, not assumed: the scene is solved with coarse, half-size and quarter-size patches
under a standard light (its first face lit white), and the differences of the piecewise constant radiosity
give size and order of the discretisation error. Errors are percent of white, root mean square over the
surface.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.radiosity import DIRECT_LIMIT, Radiosity
from sim.scene import FloatArray, Scene
from sim.scenes import LIBRARY

SceneOfPatchSize = Callable[[float], Scene]

COARSE_M: Mapping[str, float] = {"paper-room": 0.8, "corner": 0.5, "furnace": 0.25, "room-with-box": 0.8}
"""Patch sizes of the coarse probe. [m]"""
FINEST_M = 0.01
PROBE_RAYS = 16
SECONDS_PER_PAIR = 3e-8
"""Closed form, measured 2e-8 on one core. [s]"""
FIRST_CALL_S = 0.02
FLOPS_PER_S = 1e10
"""What a small machine's linear algebra does for certain. [1/s]"""


@dataclass(frozen=True)
class Plan:
    """The cheapest model that meets a tolerance, and what it is expected to cost."""

    scene: str
    patch_size_m: float
    patches: int
    method: str
    visibility: str
    rays_per_pair: int
    solver: str
    channels: int
    bounces: int
    reasons: tuple[str, ...]
    error_percent: float
    seconds: float
    peak_mb: float


@dataclass(frozen=True)
class ErrorLaw:
    """Error C hᵒʳᵈᵉʳ of patches of size h."""

    coarse_m: float
    coarse_error_percent: float
    order: float
    finest_probe_patches: int
    finest_probe_seconds: float
    spectral_radius: float

    def error_percent(self, patch_size_m: float) -> float:
        """Give the expected error of a patch size."""
        return float(self.coarse_error_percent * (patch_size_m / self.coarse_m) ** self.order)

    def patch_size_m(self, tolerance_percent: float) -> float:
        """Give the patch size for a tolerance, no coarser than the probe."""
        ratio = tolerance_percent / max(self.coarse_error_percent, 1e-12)
        return float(self.coarse_m * min(1.0, ratio ** (1 / self.order)))


def plan(
    scene_name: str,
    tolerance_percent: float,
    memory_limit_mb: float = 4096.0,
    library: Mapping[str, SceneOfPatchSize] = LIBRARY,
) -> Plan:
    """Choose the cheapest model of a library scene that meets a tolerance.

    Parameters
    ----------
    scene_name : str
        A key of ``library``.
    tolerance_percent : float
        Error allowed, RMS over the surface. [% of white]
    memory_limit_mb : float
        What may be used.

    Raises
    ------
    SimulationError
        For an unknown scene, a tolerance not above 0, or a model that does not fit in memory.
    """
    if scene_name not in library:
        raise SimulationError(f"unknown scene {scene_name!r}; there are {', '.join(library)}")
    if not tolerance_percent > 0:
        raise SimulationError(f"tolerance {tolerance_percent:g} %; it must be above 0")
    build = library[scene_name]
    law = measured_law(build, COARSE_M.get(scene_name, 0.5))
    patch_size_m = max(law.patch_size_m(tolerance_percent), FINEST_M)
    patches = build(patch_size_m).n_patches
    convex = build(law.coarse_m).convex
    rays = 0 if convex else (64 if tolerance_percent >= 0.5 else 256)
    peak_mb = estimated_peak_mb(patches, rays > 0)
    if peak_mb > memory_limit_mb or law.error_percent(patch_size_m) > tolerance_percent * 1.001:
        raise SimulationError(_refusal(law, build, tolerance_percent, peak_mb, memory_limit_mb, rays > 0))
    bounces = bounces_needed(law.spectral_radius, tolerance_percent)
    return Plan(
        scene=scene_name,
        patch_size_m=patch_size_m,
        patches=patches,
        method="closed_form",
        visibility="none" if convex else "rays",
        rays_per_pair=rays,
        solver="cholesky" if patches <= DIRECT_LIMIT else "conjugate gradients",
        channels=1,
        bounces=bounces,
        reasons=_reasons(law, tolerance_percent, patch_size_m, patches, rays, bounces),
        error_percent=law.error_percent(patch_size_m),
        seconds=_seconds(law, patches, rays),
        peak_mb=peak_mb,
    )


def standard_light(scene: Scene) -> FloatArray:
    """(P,) emission when the first face gets white light (irradiance 1) and the others none."""
    E = np.zeros(scene.n_patches)
    lit = scene.faces[0].patches
    E[lit] = scene.reflectance[lit]
    return E


def measured_law(build: SceneOfPatchSize, coarse_m: float) -> ErrorLaw:
    """Solve with patches of coarse, half and quarter size and fit the error law to their differences."""
    sizes_m = [coarse_m, coarse_m / 2, coarse_m / 4]
    scenes = [build(size_m) for size_m in sizes_m]
    if not scenes[0].convex:
        # Rays cost too much for three levels: the coarser pair, at the order that smooth light shows.
        scenes = scenes[:2]
    started = time.perf_counter()
    solvers = []
    for scene in scenes:
        started = time.perf_counter()
        solvers.append(Radiosity(form_factors(scene, rays_per_pair=PROBE_RAYS), scene.reflectance))
    seconds = time.perf_counter() - started
    solved = [solver.solve(standard_light(scene)) for solver, scene in zip(solvers, scenes, strict=True)]
    differences = [
        100 * difference_rms(scenes[i], solved[i], scenes[i + 1], solved[i + 1]) for i in range(len(scenes) - 1)
    ]
    order = 1.0
    if len(differences) > 1 and min(differences) > 1e-9:
        order = float(np.clip(np.log2(differences[0] / differences[1]), 0.5, 2.0))
    # Halving again and again leaves ever smaller differences, at right angles to one another.
    coarse_error = differences[0] / float(np.sqrt(1 - 4.0**-order))
    radius = solvers[0].spectral_radius()
    return ErrorLaw(coarse_m, coarse_error, order, scenes[-1].n_patches, seconds, radius)


def difference_rms(coarse: Scene, B_coarse: FloatArray, fine: Scene, B_fine: FloatArray) -> float:
    """RMS over the surface of the difference of two piecewise constant radiosities on the same faces."""
    parents = []
    for face, same in zip(coarse.faces, fine.faces, strict=True):
        u, v = np.meshgrid((np.arange(same.columns) + 0.5) / same.columns, (np.arange(same.rows) + 0.5) / same.rows)
        parents.append(face.patch_at(np.stack([u.ravel(), v.ravel()], axis=1)))
    squared = (B_coarse[np.concatenate(parents)] - B_fine) ** 2
    return float(np.sqrt((fine.areas * squared).sum() / fine.areas.sum()))


def bounces_needed(spectral_radius: float, tolerance_percent: float) -> int:
    """Bounces after which what is left, r^(n + 1) / (1 - r), is below a tenth of the tolerance."""
    if spectral_radius <= 0:
        return 0
    left = tolerance_percent / 1000 * (1 - spectral_radius)
    return max(1, int(np.ceil(np.log(left) / np.log(spectral_radius))) - 1) if left < spectral_radius else 1


def estimated_peak_mb(patches: int, rays: bool) -> float:
    """Memory of the dense model: the matrix, its largest block under way, factor or ray bookkeeping."""
    matrices = 1.6 if patches > DIRECT_LIMIT else 4.2
    if rays:
        matrices = max(matrices, 4.3)
    return matrices * 8 * patches**2 / 1e6 + (10.0 if rays else 1.0)


def _count(build: SceneOfPatchSize, law: ErrorLaw, patch_size_m: float) -> int:
    return round(build(law.coarse_m).n_patches * (law.coarse_m / patch_size_m) ** 2)


def _seconds(law: ErrorLaw, patches: int, rays: int) -> float:
    pairs = float(patches) ** 2
    seconds = SECONDS_PER_PAIR * pairs + FIRST_CALL_S
    if rays:
        seconds += law.finest_probe_seconds * (patches / law.finest_probe_patches) ** 2 * rays / PROBE_RAYS
    if patches <= DIRECT_LIMIT:
        return seconds + patches**3 / 3 / FLOPS_PER_S
    return seconds + 16 * 2 * pairs * 8 / FLOPS_PER_S


def _refusal(
    law: ErrorLaw, build: SceneOfPatchSize, tolerance: float, peak_mb: float, limit_mb: float, rays: bool
) -> str:
    possible = tolerance
    while estimated_peak_mb(_count(build, law, law.patch_size_m(possible)), rays) > limit_mb:
        possible *= 1.1
    floor = max(possible, law.error_percent(FINEST_M))
    return (
        f"{tolerance:g} % needs patches of {1000 * law.patch_size_m(tolerance):.3g} mm and {peak_mb:.0f} MB "
        f"or more, the limit is {limit_mb:.0f} MB; try a tolerance of {floor:.2g} %"
    )


def _reasons(
    law: ErrorLaw, tolerance: float, patch_size_m: float, patches: int, rays: int, bounces: int
) -> tuple[str, ...]:
    seen = (
        f"occluders: {rays} rays between every two patches that one may part"
        if rays
        else "convex scene: every point sees every other, no visibility rays"
    )
    solver = "kept Cholesky factor" if patches <= DIRECT_LIMIT else "conjugate gradients, no factor to store"
    return (
        f"patches of {patch_size_m:.3g} m: measured error {law.coarse_error_percent:.2g} % at "
        f"{law.coarse_m:g} m, falling with order {law.order:.2g}; {law.error_percent(patch_size_m):.2g} % "
        f"expected, {tolerance:g} % allowed",
        "parallel and perpendicular rectangles: closed form factors, exact",
        seen,
        f"{patches} patches: {solver}",
        "one reflectance for all colours: one solve for three channels",
        f"each bounce keeps {100 * law.spectral_radius:.0f} % of the light: {bounces} bounces leave less "
        "than a tenth of the tolerance",
    )
