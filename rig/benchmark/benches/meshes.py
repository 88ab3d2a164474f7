"""``rig bench meshes``: error against seconds of the light in scenes that hide much of themselves; rays and a peer."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from rig.benchmark import peers
from rig.benchmark.benches.hard_meshes import hard_bars, hard_points
from rig.benchmark.benches.mesh_methods import method_bars, method_points
from rig.benchmark.records import Criterion, Outcome, Point, Size
from rig.terminal import OnStep
from sim.arrays import FloatArray
from sim.geometry.mesh import Mesh
from sim.geometry.rays import plane_axes
from sim.light.sampled_light import sampled_light
from sim.scenes.cluttered import corner_with_ball, random_corner
from sim.threads import set_threads, threads

FACETS = {"quick": (500,), "default": (2_144, 5_984), "full": (2_144, 5_984, 20_000, 100_000)}
ERRORS = {"quick": (0.03,), "default": (0.03, 0.01, 0.003), "full": (0.03, 0.01, 0.003)}
"""RMS of the radiosity asked for; 1 = white."""
PEER_RAYS = {"quick": (64,), "default": (64, 256, 1024), "full": (64, 256, 1024)}
REFERENCE = 6
"""The reference has so many times less error than the finest asked for."""
PEER_BOUNCES = 40
MOST_PEER_RAYS = 8_000_000
"""Whose arrays take about 2 GB."""
ABOVE = 1e-4
"""Rays of the peer begin so far above their facet. [m]"""


@dataclass(frozen=True)
class MeshTruth:
    """A scene in white light, and its radiosity by very many rays."""

    scene: Mesh
    B: FloatArray

    def error(self, B: FloatArray) -> float:
        """RMS over the surface, percent of white."""
        areas = self.scene.areas
        return 100 * float(np.sqrt((areas * (B - self.B) ** 2).sum() / areas.sum()))


def run(size: Size, on_step: OnStep) -> Outcome:
    """Measure all that ``rig bench meshes`` shows; on one thread, as peers in Python have one."""
    scenes: list[Callable[[], Mesh]] = []
    for facets in FACETS[size]:
        scenes += [lambda n=facets: corner_with_ball(n), lambda n=facets: random_corner(1, n)]  # type: ignore[misc]
    points: list[Point] = []
    before = threads()
    try:
        set_threads(1)
        for number, make in enumerate(scenes):
            scene = make()
            on_step(f"{scene.name}, {scene.n_patches:,} facets", number, len(scenes))
            points += _points(scene, size)
        ways = method_points(size)
        hard = hard_points(size)
    finally:
        set_threads(before)
    on_step("meshes", len(scenes), len(scenes))
    return Outcome(points=(*points, *ways, *hard), criteria=(*_bars(points), *method_bars(ways), *hard_bars(hard)))


def _points(scene: Mesh, size: Size) -> list[Point]:
    reference = min(ERRORS[size]) / REFERENCE
    truth = MeshTruth(scene, sampled_light(scene, scene.reflectance, scene.reflectance, error=reference, seed=1).B)
    points = [_by_rays(truth, error) for error in ERRORS[size]]
    if peers.present("embreex"):
        fitting = [rays for rays in PEER_RAYS[size] if rays * scene.n_patches <= MOST_PEER_RAYS]
        points += [_by_embree(truth, rays) for rays in fitting]
    return points


def _by_rays(truth: MeshTruth, error: float) -> Point:
    scene = truth.scene
    started = time.perf_counter()
    light = sampled_light(scene, scene.reflectance, scene.reflectance, error=error)
    seconds = time.perf_counter() - started
    return Point(
        problem=scene.name,
        method=f"rays, error {100 * error:g} %",
        n=scene.n_patches,
        seconds=seconds,
        error=truth.error(light.B),
        error_of="% of white, rms",
        detail={
            "tolerance": 100 * error,
            "expected_error": 100 * light.error,
            "rays": float(light.sample.rays.mean()),
            "row_sum_max": float(light.factors.row_sums.max()),
            "threads": 1,
        },
    )


def _by_embree(truth: MeshTruth, rays: int) -> Point:
    started = time.perf_counter()
    B = embree_radiosity(truth.scene, rays)
    return Point(
        problem=truth.scene.name,
        method="embree and numpy",
        n=truth.scene.n_patches,
        seconds=time.perf_counter() - started,
        error=truth.error(B),
        error_of="% of white, rms",
        detail={"rays": float(rays), "threads": 1},
    )


def embree_radiosity(scene: Mesh, rays: int) -> FloatArray:
    """White light by the plain method: cosine-weighted Sobol's rays, their hits averaged, bounce after bounce."""
    places, directions = _rays_of(scene, rays)
    met = peers.EmbreeTriangles(scene.vertices[:, :3]).first(places.reshape(-1, 3), directions.reshape(-1, 3))
    met = met.reshape(scene.n_patches, rays)
    normals = np.append(scene.normals, np.zeros((1, 3)), axis=0)
    lit = np.einsum("prk,prk->pr", normals[met], directions) < 0
    values = np.where(lit, met, -1)
    B = scene.reflectance
    for _ in range(PEER_BOUNCES):
        B = scene.reflectance * (1 + np.append(B, 0.0)[values].mean(axis=1))
    return np.asarray(B)


def _rays_of(scene: Mesh, rays: int) -> tuple[FloatArray, FloatArray]:
    """(P, rays, 3) places and directions: one set of points, shifted for each facet."""
    shifts = np.random.default_rng(0).random((scene.n_patches, 1, 4))
    u = np.moveaxis((qmc.Sobol(4, seed=0).random(rays) + shifts) % 1, 2, 0)[..., None]
    a, b, c = np.moveaxis(scene.vertices[:, None, :3], 2, 0)
    places = a + np.sqrt(u[2]) * ((1 - u[3]) * (b - a) + u[3] * (c - a))
    along, across = np.moveaxis(plane_axes(scene)[:, None], 2, 0)
    normals = scene.normals[:, None]
    radius, angle = np.sqrt(u[0]), 2 * np.pi * u[1]
    directions = radius * (np.cos(angle) * along + np.sin(angle) * across) + np.sqrt(1 - u[0]) * normals
    return places + ABOVE * normals, directions


def _bars(points: list[Point]) -> list[Criterion]:
    return [
        Criterion(
            what=f"{point.problem}, {point.n:,} facets: error at {point.detail['tolerance']:g} %",
            value=point.error or 0.0,
            limit=float(point.detail["tolerance"]),
            unit="%",
        )
        for point in points
        if "tolerance" in point.detail
    ]
