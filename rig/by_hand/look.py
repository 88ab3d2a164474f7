"""One photograph by hand, with figures; or the same figures again and again while somebody turns a lens."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from calibration.radiometry.exposure import ExposureAim, brightest_share, next_exposure
from rig.by_hand.photograph import PhotographFigures, figures_of, viewable
from rig.by_hand.pictures import picture_named
from rig.capture.rig import Rig
from rig.devices.clock import SystemClock
from rig.devices.drivers import make_devices
from rig.devices.protocols import RawFrame
from rig.errors import UsageError
from rig.files.atomic import check_output
from rig.files.pictures import write_png
from rig.profile.schema import Profile, load_runnable_profile
from rig.records import Record
from rig.stages.error_tree import one_error_tree
from rig.terminal import OnStep, silent
from rig.terminal.keys import Keyboard
from rig.terminal.signals import EndSignals

_AIM = ExposureAim(share=0.8, accepted=(0.6, 0.95))
"""Of the brightest permille: nothing clips, and dark parts are still seen."""
_MOST_TRIES = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class LookRequest:
    """What is to be photographed, and how."""

    profile: str
    """File or name."""
    show: str = "focus"
    """Picture on the projector meanwhile (:func:`rig.by_hand.pictures.picture_named`)."""
    exposure_s: float | None = None
    """None: searched, so that the brightest is just below clipping."""
    output: Path | None = None
    """PNG to write."""
    fit: bool = False


@dataclass(frozen=True, kw_only=True)
class Look(Record):
    """A photograph's figures, and how it was taken."""

    picture: str
    """That the projector showed."""
    exposure_s: float
    width_px: int
    height_px: int
    figures: PhotographFigures
    photograph: str | None = None
    """PNG that was written."""
    profile: str = ""
    """In words: the colour space that the picture's file told and that was made sRGB; empty: none but sRGB."""


@dataclass(frozen=True, kw_only=True)
class WatchedLens(Record):
    """What a watched lens came to."""

    looks: int
    first: float | None = None
    """Sharpness of the first photograph."""
    best: float | None = None
    last: float | None = None
    ended_by: str


def look(request: LookRequest, on_step: OnStep = silent) -> Look:
    """Take a photograph, write it as PNG, and return its figures.

    Parameters
    ----------
    request
        What and how.
    on_step
        Told how far it is.

    Returns
    -------
    Look

    Raises
    ------
    ProfileError, UsageError
        The profile or the picture cannot be used.
    DeviceError
        A device does not open, or no good frame came.
    SessionError
        The disk refuses the PNG.
    """
    if request.output is not None:
        check_output(request.output)
    with one_error_tree(), _opened(request, on_step) as rig:
        looker = _Looker(rig, request, on_step)
        taken, frame = looker.look(again=looker.first)
    if request.output is None:
        return taken
    write_png(request.output, viewable(frame, rig.camera.full_scale_dn))
    return Look(**{**vars(taken), "photograph": str(request.output)})


def watch(
    request: LookRequest,
    on_look: Callable[[Look, float | None], None],
    *,
    seconds: float | None = None,
    on_step: OnStep = silent,
) -> WatchedLens:
    """Photograph again and again until q, a signal, or the end of the time.

    Parameters
    ----------
    request
        What and how; no PNG is written.
    on_look
        Told each look, and the best sharpness so far.
    seconds
        How long by the machine's clock; None: until it is ended.
    on_step
        Told how far the first photograph is.

    Returns
    -------
    WatchedLens

    Raises
    ------
    ProfileError, UsageError, DeviceError
        As for :func:`look`.
    """
    if seconds is not None and not (math.isfinite(seconds) and seconds > 0):
        raise UsageError(f"--seconds {seconds:g} is no time to watch; give a number above 0, or leave it out")
    clock = SystemClock()
    with one_error_tree(), EndSignals() as signals, _opened(request, on_step) as rig, Keyboard() as keyboard:
        looker = _Looker(rig, request, on_step)
        until_s = math.inf if seconds is None else clock.now_s() + seconds
        earlier, found, ended_by = looker.first, [], ""
        while not ended_by:
            taken, earlier = looker.look(again=earlier)
            found.append(taken.figures.sharpness)
            known = [value for value in found if value is not None]
            on_look(taken, max(known, default=None))
            if "q" in keyboard.pressed():
                ended_by = "key q"
            elif signals.received is not None:
                ended_by = signals.name
            elif clock.now_s() >= until_s:
                ended_by = "time over"
    return WatchedLens(
        looks=len(found), first=found[0], best=max(known, default=None), last=found[-1], ended_by=ended_by
    )


def _opened(request: LookRequest, on_step: OnStep) -> Rig:
    """The profile's rig, closed."""
    on_step("open the rig", 0, 1)
    profile = load_runnable_profile(request.profile)
    if profile.camera.driver == "replay":
        raise UsageError(f"{profile.path}: a recording cannot be asked for a photograph; give a rig's profile")
    _check_exposure(request.exposure_s, profile)
    rig = Rig(profile, *make_devices(profile))
    on_step("open the rig", 1, 1)
    return rig


def _check_exposure(exposure_s: float | None, profile: Profile) -> None:
    possible = profile.camera.exposure_range_s
    if exposure_s is not None and not possible.holds(exposure_s):
        raise UsageError(
            f"--exposure {exposure_s:g} s is outside the camera's {possible} s (camera.exposure_range_s); "
            "give one within it"
        )


class _Looker:
    """Photographs of one picture at one exposure, the first of which is taken when it is made."""

    def __init__(self, rig: Rig, request: LookRequest, on_step: OnStep):
        self._rig = rig
        self._name = request.show
        self._picture = picture_named(request.show, rig.profile, fit=request.fit)
        self._exposure_s = request.exposure_s or rig.profile.camera.exposure_s
        self.first = self._frame() if request.exposure_s else self._well_exposed(on_step)

    def look(self, *, again: RawFrame) -> tuple[Look, RawFrame]:
        """Take another photograph; its figures take the one before for a second of the same."""
        frame, full_scale_dn = self._frame(), self._rig.camera.full_scale_dn
        taken = Look(
            picture=self._name,
            profile=self._picture.profile,
            exposure_s=frame.exposure_s,
            width_px=frame.pixels.shape[1],
            height_px=frame.pixels.shape[0],
            figures=figures_of(frame, again, full_scale_dn),
        )
        return taken, frame

    def _frame(self) -> RawFrame:
        return self._rig.shoot(self._picture.codes, name=self._file_safe, exposure_s=self._exposure_s)

    @property
    def _file_safe(self) -> str:
        return "".join(c if c.isalnum() or c in "-_." else "-" for c in Path(self._name).name)

    def _well_exposed(self, on_step: OnStep) -> RawFrame:
        """Search for an exposure as a session does, but with any picture."""
        range_s, earlier = self._rig.profile.camera.exposure_range_s, None
        for attempt in range(_MOST_TRIES):
            on_step("find an exposure", attempt, _MOST_TRIES)
            frame = self._frame()
            level = brightest_share(frame.pixels, self._rig.camera.full_scale_dn)
            chosen_s = next_exposure(self._exposure_s, level, _AIM, range_s, earlier=earlier)
            if chosen_s is None:
                break
            earlier, self._exposure_s = (self._exposure_s, level), chosen_s
        else:
            frame = self._frame()
        on_step("find an exposure", _MOST_TRIES, _MOST_TRIES)
        return frame
