"""``rig simulate``: plan a scene for a tolerance, say what it will cost, do it, and say what it did cost."""

from __future__ import annotations

import os
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import hypot
from pathlib import Path

from rig.errors import UsageError
from rig.offline.gloss import (
    NOISE_SHARE,
    PROBE_PERCENT,
    GlossyScene,
    Lobes,
    gloss_of_mesh,
    lobes_for,
    planned_for_lobes,
    reason_of,
    seconds_of_lobes,
    summary_of_gloss,
    with_gloss,
)
from rig.offline.mesh_file import MeshFile, MeshOptions, open_mesh_file
from rig.offline.records import (
    Estimate,
    GlossSummary,
    MeshSummary,
    PlanSummary,
    SimulationOutcome,
    SimulationResult,
)
from rig.terminal import OnStep, in_percent, silent
from sim.errors import SimulationError
from sim.form_factors.compressed import CompressedFormFactors
from sim.form_factors.sampled import SampledFormFactors
from sim.geometry.mending.mend import MendedMesh
from sim.light.lighting import PlacedProjector
from sim.planning.check import largest_check, refined_check
from sim.planning.cost import Cost
from sim.planning.gloss import GlossySimulation, gloss_of_cells, refined_gloss_check
from sim.planning.plan import Plan, plan
from sim.planning.simplified_plan import SimplifyingPlanner
from sim.planning.simulation import Simulation, simulate
from sim.planning.time_limit import plan_within
from sim.scenes.catalogue import SURFACES

WHITE = 255
"""Grey levels of white."""
MESH_SUFFIXES = (".obj", ".ply", ".stl", ".gltf", ".glb")
MESH_LIGHT = "floor"
"""Standard light of a mesh file."""
CHECK = "check against a refined solution"


@dataclass(frozen=True, kw_only=True)
class SimulationRequest:
    """What is to be simulated."""

    scene: str
    """A name of ``sim.scenes.catalogue.SURFACES`` or a mesh file."""
    tolerance: float
    """Error allowed, RMS over the surface. [% of white]"""
    light: str | None = None
    """One of ``sim.light.lighting.TEST_LIGHTINGS``; None: the scene's standard."""
    reflectance: tuple[float, ...] = ()
    """One number, or one for each colour; empty: the scene's."""
    mesh: MeshOptions = field(default_factory=MeshOptions)
    """How a mesh file is read."""
    memory_mb: float | None = None
    """What may be used; None: half of what is free."""
    seconds: float | None = None
    """For plan and solution; the tolerance is then the smallest that fits."""
    gloss: float | None = None
    """Of all patches; None: the mesh file's own."""
    roughness: float | None = None
    """Of that gloss."""
    projector: PlacedProjector | None = None
    """White from here instead of ``light``."""


def tolerance_of(percent: float | None, grey_levels: float | None, seconds: float | None = None) -> float:
    """Tolerance in percent of white from either; of no meaning where a time is given.

    Raises
    ------
    UsageError
        If two of the three are given.
    """
    if seconds is not None and (percent is not None or grey_levels is not None):
        raise UsageError("--seconds takes the smallest tolerance that fits; leave --tolerance and --grey-levels out")
    if percent is not None and grey_levels is not None:
        raise UsageError("--tolerance and --grey-levels say the same thing; give one")
    if grey_levels is not None:
        return 100 * grey_levels / WHITE
    return 1.0 if percent is None else percent


def reflectances_of(text: str) -> tuple[float, ...]:
    """Reflectances from numbers separated by commas.

    Raises
    ------
    UsageError
        For what is no number in 0 ... 1.
    """
    try:
        values = tuple(float(part) for part in text.split(",")) if text else ()
    except ValueError as error:
        raise UsageError(f"--reflectance {text}: give numbers separated by commas, e.g. 0.7 or 0.7,0.6,0.5") from error
    if not all(0 <= value <= 1 for value in values):
        raise UsageError(f"--reflectance {text}: a reflectance lies in 0 ... 1")
    return values


