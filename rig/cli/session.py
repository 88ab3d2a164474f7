"""The verbs of the command line that work on a session; no logic."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from rig.cli.options import (
    DEFAULT_STRATEGIES,
    Fit,
    Json,
    ProfileOption,
    SessionFolder,
    Strategies,
    Target,
    names_of,
    print_json,
)


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

    request = Request(session, profile, target, names_of(strategies), fit)
    if dry_run:
        plan = plan_session(request)
        print_json(plan) if as_json else print_plan(plan)
        return 0
    with TerminalProgress() as progress:
        result = run_session(request, progress)
    print_json(result) if as_json else print_run(result)
    return 0 if result["within_limits"] else 1


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
        result = run_part(Request(session, profile, target, names_of(strategies), fit), upto, progress)
    print_json(result) if as_json else print_part(upto, result)
    return 0 if result.get("within_limits", True) else 1


def calibrate(session: SessionFolder, *, profile: ProfileOption = None, as_json: Json = False) -> int:
    """Radiometric calibration, Gray code and geometry: response curves, lenses, poses, room.

    Example: rig calibrate runs/first -p sim-room
    """
    return _verb("calibrate", as_json, session, profile)


def separate(session: SessionFolder, *, profile: ProfileOption = None, as_json: Json = False) -> int:
    """Separate direct from global light with shifted checkers; calibrates first what is not calibrated.

    Example: rig separate runs/first
    """
    return _verb("separate", as_json, session, profile)


def model(session: SessionFolder, *, profile: ProfileOption = None, as_json: Json = False) -> int:
    """Build the room model: patches, reflectance, vignetting, brightness scale.

    Example: rig model runs/first --json
    """
    return _verb("model", as_json, session, profile)


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


def report(session: SessionFolder, *, as_json: Json = False) -> int:
    """Write report.html of a session that has been compared.

    Example: rig report runs/first
    """
    from rig.run.session import rewrite_report

    path = rewrite_report(session)
    print_json({"report": str(path)}) if as_json else print(path)
    return 0
