"""The verb of the command line for live pictures; no logic."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from rig.cli.options import Json, print_json
from rig.errors import UsageError


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
    seconds: Annotated[
        float | None, Parameter(help="How long, from the first picture on; default: until q, or the sources' end.")
    ] = None,
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
    show: Annotated[
        str | None,
        Parameter(help="Saved show to keep for months: its file, or NAME of shows/NAME.toml; all else is in it."),
    ] = None,
    as_json: Json = False,
) -> int:
    """Show live pictures, each compensated, at the display's pace; black at the end.

    Status: 0 ended as asked; 20 camera missing, 21 film broken, 22 no picture, 23 source gone, 24 stream broken;
    130, 143, 129 ended by SIGINT, SIGTERM, SIGHUP.

    Keys: n next source, c compensation on or off, s next strategy, + - gain, a automatic gain, f freeze, b black,
    q quit.

    Example: rig live runs/first --source film.mp4; rig live --show lobby
    """
    from rig.terminal import TerminalProgress

    if show is not None:
        return _keep(show, has_more=session is not None or profile is not None, as_json=as_json)
    with TerminalProgress() as progress:  # something is to be seen before what takes its time is imported
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
        plan = with_light_latency(plan_live(request, progress), progress)
        with StatusLine() as status:
            result = run_live(plan, status)
    print_json(result.as_json()) if as_json else print_live(result)
    return result.exit_status


def _keep(name: str, *, has_more: bool, as_json: bool) -> int:
    """Run a saved show until somebody ends it."""
    from rig.live.status import StatusLine
    from rig.shows.run import keep_show
    from rig.terminal import TerminalProgress

    if has_more:
        raise UsageError("--show names a saved show, which says what is shown; leave session and profile out")
    with TerminalProgress() as progress, StatusLine() as status:
        result = keep_show(name, progress, status)
    shown = f"{result.seconds_shown:.0f} s shown in {result.runs} runs, {result.failures} failures"
    print_json(result) if as_json else print(f"{shown}; ended by {result.signal or result.ended_by}")
    return result.exit_status
