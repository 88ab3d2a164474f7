"""The verbs of the command line that show and look by hand, and hand pictures out; no logic."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from rig.cli.options import Json, print_json
from rig.errors import UsageError

Profile = Annotated[str, Parameter(name=["--profile", "-p"], help="Profile file or name.")]


def show(
    picture: Annotated[
        str, Parameter(help="white, black, grid, checks, stripes, focus, spots, or a picture's file.")
    ] = "grid",
    *,
    profile: Profile,
    fit: Annotated[bool, Parameter(negative="", help="Scale and crop a file of another size.")] = False,
    seconds: Annotated[float | None, Parameter(help="How long; default: until q.")] = None,
    as_json: Json = False,
) -> int:
    """Hold one picture on the projector until q: to aim, to focus, to measure by tape; black at the end.

    Pictures: white and black; grid (aim, shape); checks; stripes of 1, 2, 4 and 8 pixels; focus (nine stars: the grey
    disk in each is as large as the blur); spots (the two crosses of the tape step). A file is shown as it is.

    Example: rig show focus -p lab.toml
    """
    from rig.by_hand.show import show_picture

    def shown(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    result = show_picture(profile, picture, fit=fit, seconds=seconds, on_shown=shown)
    if as_json:
        print_json(result)
    return 0


def look(
    *,
    profile: Profile,
    picture: Annotated[
        str, Parameter(name="--show", help="Picture on the projector meanwhile; see rig show --help.")
    ] = "focus",
    exposure: Annotated[float | None, Parameter(help="Seconds; default: just below clipping.")] = None,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="PNG to write.")] = Path("look.png"),
    fit: Annotated[bool, Parameter(negative="", help="Scale and crop a file of another size.")] = False,
    watch: Annotated[
        bool, Parameter(negative="", help="Photograph again and again, and print how sharp it is; q ends it.")
    ] = False,
    seconds: Annotated[float | None, Parameter(help="How long to watch; default: until q.")] = None,
    as_json: Json = False,
) -> int:
    """Take one photograph and say what it is worth: levels, clipping, sharpness; or watch it while a lens is turned.

    Sharpness is the step of light from pixel to pixel, as a share of the mean: turn the focus until it is highest.

    Example: rig look -p lab.toml -o look.png

    Example: rig look -p lab.toml --watch
    """
    from rig.terminal import TerminalProgress

    if seconds is not None and not watch:
        raise UsageError("--seconds belongs to --watch; add it, or leave the seconds out")
    with TerminalProgress() as progress:
        from rig.by_hand.look import LookRequest
        from rig.by_hand.look import look as looked
        from rig.by_hand.tables import print_look, print_watched, watched

        request = LookRequest(
            profile=profile, show=picture, exposure_s=exposure, output=None if watch else output, fit=fit
        )
        taken = None if watch else looked(request, progress)
    if taken is None:
        seen = watched(request, seconds)
        print_json(seen) if as_json else print_watched(seen)
    else:
        print_json(taken) if as_json else print_look(taken)
    return 0


def export(
    session: Annotated[Path, Parameter(help="Folder of the session.")],
    *,
    output: Annotated[
        Path | None, Parameter(name=["--output", "-o"], help="Folder to make; default: SESSION-export beside it.")
    ] = None,
    form: Annotated[
        Literal["png", "exr"], Parameter(name="--format", help="png: to look at; exr: the numbers, exactly.")
    ] = "png",
    as_json: Json = False,
) -> int:
    """Write every photograph, map and picture of a session into a folder, by names that say what they show.

    contents.csv says of each file what it shows and on which scale. The session itself is only read.

    Example: rig export runs/first -o pictures
    """
    from rig.terminal import TerminalProgress

    with TerminalProgress() as progress:
        from rig.report.export import export_session

        folder = output or session.with_name(f"{session.resolve().name}-export")
        result = export_session(session, folder, form, progress)
    print_json(result) if as_json else print(
        f"{result.files} files in {result.folder}; what each shows: {result.contents}"
    )
    return 0
