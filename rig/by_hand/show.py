"""One picture on the projector until somebody ends it: to aim, to focus, to measure by tape."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

from rig.by_hand.pictures import SPOTS, picture_named, spots_of
from rig.devices.clock import SystemClock
from rig.devices.drivers import make_devices
from rig.devices.protocols import Projector, check_on_screen
from rig.devices.simulated.display import ClockedDisplay
from rig.errors import UsageError
from rig.profile.schema import Profile, load_runnable_profile
from rig.records import Record
from rig.terminal.keys import Keyboard
from rig.terminal.signals import EndSignals

_LOOK_S = 0.1
"""Between two looks for a key: faster than a person notices."""


@dataclass(frozen=True, kw_only=True)
class ShownPicture(Record):
    """What was shown, and why it ended."""

    picture: str
    width_px: int
    height_px: int
    seconds: float
    ended_by: str
    """key q, time over, or the name of a signal."""
    spots_px: tuple[tuple[float, float], ...] | None = None
    """Where the crosses were, (x, y)."""
    profile: str = ""
    """In words: the colour space that the picture's file told and that was made sRGB; empty: none but sRGB."""


def show_picture(
    profile: str,
    name: str,
    *,
    fit: bool = False,
    seconds: float | None = None,
    on_shown: Callable[[str], None] = lambda _: None,
) -> ShownPicture:
    """Hold a picture on a rig's projector until q, a signal, or the end of its time; the projector is black afterwards.

    Parameters
    ----------
    profile
        File or name; its camera is left alone.
    name
        As for :func:`rig.by_hand.pictures.picture_named`.
    fit
        Scale and crop a file of another size.
    seconds
        How long; None: until it is ended.
    on_shown
        Told a line for a person when the picture is on screen.

    Returns
    -------
    ShownPicture

    Raises
    ------
    ProfileError, UsageError
        The profile or the picture cannot be used.
    DeviceError
        The projector does not open, or goes away.
    """
    if seconds is not None and not (math.isfinite(seconds) and seconds > 0):
        raise UsageError(f"--seconds {seconds:g} is no time to show a picture; give a number above 0, or leave it out")
    rig = load_runnable_profile(profile)
    picture, clock = picture_named(name, rig, fit=fit), SystemClock()
    projector = _projector(rig)
    with ExitStack() as stack:
        signals = stack.enter_context(EndSignals())
        keyboard = stack.enter_context(Keyboard())
        stack.callback(projector.close)
        projector.open()
        projector.show(picture.codes, name=name)
        started_s = clock.now_s()
        on_shown(_sentence(name, picture.profile, rig, seconds))
        end = _hold(projector, signals, keyboard, until_s=math.inf if seconds is None else started_s + seconds)
    return ShownPicture(
        picture=name,
        width_px=picture.codes.shape[1],
        height_px=picture.codes.shape[0],
        profile=picture.profile,
        seconds=clock.now_s() - started_s,
        ended_by=end,
        spots_px=spots_of(rig) if name == SPOTS else None,
    )


def _projector(profile: Profile) -> Projector:
    """The profile's, closed; a simulated one is only a display that keeps time: nobody photographs it."""
    settings = profile.projector
    if settings.driver == "replay":
        raise UsageError(f"{profile.path}: a recording shows nothing; give a real or simulated rig's profile")
    if settings.driver == "simulated":
        return ClockedDisplay(settings.shape, settings.refresh_rate_hz, SystemClock())
    return make_devices(profile).projectors[settings.name]


def _hold(projector: Projector, signals: EndSignals, keyboard: Keyboard, *, until_s: float) -> str:
    """Wait, and look whether the picture is still there; return what ended it. Raises DeviceLost."""
    clock = SystemClock()
    while clock.now_s() < until_s:
        if "q" in keyboard.pressed():
            return "key q"
        if signals.received is not None:
            return signals.name
        check_on_screen(projector)
        clock.wait_until_s(min(until_s, clock.now_s() + _LOOK_S))
    return "time over"


def _sentence(name: str, colours: str, profile: Profile, seconds: float | None) -> str:
    ends = "q or Ctrl-C ends it" if seconds is None else f"for {seconds:g} s, or until q"
    where = " (simulated: nobody sees it)" if profile.projector.driver == "simulated" else ""
    told = f", taken as {colours}," if colours else ""
    output = profile.projector.output or profile.projector.name
    return f"{name}{told} is on {output}{where}; {ends}{_tape(name, profile)}"


def _tape(name: str, profile: Profile) -> str:
    """What to do with the spots."""
    if name != SPOTS:
        return ""
    pixels = ", ".join(f"({x:g}, {y:g})" for x, y in spots_of(profile))
    lines = ", ".join(f"[{x:g}, {y:g}]" for x, y in spots_of(profile))
    return (
        f"\ncrosses at the pixels {pixels}: measure between their middles by tape, and write into the profile's "
        f'[[scale]]\n  projector = "{profile.projector.name}"\n  spots_px = [{lines}]\n  distance_m = ...'
    )
