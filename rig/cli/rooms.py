"""The verb of the command line that plans rooms; no logic."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from rig.cli.options import Json, print_json


def plan(
    room: Annotated[Path, Parameter(help="Room file (TOML), or the bare name of one that comes along.")],
    *,
    report: Annotated[Path | None, Parameter(help="HTML page to write; default: the room's name here.")] = None,
    search: Annotated[
        bool, Parameter(help="Look for better designs where the file has a [search]; --no-search leaves it out.")
    ] = True,
    as_json: Json = False,
) -> int:
    """Plan a room before it is built: brightness, contrast, errors, shadows, and the best place for the projector.

    Example: rig plan paper-room

    Example: rig plan lecture-room --report lecture.html --no-search
    """
    from rig.terminal import TerminalProgress

    page = Path(f"{room.stem}.html") if report is None else report
    with TerminalProgress() as progress:
        from rig.plan.run import run_plan
        from rig.plan.tables import print_plan

        result = run_plan(room, page, progress, search=search)
    print_json(result.as_json()) if as_json else print_plan(result, str(page))
    return 0
