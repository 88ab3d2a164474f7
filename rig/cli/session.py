"""The verbs of the command line that work on a session; no logic."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from rig.cli.options import (
    DEFAULT_STRATEGIES,
    NO_PLACE,
    Fit,
    Json,
    Linear,
    PlaceOptions,
    ProfileOption,
    SessionFolder,
    Strategies,
    Target,
    names_of,
    print_json,
)
from rig.run.request import SessionRequest

if TYPE_CHECKING:
    from rig.run.steps import Verb


def run(
    session: SessionFolder,
    *,
    profile: ProfileOption = None,
    target: Target = None,
    fit: Fit = False,
    linear: Linear = False,
    place: PlaceOptions = NO_PLACE,
    strategies: Strategies = DEFAULT_STRATEGIES,
    dry_run: Annotated[bool, Parameter(negative="", help="Print the plan and stop.")] = False,
    as_json: Json = False,
) -> int:
    """Run a whole session: calibrate, separate, model, compensate, project, photograph, compare, report.

    Steps that are done are skipped; after an interruption run the same command again.

    Example: rig run runs/first -p sim-room --target picture.png
    """
    request = SessionRequest(
        folder=session,
        profile=profile,
        target=target,
        fit=fit,
        linear=linear,
        place=place.table(),
        strategies=names_of(strategies),
    )
    return _plan(request, as_json) if dry_run else _run(request, as_json)


def _plan(request: SessionRequest, as_json: bool) -> int:
    from rig.report.tables import print_steps
    from rig.run.plan import plan_session

    plan = plan_session(request)
    if as_json:
        print_json(plan)
    else:
        steps = [(step.step, step.done, step.frames) for step in plan.steps]
        print_steps(plan.title, steps)
    return 0


def _run(request: SessionRequest, as_json: bool) -> int:
    from rig.terminal import TerminalProgress

    with TerminalProgress() as progress:  # something is to be seen before what takes its time is imported
        from rig.report.tables import print_result
        from rig.run.session import run_session

        result = run_session(request, progress)
    print_json(result) if as_json else print_result(result)
    return 0 if result.within_limits else 1


def _part(verb: Verb, request: SessionRequest, as_json: bool) -> int:
    from rig.terminal import TerminalProgress

    with TerminalProgress() as progress:
        from rig.report.tables import print_part
        from rig.run.session import run_part

        result = run_part(request, verb, progress)
    print_json(result) if as_json else print_part(verb, result)
    return 0


def calibrate(session: SessionFolder, *, profile: ProfileOption = None, as_json: Json = False) -> int:
    """Radiometric calibration, Gray code and geometry: response curves, lenses, poses, room.

    Example: rig calibrate runs/first -p sim-room
    """
    return _part("calibrate", SessionRequest(folder=session, profile=profile), as_json)


def separate(session: SessionFolder, *, profile: ProfileOption = None, as_json: Json = False) -> int:
    """Separate direct from global light with shifted checkers; calibrates first what is not calibrated.

    Example: rig separate runs/first
    """
    return _part("separate", SessionRequest(folder=session, profile=profile), as_json)


def model(
    session: SessionFolder,
    *,
    profile: ProfileOption = None,
    export: Annotated[
        Path | None, Parameter(help="Write the room as binary glTF (.glb): surface, reflectance, confidence, devices.")
    ] = None,
    as_json: Json = False,
) -> int:
    """Build the room model: patches, reflectance, vignetting, brightness scale.

    Example: rig model runs/first --json

    Example: rig model runs/first --export room.glb
    """
    request = SessionRequest(folder=session, profile=profile)
    return _part("model", request, as_json) if export is None else _export(request, export, as_json)


def _export(request: SessionRequest, path: Path, as_json: bool) -> int:
    from rig.terminal import TerminalProgress

    with TerminalProgress() as progress:
        from rig.report.scene.room_file import check_room_file, export_room
        from rig.run.session import run_part

        check_room_file(path)
        run_part(request, "model", progress)
        found = export_room(Path(request.folder), path, progress)
    print_json(found) if as_json else print(
        f"{found.file}: {found.triangles} triangles of {len(found.parts)} parts ({', '.join(found.parts)}), devices "
        f"{', '.join(found.devices)}"
    )
    return 0


def compensate(
    session: SessionFolder,
    *,
    profile: ProfileOption = None,
    target: Target = None,
    fit: Fit = False,
    linear: Linear = False,
    place: PlaceOptions = NO_PLACE,
    strategies: Strategies = DEFAULT_STRATEGIES,
    as_json: Json = False,
) -> int:
    """Compute the projector images of each strategy for a target, and predict what the camera will see.

    Example: rig compensate runs/first --target picture.png --strategies paper,bounded
    """
    request = SessionRequest(
        folder=session,
        profile=profile,
        target=target,
        fit=fit,
        linear=linear,
        place=place.table(),
        strategies=names_of(strategies),
    )
    return _part("compensate", request, as_json)


def compare(
    session: SessionFolder,
    *,
    profile: ProfileOption = None,
    target: Target = None,
    fit: Fit = False,
    linear: Linear = False,
    place: PlaceOptions = NO_PLACE,
    strategies: Strategies = DEFAULT_STRATEGIES,
    as_json: Json = False,
) -> int:
    """Project and photograph each strategy and compare measurement with target and with simulation.

    Example: rig compare runs/first --target picture.png
    """
    request = SessionRequest(
        folder=session,
        profile=profile,
        target=target,
        fit=fit,
        linear=linear,
        place=place.table(),
        strategies=names_of(strategies),
    )
    return _run(request, as_json)


def recheck(
    session: Annotated[Path, Parameter(help="Folder of a calibrated session.")],
    *,
    profile: Annotated[
        str | None, Parameter(name=["--profile", "-p"], help="Profile that differs in [simulation] alone.")
    ] = None,
    realign: Annotated[bool, Parameter(negative="", help="Measure anew what moved; the session itself stays.")] = False,
    as_json: Json = False,
) -> int:
    """Say in under a minute whether camera or projector moved since, by how much, and whether brightness drifted.

    Status: 0 within limits, 1 outside, or nothing explains what the camera sees.

    Example: rig recheck runs/first --realign
    """
    from rig.terminal import TerminalProgress

    with TerminalProgress() as progress:
        from rig.recheck.page import print_recheck
        from rig.recheck.records import RecheckRequest
        from rig.recheck.run import run_recheck

        result = run_recheck(RecheckRequest(folder=session, profile=profile, realign=realign), progress)
    print_json(result) if as_json else print_recheck(result)
    return 0 if result.within_limits else 1


def report(
    session: SessionFolder,
    *,
    output: Annotated[
        Path | None,
        Parameter(name=["--output", "-o"], help="HTML file instead of the session's own; the session is only read."),
    ] = None,
    as_json: Json = False,
) -> int:
    """Write report.html of a session that has been compared.

    Example: rig report runs/first

    Example: rig report /media/archive/first -o first.html
    """
    from rig.run.session import rewrite_report

    path = rewrite_report(session, output)
    print_json({"report": str(path)}) if as_json else print(path)
    return 0
