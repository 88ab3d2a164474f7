"""The verbs of the command line that compare, replicate, simulate and measure; no logic."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from rig.cli.options import (
    NO_PLACE,
    Fit,
    Json,
    Linear,
    PlaceOptions,
    ProfileOption,
    Strategies,
    Target,
    names_of,
    print_json,
)
from rig.errors import UsageError

if TYPE_CHECKING:
    from sim.planning.simulation import Simulation


def compare_strategies(
    session: Annotated[Path | None, Parameter(help="Folder of the session; made if it does not exist.")] = None,
    *,
    on_paper: Annotated[
        bool, Parameter(name="--paper", negative="", help="The paper's six configurations instead; no device.")
    ] = False,
    profile: ProfileOption = None,
    target: Target = None,
    fit: Fit = False,
    linear: Linear = False,
    place: PlaceOptions = NO_PLACE,
    strategies: Strategies = "all",
    loop: Annotated[str, Parameter(help="Strategies whose loop is closed, separated by commas; or none.")] = "bounded",
    captures: Annotated[int, Parameter(help="Most captures of a closed loop, the uncorrected one included.")] = 4,
    rule: Annotated[
        Literal["image", "model"],
        Parameter(help="What a closed loop corrects: each pixel towards the target, or the model under the strategy."),
    ] = "image",
    oracle: Annotated[
        bool,
        Parameter(negative="", help="Simulated rigs: also what knowing the simulated world would give."),
    ] = False,
    only_target: Annotated[
        bool, Parameter(negative="", help="Leave the two-wall picture, the dark and the bright photograph out.")
    ] = False,
    report: Annotated[Path | None, Parameter(help="HTML file to write, with --paper.")] = None,
    as_json: Json = False,
) -> int:
    """Project and photograph every strategy, close the loop, and judge them side by side.

    Does first what the session lacks up to its model; after an interruption run the same command again.

    Example: rig compare-strategies runs/first --captures 8

    Example: rig compare-strategies --paper --report strategies.html
    """
    from rig.terminal import TerminalProgress

    if (session is None) != on_paper:
        raise UsageError("name a session or give --paper, one of the two")
    with TerminalProgress() as progress:
        from rig.paper.comparison import compare_on_paper
        from rig.run.request import SessionRequest
        from rig.strategies.comparison import Comparison
        from rig.strategies.comparison import compare_strategies as compared
        from rig.strategies.page import print_strategies

        if session is None:
            result = compare_on_paper(names_of(strategies), report, progress)
        else:
            request = SessionRequest(
                folder=session,
                profile=profile,
                target=target,
                fit=fit,
                linear=linear,
                place=place.table(),
                strategies=names_of(strategies),
            )
            loops = () if loop == "none" else names_of(loop)
            wanted = Comparison(
                request=request,
                loops=loops,
                captures=captures,
                rule=rule,
                oracle=oracle,
                test_pictures=not only_target,
            )
            result = compared(wanted, progress)
    print_json(result.as_json()) if as_json else print_strategies(result)
    return 0


def paper(
    *,
    figures: Annotated[Path | None, Parameter(help="Folder for pictures like the paper's figures.")] = None,
    as_json: Json = False,
) -> int:
    """Repeat the six configurations of Dehos et al. 2014, the published figures beside ours.

    Example: rig paper --figures figures/
    """
    from rig.terminal import TerminalProgress

    with TerminalProgress() as progress:
        from rig.paper.experiments import run_paper
        from rig.paper.tables import print_paper

        result = run_paper(figures, progress)
    print_json(result.as_json()) if as_json else print_paper(result)
    return 0


def simulate(
    scene: Annotated[
        str,
        Parameter(
            help="paper-room, corner, furnace, room-with-box, sloped-room, furnished-room, sphere, corner-with-ball, "
            "or a mesh file."
        ),
    ],
    *,
    tolerance: Annotated[float | None, Parameter(help="Error allowed, % of white; default: 1.")] = None,
    grey_levels: Annotated[float | None, Parameter(help="The same in grey levels, white = 255.")] = None,
    light: Annotated[
        Literal["projector", "floor", "uniform"] | None, Parameter(help="White light; default: the scene's own.")
    ] = None,
    reflectance: Annotated[
        str, Parameter(help="One number, or one for each colour, separated by commas; default: the scene's own.")
    ] = "",
    gloss: Annotated[
        float | None, Parameter(help="Share of light that all patches send back glossy; default: the mesh file's.")
    ] = None,
    roughness: Annotated[float | None, Parameter(help="Of that gloss: alpha of GGX; default: 0.3.")] = None,
    unit: Annotated[
        Literal["m", "cm", "mm", "in", "inch", "ft"] | None, Parameter(help="Unit of a mesh file; default: m.")
    ] = None,
    up: Annotated[
        Literal["x", "y", "z", "-x", "-y", "-z"] | None,
        Parameter(help="Axis of a mesh file that points up; default: y of glTF, z of others."),
    ] = None,
    sides: Annotated[
        Literal["judged", "file", "both"],
        Parameter(help="Sides of a mesh file's facets that are lit: judged, as in the file, or open sheets on both."),
    ] = "judged",
    merge_mm: Annotated[
        float | None,
        Parameter(help="Open borders of a mesh file nearer than this become one; default: 1e-5 of its size."),
    ] = None,
    faults: Annotated[
        Path | None,
        Parameter(help="PLY file to write: the facets of a mesh file, coloured by what is wrong."),
    ] = None,
    projector_at: Annotated[
        str | None, Parameter(help="White projector at X,Y,Z m instead of --light; needs --look-at.")
    ] = None,
    look_at: Annotated[str | None, Parameter(help="X,Y,Z m that the projector is aimed at.")] = None,
    fov: Annotated[float | None, Parameter(help="Its horizontal field of view, degrees; default: 100.")] = None,
    output: Annotated[
        Path | None,
        Parameter(
            name=["--output", "-o"],
            help="Folder for a picture, brightness by surface (CSV), a mesh with its light (PLY, GLB) and a page.",
        ),
    ] = None,
    memory_mb: Annotated[float | None, Parameter(help="Memory that may be used; default: half of the free.")] = None,
    seconds: Annotated[
        float | None, Parameter(help="Limit instead of a tolerance: the smallest error that fits into the time.")
    ] = None,
    check: Annotated[
        bool, Parameter(name="--check", negative="", help="Measure the error against a refined solution.")
    ] = False,
    as_json: Json = False,
) -> int:
    """Plan and run a simulation as fine as a tolerance needs, without any device.

    Example: rig simulate paper-room --tolerance 0.5

    Example: rig simulate paper-room --projector-at 1.2,1.2,1.2 --look-at 2.2,2.2,1.2 --output light/
    """
    from rig.offline.mesh_file import MeshOptions
    from rig.offline.projector import projector_of
    from rig.offline.simulate import (
        SimulationRequest,
        plan_simulation,
        reflectances_of,
        run_planned,
        tolerance_of,
    )
    from rig.offline.tables import print_simulation, print_simulation_plan
    from rig.terminal import TerminalProgress

    percent = tolerance_of(tolerance, grey_levels, seconds)
    request = SimulationRequest(
        scene=scene,
        tolerance=percent,
        light=light,
        reflectance=reflectances_of(reflectance),
        mesh=MeshOptions(unit=unit, up=up, sides=sides, merge_mm=merge_mm, faults=faults),
        memory_mb=memory_mb,
        seconds=seconds,
        gloss=gloss,
        roughness=roughness,
        projector=projector_of(projector_at, look_at, fov, light),
    )
    with TerminalProgress() as progress:
        planned, result = plan_simulation(request, progress)
    if not as_json:
        print_simulation_plan(result)
    with TerminalProgress() as progress:
        kept: list[Simulation] = []
        result = replace(result, actual=run_planned(planned, progress, check, kept.append))
        if output is not None:
            from rig.plan.simulated.files import write_simulation

            result = replace(result, files=write_simulation(output, request, planned, kept[0]))
    print_json(result.as_json()) if as_json else print_simulation(result)
    return 0


def bench(
    name: Annotated[str, Parameter(help="form-factors, solve, image, plan, compensate, live, decode or meshes.")],
    *,
    quick: Annotated[bool, Parameter(negative="", help="Small problems in seconds, no peers.")] = False,
    full: Annotated[bool, Parameter(negative="", help="Large problems and fine references, in minutes.")] = False,
    table: Annotated[Path | None, Parameter(name="--csv", help="CSV file to write the points to.")] = None,
    as_json: Json = False,
) -> int:
    """Measure error, seconds and memory of engine and codes, beside the peers that are installed.

    Status 1 if an accuracy bar is missed; seconds and memory are shown, but decide nothing.

    Example: rig bench form-factors
    """
    from rig.terminal import TerminalProgress

    if quick and full:
        raise UsageError("--quick and --full exclude each other; give one")
    with TerminalProgress() as progress:
        from rig.benchmark import run_bench
        from rig.benchmark.tables import print_bench
        from rig.files.atomic import check_output

        if table is not None:
            check_output(table)
        result = run_bench(name, "quick" if quick else "full" if full else "default", table, progress)
    print_json(result.as_json()) if as_json else print_bench(result)
    return 0 if result.within_limits else 1


def scan(
    manifest: Annotated[Path, Parameter(help="Manifest of a folder of Gray-code photographs (docs/how-to/replay.md).")],
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Point cloud to write.")] = Path("cloud.ply"),
    as_json: Json = False,
) -> int:
    """Turn Gray-code photographs and known lenses into a point cloud (.ply).

    Status 1 if something is wrong with the photographs that could not be mended.

    Example: rig scan photographs/replay.toml -o cloud.ply
    """
    from rig.terminal import TerminalProgress

    with TerminalProgress() as progress:
        from rig.offline.scan import run_scan
        from rig.offline.tables import print_scan

        result = run_scan(manifest, output, on_step=progress)
    print_json(result.as_json()) if as_json else print_scan(result)
    return 1 if result.warnings else 0


def lenses(
    manifest: Annotated[Path, Parameter(help="Manifest of photographs of boards (docs/how-to/lenses.md).")],
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Lens file to write.")] = Path("lenses.toml"),
    report: Annotated[Path | None, Parameter(help="HTML page to write; default: beside the lens file.")] = None,
    as_json: Json = False,
) -> int:
    """Calibrate a camera's lens, and a projector's, from photographs of boards or lists of their corners.

    Status 1 if a limit is missed or a view had to be left out.

    Example: rig lenses boards/lenses.toml -o lens-file.toml
    """
    from rig.terminal import TerminalProgress

    page = output.with_suffix(".html") if report is None else report
    with TerminalProgress() as progress:
        from rig.lenses.run import run_lenses
        from rig.lenses.tables import print_lenses

        result = run_lenses(manifest, output, page, on_step=progress)
    print_json(result.as_json()) if as_json else print_lenses(result)
    return 0 if result.within_limits else 1


def sweep(
    study: Annotated[Path, Parameter(help="File of the study (docs/how-to/sweeps.md).")],
    *,
    folder: Annotated[
        Path | None, Parameter(help="Where points are kept; default: runs/ and the study's name.")
    ] = None,
    workers: Annotated[int | None, Parameter(help="Processes on this machine; default: one a processor.")] = None,
    scheduler: Annotated[
        str | None, Parameter(help="Dask scheduler to compute on instead, such as tcp://head-node:8786.")
    ] = None,
    tries: Annotated[int | None, Parameter(help="Of a point that kills its worker; default: the study's, 3.")] = None,
    retry: Annotated[bool, Parameter(negative="", help="Also points that failed before.")] = False,
    as_json: Json = False,
) -> int:
    """Compute a study: many points of a plan, a simulated rig or the paper's room, on all processors or a cluster.

    Points that are done are never done again; after an interruption run the same command again. Status 1 if a point
    has no answer.

    Example: rig sweep studies/paper-poses.toml --workers 2
    """
    from rig.terminal import TerminalProgress

    with TerminalProgress() as progress:
        from rig.sweeps.executors import ExecutorChoice
        from rig.sweeps.run import SweepRequest, run_sweep
        from rig.sweeps.tables import print_sweep

        where = ExecutorChoice(workers=workers, scheduler=scheduler)
        request = SweepRequest(study=study, folder=folder, where=where, tries=tries, retry=retry)
        result = run_sweep(request, progress)
    print_json(result.as_json()) if as_json else print_sweep(result)
    return 1 if result.refused + result.killed else 0