@dataclass(frozen=True, eq=False, kw_only=True)
class PlannedSimulation:
    """What is to be carried out."""

    plan: Plan
    """With matte patches."""
    lobes: Lobes | None
    """Where matte patches are not enough."""
    tolerance: float
    """RMS over the surface. [% of white]"""


def plan_simulation(request: SimulationRequest, on_step: OnStep) -> tuple[PlannedSimulation, SimulationResult]:
    """Plan and estimate a simulation.

    Returns
    -------
    PlannedSimulation, SimulationResult
        The plan to carry out, and what it will cost; nothing ``actual`` yet.

    Raises
    ------
    UsageError
        For an unknown scene, a tolerance not above 0, or one that does not fit in memory.
    """
    on_step("plan", 0, 1)
    started = time.perf_counter()
    memory_mb = available_mb() / 2 if request.memory_mb is None else _possible_mb(request.memory_mb)
    light = request.light or (SURFACES[request.scene].light if request.scene in SURFACES else MESH_LIGHT)
    lamp = request.projector or light

    def make_plan(scene: GlossyScene, tolerance: float, by_rays: bool) -> Plan:
        surface, reflectances = scene.as_matte, scene.reflectances(request.reflectance)
        label = "plan" if request.seconds is None else f"plan for {tolerance:.2g} %"
        return plan(
            surface,
            tolerance,
            lamp,
            memory_limit_mb=memory_mb,
            reflectances=reflectances,
            by_rays=by_rays,
            one_number=scene.gloss is not None,
            on_progress=in_percent(label, on_step),
        )

    try:
        planner = _planner(request, make_plan, on_step)
        found = _within(request, planner)
        allowed = None if request.seconds is not None else NOISE_SHARE * request.tolerance
        told = in_percent("try lobes", on_step)
        summary = summary_of_gloss(
            found.scene, found.plan, memory_mb=memory_mb, allowed=allowed, lamp=lamp, on_progress=told
        )
        bend = 1.0 if summary is None or not summary.needed else summary.bend
        if bend > 1 and request.seconds is None:
            found = planned_for_lobes(request.tolerance, bend, planner)
        planned = found.plan
        lobes = None
        if summary is not None and summary.needed and found.scene.gloss is not None:
            gloss = gloss_of_cells(planned.cells, found.scene.surface, found.scene.gloss)
            lobes = lobes_for(summary, gloss, allowed, request.tolerance)
            summary = replace(summary, rays=lobes.rays, noise=lobes.noise)
    except SimulationError as error:
        raise UsageError(str(error)) from error
    on_step("plan", 1, 1)
    more = Cost(0.0, 0.0) if lobes is None else lobes.cost(planned.light)
    noise = 0.0 if lobes is None else lobes.noise
    within_s = hypot(bend * planned.tolerance_percent, noise)
    tolerance = request.tolerance if request.seconds is None else within_s
    matte_error = None if summary is None or lobes is not None else summary.matte_error
    error_percent = hypot(bend * planned.error_percent, noise) if matte_error is None else matte_error
    return PlannedSimulation(plan=planned, lobes=lobes, tolerance=tolerance), SimulationResult(
        scene=request.scene,
        tolerance=tolerance,
        plan=_summary(planned, summary, tolerance, time.perf_counter() - started),
        estimated=Estimate(
            error=error_percent, seconds=planned.seconds + more.seconds, peak_mb=planned.peak_mb + more.peak_mb
        ),
        mesh=found.mesh,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _PlannedScene:
    """A plan, and what it is for."""

    plan: Plan
    scene: GlossyScene
    mesh: MeshSummary | None


def _planner(
    request: SimulationRequest, make_plan: Callable[[GlossyScene, float, bool], Plan], on_step: OnStep
) -> Callable[[float], _PlannedScene]:
    """What plans a request's scene for a tolerance; a mesh file is simplified where it has very many facets."""
    if request.scene in SURFACES:
        room = with_gloss(SURFACES[request.scene].build(), request.gloss, request.roughness, request.reflectance)
        return lambda tolerance: _PlannedScene(plan=make_plan(room, tolerance, False), scene=room, mesh=None)
    if Path(request.scene).suffix.lower() not in MESH_SUFFIXES:
        raise UsageError(f"unknown scene {request.scene!r}; there are {', '.join(SURFACES)}, and mesh files")
    reflectance = max(request.reflectance) if request.reflectance else None
    file = open_mesh_file(Path(request.scene), request.mesh, reflectance, on_step)
    scenes: dict[int, GlossyScene] = {}

    def plan_mesh(mesh: MendedMesh, tolerance: float) -> Plan:
        if id(mesh) not in scenes:
            scenes[id(mesh)] = _glossy(request, file, mesh)
        return make_plan(scenes[id(mesh)], tolerance, mesh.by_rays)

    planner = SimplifyingPlanner(
        original=file.facets,
        mend=file.mend,
        oriented=file.oriented,
        make_plan=plan_mesh,
        on_part=lambda label, share: on_step(label, int(100 * share), 100),
    )

    def plan_file(tolerance: float) -> _PlannedScene:
        made = planner.plan(tolerance)
        return _PlannedScene(plan=made.plan, scene=scenes[id(made.mesh)], mesh=file.summary(made))

    return plan_file


def _within(request: SimulationRequest, planner: Callable[[float], _PlannedScene]) -> _PlannedScene:
    """The plan for a request's tolerance, or for its time, of which lobes on a coarse plan and its own are part."""
    if request.seconds is None:
        return planner(request.tolerance)
    made: list[tuple[Plan, _PlannedScene]] = []
    lobes_s = coarse_s = 0.0

    def make_plan(tolerance: float) -> Plan:
        nonlocal lobes_s, coarse_s
        found = planner(tolerance)
        lobes_s = seconds_of_lobes(found.scene, found.plan)
        coarse_s = lobes_s if tolerance >= PROBE_PERCENT or not made else coarse_s
        made.append((replace(found.plan, seconds=found.plan.seconds + lobes_s + coarse_s), found))
        return made[-1][0]

    def with_lobes() -> str:
        return f", {lobes_s + coarse_s:.2g} s of it for the lobes of gloss," if lobes_s else ""

    chosen = plan_within(make_plan, request.seconds, beside=with_lobes)
    return next(found for counted, found in made if counted is chosen)


def _glossy(request: SimulationRequest, file: MeshFile, mesh: MendedMesh) -> GlossyScene:
    """A file's mesh with the gloss that was asked for, else with its materials' own."""
    if request.gloss is None and request.roughness is None:
        return gloss_of_mesh(file.path, file.soup, mesh.mesh, request.reflectance)
    return with_gloss(mesh.mesh, request.gloss, request.roughness, request.reflectance)


def run_planned(
    to_do: PlannedSimulation, on_step: OnStep, check: bool = False, keep: Callable[[Simulation], None] | None = None
) -> SimulationOutcome:
    """Simulate what was planned, measure what it costs, and with ``check`` its error against a refined solution.

    ``keep`` is given the matte light of the patches.
    """
    on_step("simulate", 0, 1)
    planned, glossy = to_do.plan, None
    started = time.perf_counter()
    tracemalloc.start()
    try:
        simulation = simulate(planned.cells, planned.light, planned.model, in_percent("simulate", on_step))
        if to_do.lobes is not None:
            told = in_percent("trace lobes", on_step)
            glossy = to_do.lobes.simulated(simulation, planned.light, to_do.tolerance, told)
        seconds = time.perf_counter() - started
        peak_mb = tracemalloc.get_traced_memory()[1] / 1e6
    except SimulationError as error:
        raise UsageError(str(error)) from error
    finally:
        tracemalloc.stop()
    if isinstance(simulation.factors, CompressedFormFactors | SampledFormFactors):
        peak_mb += simulation.factors.kernel_mb  # which the interpreter does not count
    on_step("simulate", 1, 1)
    if keep is not None:
        keep(simulation)
    actual = _measured(simulation, seconds, peak_mb)
    if glossy is not None:
        actual = replace(
            actual,
            residual=glossy.residual,
            products=glossy.products,
            noise=100 * glossy.noise,
            lobe_rays=glossy.rays,
        )
    return _checked(actual, planned, glossy or simulation, on_step) if check else actual


def run_simulate(request: SimulationRequest, on_step: OnStep = silent, check: bool = False) -> SimulationResult:
    """Plan a simulation as fine as its tolerance asks for, run it, and measure it; without any device.

    Parameters
    ----------
    request
        Scene, tolerance and light.
    on_step
        Told how far it is.
    check
        Measure the error against a refined solution.

    Returns
    -------
    SimulationResult
        The plan, and what was estimated and measured of error, seconds and memory.
    """
    planned, result = plan_simulation(request, on_step)
    return replace(result, actual=run_planned(planned, on_step, check))


def available_mb() -> float:
    """Memory free for use now [MB]."""
    return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e6


def _possible_mb(memory_mb: float) -> float:
    """Return what may be used. Raises UsageError when the machine has not so much."""
    machine_mb = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e6
    if memory_mb > machine_mb:
        raise UsageError(f"--memory-mb {memory_mb:g}: this machine has {machine_mb:.0f} MB; give less, or leave it out")
    return memory_mb


def _summary(planned: Plan, gloss: GlossSummary | None, tolerance: float, plan_s: float) -> PlanSummary:
    sizes_m = planned.cells.areas**0.5
    return PlanSummary(
        patches=planned.patches,
        smallest_patch_m=float(sizes_m.min()),
        largest_patch_m=float(sizes_m.max()),
        light=planned.light.name,
        method=planned.model.method if planned.model.compression is None else "compressed",
        visibility=planned.model.visibility_done,
        solver=planned.solver,
        channels=planned.channels,
        bounces=planned.bounces,
        reasons=(*planned.reasons, *(() if gloss is None else (reason_of(gloss, tolerance),))),
        seconds=plan_s,
        gloss=gloss,
    )


def _measured(simulation: Simulation, seconds: float, peak_mb: float) -> SimulationOutcome:
    return SimulationOutcome(
        seconds=seconds,
        peak_mb=peak_mb,
        residual=simulation.residual,
        closure_max=simulation.factors.closure_max,
        energy_balance=simulation.energy_balance,
        products=simulation.products,
    )


def _checked(
    actual: SimulationOutcome, planned: Plan, simulation: Simulation | GlossySimulation, on_step: OnStep
) -> SimulationOutcome:
    """The outcome with its error against a refined solution. Raises UsageError when that does not fit."""
    on_step(CHECK, 0, 1)
    largest = largest_check(planned.model, available_mb() / 2, once=isinstance(simulation, GlossySimulation))
    if 4 * planned.patches > largest:
        raise UsageError(
            f"--check: {4 * planned.patches:,} refined patches do not fit in {available_mb() / 2:.0f} MB; "
            "leave --check out, or raise the tolerance"
        )
    progress = in_percent(CHECK, on_step)
    if isinstance(simulation, GlossySimulation):
        check = refined_gloss_check(simulation, planned.light, planned.model, largest, on_progress=progress)
    else:
        check = refined_check(simulation, planned.light, planned.model, largest, on_progress=progress)
    on_step(CHECK, 1, 1)
    return replace(
        actual,
        error=100 * check.rms,
        error_max=100 * check.max,
        refined_patches=check.patches,
        refined_noise=100 * check.noise if check.noise > 0 else None,
    )
