"""The verbs of the command line; no logic. stdout is the result, stderr is progress.

Exit status: 0 ok, 1 outside limits, 2 usage or profile, 3 device, 4 session, 130 interrupted.
"""

from __future__ import annotations

import sys
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Literal

import cyclopts
from cyclopts import App, Parameter

from rig.cli.hardware import Json, devices, print_json, profile_app, virtual
from rig.cli.live import live
from rig.errors import RigError, UsageError


def _version() -> str:
    return version("procam-rig")


app = App(
    name="rig",
    help="Controller of a projector-camera rig: calibrate a room, simulate its interreflection, compensate it, "
    "and measure what was gained.\n\nStart with: rig run runs/first -p sim-room",
    help_format="markdown",
    version=_version,
    version_flags=["--version"],
    suppress_keyboard_interrupt=False,
)
app.command(profile_app)
app.command(devices)
app.command(virtual)
app.command(live)

ProfileOption = Annotated[
    str | None,
    Parameter(name=["--profile", "-p"], help="Profile file or name; needed once, then the session keeps its copy."),
]
SessionFolder = Annotated[Path, Parameter(help="Folder of the session; made if it does not exist.")]
Target = Annotated[Path | None, Parameter(help="Picture to show (PNG, JPEG, TIFF, EXR); default: a test picture.")]
Fit = Annotated[
    bool, Parameter(name="--fit", negative="", help="Scale and crop a target of another size to the projector's.")
]
Strategies = Annotated[
    str,
    Parameter(
        name=["--strategies", "--strategy"],
        help="Strategies to project, separated by commas, or all: none, direct, paper, exact, reverse_radiosity, "
        "block_fixed_point, tikhonov, series, dual, bounded, perceptual, remap, content_scale, smooth_attenuation.",
    ),
]
DEFAULT_STRATEGIES = "none,direct,paper,exact,bounded"


def run_command(arguments: list[str]) -> int:
    """Run one command line and return its exit status."""
    try:
        result = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except cyclopts.CycloptsError as error:
        print(f"rig: {error}\ntry: {_help_of(arguments)}", file=sys.stderr)
        return 2
    except RigError as error:
        print(f"rig: {error}", file=sys.stderr)
        return error.exit_code
    return result if isinstance(result, int) else 0


def _help_of(arguments: list[str]) -> str:
    """The command that explains the verb, or all verbs when there is no such verb."""
    named = arguments[:2] if arguments[:1] == ["profile"] else arguments[:1]
    known = ({*app}, {*profile_app})
    verbs = [word for word, there in zip(named, known, strict=False) if word in there]
    return " ".join(["rig", *verbs, "--help"])


@app.command
def run(
    session: SessionFolder,
    *,
    profile: ProfileOption = None,
    target: Target = None,
    fit: Fit = False,
    strategies: Strategies = DEFAULT_STRATEGIES,
    dry_run: Annotated[bool, Parameter(negative="", help="Print the plan and stop.")] = False,
    as_json: Json = False,
) -> int:
    """Run a whole session: calibrate, separate, model, compensate, project, photograph, compare, report.

    Steps that are done are skipped; after an interruption run the same command again.

    Example: rig run runs/first -p sim-room --target picture.png
    """
    from rig.report.tables import print_plan, print_run
    from rig.run.session import Request, plan_session, run_session
    from rig.terminal import TerminalProgress

    request = Request(session, profile, target, _names(strategies), fit)
    if dry_run:
        plan = plan_session(request)
        print_json(plan) if as_json else print_plan(plan)
        return 0
    with TerminalProgress() as progress:
        result = run_session(request, progress)
    print_json(result) if as_json else print_run(result)
    return 0 if result["within_limits"] else 1


def _names(strategies: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in strategies.split(","))


def _verb(
    upto: str,
    as_json: bool,
    session: Path,
    profile: str | None,
    target: Path | None = None,
    fit: bool = False,
    strategies: str = DEFAULT_STRATEGIES,
) -> int:
    from rig.report.tables import print_part
    from rig.run.session import Request, run_part
    from rig.terminal import TerminalProgress

    with TerminalProgress() as progress:
        result = run_part(Request(session, profile, target, _names(strategies), fit), upto, progress)
    print_json(result) if as_json else print_part(upto, result)
    return 0 if result.get("within_limits", True) else 1


