"""``rig simulate``: plan a scene for a tolerance, say what it will cost, do it, and say what it did cost."""

from __future__ import annotations

import os
import time
import tracemalloc
from collections.abc import Callable
from typing import Any

from rig.errors import UsageError
from sim.errors import SimulationError
from sim.form_factors import FormFactors, form_factors
from sim.plan import Plan, plan, standard_light
from sim.radiosity import Radiosity
from sim.scene import FloatArray, Scene
from sim.scenes import LIBRARY

OnStep = Callable[[str, int, int], None]


def run_simulate(scene: str, tolerance: float, on_step: OnStep) -> dict[str, Any]:
    """Plan, estimate, simulate, measure.

    Parameters
    ----------
    scene : str
        A name of ``sim.scenes.LIBRARY``.
    tolerance : float
        Error allowed, RMS over the surface under the plan's standard light. [% of white]
    on_step : callable (label, done, total)

    Returns
    -------
    dict
        ``plan``, ``estimated`` and ``actual``, JSON-able.

    Raises
    ------
    UsageError
        For an unknown scene, a tolerance not above 0, or one that does not fit in memory.
    """
    if scene not in LIBRARY:
        raise UsageError(f"unknown scene {scene!r}; there are {', '.join(LIBRARY)}")
    on_step("plan", 0, 3)
    try:
        planned = plan(scene, tolerance, available_mb() / 2)
    except SimulationError as error:
        raise UsageError(str(error)) from error
    estimate = f"{planned.patches} patches, {planned.seconds:.2g} s, {planned.peak_mb:.0f} MB"
    on_step(f"simulate ({estimate} expected)", 1, 3)
    actual = _measured(planned, LIBRARY[scene](planned.patch_size_m))
    on_step("done", 3, 3)
    return {"scene": scene, "tolerance": tolerance, **_described(planned), "actual": actual}


def available_mb() -> float:
    """Memory free for use now [MB]."""
    return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e6


def _described(planned: Plan) -> dict[str, Any]:
    return {
        "plan": {
            "patches": planned.patches,
            "patch_size_m": planned.patch_size_m,
            "method": planned.method,
            "visibility": planned.visibility,
            "rays_per_pair": planned.rays_per_pair,
            "solver": planned.solver,
            "channels": planned.channels,
            "bounces": planned.bounces,
            "reasons": list(planned.reasons),
        },
        "estimated": {
            "error": planned.error_percent,
            "seconds": planned.seconds,
            "peak_mb": planned.peak_mb,
        },
    }


def _measured(planned: Plan, scene: Scene) -> dict[str, float]:
    started = time.perf_counter()
    tracemalloc.start()
    try:
        # "auto" shoots rays in the scenes for which the plan asks for them.
        factors = form_factors(scene, rays_per_pair=max(planned.rays_per_pair, 1))
        radiosity = Radiosity(factors, scene.reflectance)
        E = standard_light(scene)
        B = radiosity.solve(E)
        peak_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    seconds = time.perf_counter() - started
    return {
        "seconds": seconds,
        "peak_mb": peak_bytes / 1e6,
        "residual": radiosity.accuracy(B, E).residual,
        "closure_max": factors.closure_max,
        "energy_balance": energy_balance(scene, factors, E, B),
    }


def energy_balance(scene: Scene, factors: FormFactors, E: FloatArray, B: FloatArray) -> float:
    """Share of the emitted power that is neither absorbed by a patch nor leaves through an opening."""
    incident = factors.matrix @ B
    absorbed = float((scene.areas * (1 - scene.reflectance) * incident).sum())
    escaped = float((scene.areas * B * (1 - factors.row_sums)).sum())
    emitted = float((scene.areas * E).sum())
    return abs(1 - (absorbed + escaped) / emitted)
