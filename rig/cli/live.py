"""The verb of the command line for live pictures; no logic."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from rig.cli.options import Json, print_json


def live(
    session: Annotated[Path | None, Parameter(help="Session with a model (rig model); without one give -p.")] = None,
    *,
    profile: Annotated[
        str | None, Parameter(name=["--profile", "-p"], help="Profile file or name; default: the session's.")
    ] = None,
    source: Annotated[
        tuple[str, ...],
        Parameter(
            help="Video file, picture, folder, named pipe, pipe:PATH, - (standard input), shm:NAME, camera:ID or "
            "pattern; may be given several times.",
            negative="",
            allow_leading_hyphen=True,
        ),
    ] = ("pattern",),
    strategy: Annotated[str, Parameter(help="exact, bounded, or none.")] = "bounded",
    seconds: Annotated[float | None, Parameter(help="How long; default: until q, or the sources' end.")] = None,
    size: Annotated[str, Parameter(help="WIDTHxHEIGHT of raw RGB24 pictures; default: PPM headers tell.")] = "",
    rate: Annotated[float | None, Parameter(help="Pictures a second of a folder or the pattern.")] = None,
    loop: Annotated[bool, Parameter(negative="", help="Begin again after the last source.")] = False,
    keep_going: Annotated[
        bool, Parameter(name="--keep-going", negative="", help="Try sources that fail again; black meanwhile.")
    ] = False,
    gain: Annotated[float, Parameter(help="Times the target's brightness.")] = 1.0,
    auto_gain: Annotated[bool, Parameter(negative="", help="Darken slowly what would clip at white.")] = False,
    linear: Annotated[bool, Parameter(negative="", help="Codes are linear light; default: sRGB.")] = False,
    record: Annotated[Path | None, Parameter(help="New folder: what was shown and photographed.")] = None,
    flashes: Annotated[bool, Parameter(negative="", help="First measure the latency to light, with flashes.")] = False,
    threads: Annotated[int, Parameter(help="Of the frame kernel.")] = 2,
    as_json: Json = False,
) -> int:
    """Show live pictures, each compensated, at the display's pace; black at the end.

    Status: 0 ended as asked; 20 camera missing, 21 film broken, 22 no picture, 23 source gone, 24 stream broken;
    130, 143, 129 ended by SIGINT, SIGTERM, SIGHUP.

    Keys: n next source, c compensation on or off, s next strategy, + - gain, a automatic gain, f freeze, b black,
    q quit.

    Example: rig live runs/first --source film.mp4
    """
    from rig.terminal import TerminalProgress

    with TerminalProgress():
        from rig.live.latency import with_light_latency
        from rig.live.plan import LiveRequest, plan_live
        from rig.live.run import run_live
        from rig.live.sources.choose import parse_size
        from rig.live.status import StatusLine, print_live
    request = LiveRequest(
        folder=session,
        profile=profile,
        sources=source,
        strategy=strategy,
        seconds=seconds,
        size=parse_size(size),
        rate_hz=rate,
        endless=loop,
        keeps_going=keep_going,
        gain=gain,
        auto_gain=auto_gain,
        is_linear=linear,
        record=record,
        flashes=flashes,
        threads=threads,
    )
    with TerminalProgress() as progress:
        plan = with_light_latency(plan_live(request, progress), progress)
        with StatusLine() as status:
            result = run_live(plan, status)
    print_json(result.as_json()) if as_json else print_live(result)
    return result.exit_status