@app.command
def calibrate(session: SessionFolder, *, profile: ProfileOption = None, as_json: Json = False) -> int:
    """Radiometric calibration, Gray code and geometry: response curves, lenses, poses, room.

    Example: rig calibrate runs/first -p sim-room
    """
    return _verb("calibrate", as_json, session, profile)


@app.command
def separate(session: SessionFolder, *, profile: ProfileOption = None, as_json: Json = False) -> int:
    """Separate direct from global light with shifted checkers; calibrates first what is not calibrated.

    Example: rig separate runs/first
    """
    return _verb("separate", as_json, session, profile)


@app.command
def model(session: SessionFolder, *, profile: ProfileOption = None, as_json: Json = False) -> int:
    """Build the room model: patches, reflectance, vignetting, brightness scale.

    Example: rig model runs/first --json
    """
    return _verb("model", as_json, session, profile)


@app.command
def compensate(
    session: SessionFolder,
    *,
    profile: ProfileOption = None,
    target: Target = None,
    fit: Fit = False,
    strategies: Strategies = DEFAULT_STRATEGIES,
    as_json: Json = False,
) -> int:
    """Compute the projector images of each strategy for a target, and predict what the camera will see.

    Example: rig compensate runs/first --target picture.png --strategies paper,bounded
    """
    return _verb("compensate", as_json, session, profile, target, fit, strategies)


@app.command
def compare(
    session: SessionFolder,
    *,
    profile: ProfileOption = None,
    target: Target = None,
    fit: Fit = False,
    strategies: Strategies = DEFAULT_STRATEGIES,
    as_json: Json = False,
) -> int:
    """Project and photograph each strategy and compare measurement with target and with simulation.

    Example: rig compare runs/first --target picture.png
    """
    return _verb("compare", as_json, session, profile, target, fit, strategies)


