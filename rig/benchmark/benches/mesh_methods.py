"""Other ways to the light of a mesh than rays alone: exact factors, compressed ones, and lobes beside matte patches.

A ball in a corner, in white light everywhere, on one thread. Exact factors with exact shadows, and compressed ones,
take so long that they are measured on a thousand facets at most, beside rays, whose error they are told from. Of lobes
the light is known by many more pairs of rays.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from rig.benchmark.records import Criterion, Point, Size
from sim.arrays import FloatArray
from sim.form_factors import form_factors
from sim.form_factors.compressed import compressed_form_factors
from sim.geometry.adaptive_patches import coarsest_patches
from sim.geometry.mesh import Mesh
from sim.light.gloss.material import Gloss, matte_equivalent
from sim.light.lighting import make_test_lighting
from sim.light.radiosity import FormFactorOperator, Radiosity
from sim.light.sampled_light import sampled_light
from sim.planning.gloss import glossy_simulation
from sim.planning.simulation import Model, simulate
from sim.scenes.cluttered import corner_with_ball

FACETS = {"quick": 100, "default": 200, "full": 1_000}
GLOSSY_FACETS = {"quick": 100, "default": 1_000, "full": 2_144}
REFERENCE_ERROR = 5e-4
"""Of the rays that exact and compressed factors are held against; 1 = white."""
TOLERANCES: Mapping[Size, tuple[float, ...]] = {"quick": (), "default": (1e-2,), "full": (1e-2,)}
"""Of compressed factors: with 0.001 a ball of 104 facets takes ten times as long as with exact ones."""
MATTE, SHARE, ROUGHNESS = 0.4, 0.3, 0.3
PAIRS = {"quick": (32,), "default": (32, 64, 256), "full": (32, 64, 256, 1024)}
"""Of each glossy patch, half of them in each of the two solutions; 32 are the fewest."""
REFERENCE = 8
"""The reference has so many times more pairs of rays than the most."""
GLOSS_SAMPLING = 2e-3
"""Error that the rays of matte light may leave, the same ones in all rows of gloss."""
MOST_PERCENT = 0.5
"""Exact shadows against rays: light between facets that touch and the rays' own noise."""
LOBES_PERCENT = 1.0
"""With 256 pairs of rays, as many as a simulation takes."""


def method_points(size: Size) -> list[Point]:
    """Measure exact and compressed factors against rays, and lobes against more of theirs."""
    factors = _factors(corner_with_ball(FACETS[size]), TOLERANCES[size])
    return [*factors, *_lobes(corner_with_ball(GLOSSY_FACETS[size]), size)]


def method_bars(points: list[Point]) -> list[Criterion]:
    """Bars of :func:`method_points`."""
    limits = {"polygon, exact shadows": MOST_PERCENT, "rays, 256 pairs for lobes": LOBES_PERCENT}
    return [
        Criterion(
            what=f"{point.problem}, {point.n:,} facets, {point.method}: error",
            value=point.error or 0.0,
            limit=limits[point.method],
            unit="%",
        )
        for point in points
        if point.method in limits
    ]


def _factors(scene: Mesh, tolerances: tuple[float, ...]) -> list[Point]:
    white = scene.reflectance
    truth = sampled_light(scene, white, white, error=REFERENCE_ERROR, seed=1).B
    ways: dict[str, Callable[[], FormFactorOperator]] = {
        "polygon, exact shadows": partial(form_factors, scene, method="polygon", visibility="exact")
    }
    ways |= {f"compressed, {number:g}": partial(compressed_form_factors, scene, number) for number in tolerances}
    points = []
    for name, make in ways.items():
        started = time.perf_counter()
        B = Radiosity(make(), white, tolerance=1e-6).solve(white)
        points.append(_point(scene, name, time.perf_counter() - started, B - truth, gloss=0.0))
    return points


def _lobes(scene: Mesh, size: Size) -> list[Point]:
    """Light among glossy facets by more and more pairs of rays, on the same matte light."""
    matte = scene.with_reflectance(MATTE)
    gloss = Gloss.of(matte, SHARE, ROUGHNESS)
    cells = coarsest_patches(scene.with_reflectance(matte_equivalent(matte, gloss)))
    of_cells = Gloss(np.full(cells.n_patches, SHARE), np.full(cells.n_patches, ROUGHNESS))
    light = make_test_lighting("uniform", cells)
    model = Model(method="rays", visibility="rays", residual=1e-6, sampling=GLOSS_SAMPLING)
    solved = simulate(cells, light, model)
    most = max(PAIRS[size])
    truth = glossy_simulation(solved, light, of_cells, rays=REFERENCE * most, seed=1).B[:, 0]
    points = []
    for pairs in PAIRS[size]:
        started = time.perf_counter()
        B = glossy_simulation(solved, light, of_cells, rays=pairs).B[:, 0]
        seconds = time.perf_counter() - started + solved.factors_s + solved.solve_s
        points.append(_point(scene, f"rays, {pairs} pairs for lobes", seconds, B - truth, gloss=SHARE))
    return points


def _point(scene: Mesh, method: str, seconds: float, off: FloatArray, *, gloss: float) -> Point:
    areas = np.asarray(scene.areas)
    return Point(
        problem=scene.name if gloss == 0 else f"{scene.name}, gloss {gloss:g}",
        method=method,
        n=scene.n_patches,
        seconds=seconds,
        error=100 * float(np.sqrt((areas * off**2).sum() / areas.sum())),
        error_of="% of white, rms",
        detail={"gloss": gloss, "threads": 1},
    )