@app.command(name="compare-strategies")
def compare_strategies(
    session: Annotated[Path | None, Parameter(help="Folder of the session; made if it does not exist.")] = None,
    *,
    on_paper: Annotated[
        bool, Parameter(name="--paper", negative="", help="The paper's six configurations instead; no device.")
    ] = False,
    profile: ProfileOption = None,
    target: Target = None,
    fit: Fit = False,
    strategies: Strategies = "all",
    loop: Annotated[str, Parameter(help="Strategies whose loop is closed, separated by commas; or none.")] = "bounded",
    captures: Annotated[int, Parameter(help="Most captures of a closed loop, the uncorrected one included.")] = 4,
    rule: Annotated[
        Literal["image", "model"],
        Parameter(help="What a closed loop corrects: each pixel towards the target, or the model under the strategy."),
    ] = "image",
    perfect: Annotated[
        bool,
        Parameter(negative="", help="Simulated rigs: also what perfect knowledge of the simulated world would give."),
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
    from rig.paper.comparison import compare_on_paper
    from rig.run.session import Request
    from rig.strategies.comparison import Comparison
    from rig.strategies.comparison import compare_strategies as compared
    from rig.strategies.page import print_strategies
    from rig.terminal import TerminalProgress

    if (session is None) != on_paper:
        raise UsageError("name a session or give --paper, one of the two")
    with TerminalProgress() as progress:
        if session is None:
            result = compare_on_paper(_names(strategies), report, progress)
        else:
            request = Request(session, profile, target, _names(strategies), fit)
            loops = () if loop == "none" else _names(loop)
            wanted = Comparison(request, loops, captures, rule, perfect, not only_target)
            result = compared(wanted, progress)
    print_json(result) if as_json else print_strategies(result)
    return 0


@app.command
def report(session: SessionFolder, *, as_json: Json = False) -> int:
    """Write report.html of a session that has been compared.

    Example: rig report runs/first
    """
    from rig.run.session import rewrite_report

    path = rewrite_report(session)
    print_json({"report": str(path)}) if as_json else print(path)
    return 0


@app.command
def check(
    *,
    profile: Annotated[str, Parameter(name=["--profile", "-p"], help="Profile file or name.")],
    only: Annotated[str, Parameter(help="Parts to measure, separated by commas; default: all.")] = "",
    report: Annotated[Path | None, Parameter(help="HTML file to write, with charts.")] = None,
    as_json: Json = False,
) -> int:
    """Open a rig and measure what every rig must keep; prints values for its profile.

    Parts: latency, exposure, pipeline, flicker, linearity, noise, saturation, pixels, darkness, additivity, checker,
    ramp, stability.

    Example: rig check -p sim-room --only latency,noise --report check.html
    """
    from rig.self_check import run_check
    from rig.self_check.page import print_check, write_check_page
    from rig.terminal import TerminalProgress

    with TerminalProgress() as progress:
        result = run_check(profile, progress, _names(only) if only else ())
    if report is not None:
        result = result.with_report(write_check_page(result, report))
    print_json(result.as_json()) if as_json else print_check(result)
    return 0 if result.within_limits else 1


@app.command
def paper(
    *,
    figures: Annotated[Path | None, Parameter(help="Folder for pictures like the paper's figures.")] = None,
    as_json: Json = False,
) -> int:
    """Repeat the six configurations of Dehos et al. 2014, the published figures beside ours.

    Example: rig paper --figures figures/
    """
    from rig.paper.experiments import run_paper
    from rig.paper.tables import print_paper
    from rig.terminal import TerminalProgress

    with TerminalProgress() as progress:
        result = run_paper(figures, progress)
    print_json(result) if as_json else print_paper(result)
    return 0


@app.command
def simulate(
    scene: Annotated[
        str,
        Parameter(
            help="paper-room, corner, furnace, room-with-box, sloped-room, furnished-room, sphere, or a mesh file."
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
    unit: Annotated[Literal["m", "cm", "mm", "in", "ft"], Parameter(help="Unit of a mesh file.")] = "m",
    memory_mb: Annotated[float | None, Parameter(help="Memory that may be used; default: half of the free.")] = None,
    check: Annotated[
        bool, Parameter(name="--check", negative="", help="Measure the error against a refined solution.")
    ] = False,
    as_json: Json = False,
) -> int:
    """Plan and run a simulation as fine as a tolerance needs, without any device.

    Example: rig simulate paper-room --tolerance 0.5
    """
    from rig.offline.simulate import Request, plan_simulation, reflectances_of, run_planned, tolerance_of
    from rig.offline.tables import print_simulation, print_simulation_plan
    from rig.terminal import TerminalProgress

    percent = tolerance_of(tolerance, grey_levels)
    request = Request(scene, percent, light, reflectances_of(reflectance), unit, memory_mb)
    with TerminalProgress() as progress:
        planned, result = plan_simulation(request, progress)
    if not as_json:
        print_simulation_plan(result)
    with TerminalProgress() as progress:
        result["actual"] = run_planned(planned, progress, check)
    print_json(result) if as_json else print_simulation(result)
    return 0


@app.command
def bench(
    name: Annotated[str, Parameter(help="form-factors, solve, image, plan, compensate or live.")],
    *,
    quick: Annotated[bool, Parameter(negative="", help="Small problems in seconds, no peers.")] = False,
    full: Annotated[bool, Parameter(negative="", help="Large problems and fine references, in minutes.")] = False,
    table: Annotated[Path | None, Parameter(name="--csv", help="CSV file to write the points to.")] = None,
    as_json: Json = False,
) -> int:
    """Measure error, seconds and memory of the radiosity engine, beside the peers that are installed.

    Status 1 if an accuracy bar is missed; seconds and memory are shown, but decide nothing.

    Example: rig bench form-factors
    """
    from rig.benchmark import run_bench
    from rig.benchmark.tables import print_bench
    from rig.terminal import TerminalProgress

    if quick and full:
        raise UsageError("--quick and --full exclude each other; give one")
    with TerminalProgress() as progress:
        result = run_bench(name, "quick" if quick else "full" if full else "default", table, progress)
    print_json(result) if as_json else print_bench(result)
    return 0 if result["within_limits"] else 1


@app.command
def scan(
    manifest: Annotated[Path, Parameter(help="Manifest of a folder of Gray-code photographs (docs/how-to/replay.md).")],
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Point cloud to write.")] = Path("cloud.ply"),
    as_json: Json = False,
) -> int:
    """Turn Gray-code photographs and known lenses into a point cloud (.ply).

    Example: rig scan photographs/replay.toml -o cloud.ply
    """
    from rig.offline.scan import run_scan
    from rig.offline.tables import print_scan
    from rig.terminal import TerminalProgress

    with TerminalProgress() as progress:
        result = run_scan(manifest, output, on_step=progress)
    print_json(result) if as_json else print_scan(result)
    return 0
