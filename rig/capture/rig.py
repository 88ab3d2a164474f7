"""One camera and one projector: the policy that stands above every back end.

Whatever frame is stale, repeated or malformed is rejected, noted and asked for again
(:mod:`rig.capture.frame_checks`); a camera that gives none is opened again, then reset; a device that went away is
waited for (:mod:`rig.capture.recovery`).
Every wait has a limit, and nothing waits for a fixed time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol, TypeVar

import numpy as np

from rig.capture.devices import make_devices
from rig.capture.frame_checks import FrameValidator, Wanted
from rig.capture.recovery import Openable, Recovery, close_quietly
from rig.devices.protocols import Camera, Clock, Codes, Projector, RawFrame, Resettable, check_on_screen
from rig.errors import CaptureTimeout, DeviceBusy, DeviceError, DeviceForbidden, DeviceLost, SettingRefused
from rig.profile.schema import Profile, load_profile

Result = TypeVar("Result")

_SILENCE = 2
"""Time limits that pass one after the other without any frame before the camera is opened again."""
_MENDED = ("reopened", "reset", "unplugged", "replugged")
"""Events that are no frame's fault."""
_SAME_EXPOSURE = 1e-6
"""Relative; a camera that is opened again has to expose as before."""


@dataclass(frozen=True, slots=True)
class Event:
    """Something that went wrong and was put right, or what the rig gave up on."""

    time_s: float
    """On the rig's clock."""
    kind: str
    """stale, ahead, repeated, lost, malformed, exposure or timeout: it asked again;
    failed: streaming did; reopened, reset: it did so to a camera that gave no good frame;
    unplugged, replugged: it waited for a device."""
    detail: str


class NamedCodes(Protocol):
    """A pattern: codes and their name."""

    @property
    def name(self) -> str:
        """File-safe name."""
        ...

    @property
    def codes(self) -> Codes:
        """(H, W) or (H, W, 3) uint8."""
        ...


@dataclass(frozen=True, slots=True)
class _Shot:
    """What is wanted, and what is left to try."""

    codes: Codes
    name: str
    exposure_s: float | None
    remedies: Iterator[Callable[[], None]]
    """For a camera that gives no good frame, the mildest first."""
    started_s: float
    first_event: int


class _Gone(Exception):
    """A device went away."""

    def __init__(self, device: Openable, loss: DeviceLost):
        super().__init__(str(loss))
        self.device = device
        self.loss = loss


@contextmanager
def _talking_to(device: Openable) -> Iterator[None]:
    """Remember which device it was that went away."""
    try:
        yield
    except DeviceLost as loss:
        raise _Gone(device, loss) from loss


class Rig:
    """A pair of devices on one clock; use it in a ``with`` statement, which leaves the projector black.

    One thread at a time shoots; others wait. When it gives up on a device, it closes both.
    """

    def __init__(self, profile: Profile, camera: Camera, projector: Projector, clock: Clock):
        self.profile = profile
        self.camera = camera
        self.projector = projector
        self.clock = clock
        self.events: list[Event] = []
        self._lock = threading.RLock()
        self._is_open = False
        self._is_live = profile.camera.driver != "replay"
        self._asked_s: float | None = None
        self._exposure_s: float | None = None
        self._association = FrameValidator(
            camera.shape, camera.full_scale_dn, 1 / profile.camera.frame_rate_hz, live=self._is_live
        )

    def open(self) -> None:
        """Open both devices, or neither. Raises DeviceError."""
        with self._lock, ExitStack() as undo:
            undo.callback(self.camera.close)
            self.camera.open()
            undo.callback(self.projector.close)
            self.projector.open()
            self._association.forget_count()
            self._is_open = True
            undo.pop_all()

    def close(self) -> None:
        """Close both devices, each even if the other fails; any number of times."""
        with self._lock, ExitStack() as both:
            both.callback(self.camera.close)
            both.callback(self.projector.close)
            self._is_open = False
            self._asked_s = self._exposure_s = None

    def __enter__(self) -> Rig:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def set_exposure(self, exposure_s: float) -> float:
        """Ask for an exposure, and return the one the camera chose.

        Raises SettingRefused outside the camera's range, DeviceLost when the camera went away and did not return.
        """
        with self._lock:
            return self._recovering(lambda: self._set_exposure(exposure_s))

    def _set_exposure(self, exposure_s: float) -> float:
        shortest, longest = self.camera.exposure_range_s
        if not shortest <= exposure_s <= longest:
            raise SettingRefused(f"exposure {exposure_s:.6g} s is outside the camera's {shortest:g} … {longest:g} s")
        with _talking_to(self.camera):
            chosen_s = self.camera.set_exposure(exposure_s)
        self._asked_s, self._exposure_s = exposure_s, chosen_s
        return chosen_s

    def shoot(self, codes: Codes, *, name: str, exposure_s: float | None = None) -> RawFrame:
        """Show codes and return the first good frame that was exposed to them.

        A device that goes away is waited for, set as it was, and the picture shown again.

        Parameters
        ----------
        codes
            uint8 of exactly the projector's shape, (H, W) or (H, W, 3).
        name
            The pattern's name; a replay finds its frames by it.
        exposure_s
            Default: as last set.

        Raises
        ------
        SettingRefused
            Codes or exposure are not possible, or a device came back as another.
        CaptureTimeout
            No good frame in ``1 + timing.retries`` attempts, nor after the camera was opened again, nor after it was
            reset.
        DeviceLost
            The rig is closed, or a device went away for more than ``timing.replug_timeout_s``.
        DeviceBusy, DeviceForbidden
            A device came back, but another program holds it, or the user may not open it.
        """
        with self._lock:
            self._check_codes(codes)
            shot = _Shot(codes, name, exposure_s, iter(self._remedies()), self.clock.now_s(), len(self.events))
            return self._recovering(lambda: self._photograph(shot))

    def shoot_all(self, patterns: Iterable[NamedCodes]) -> Iterator[RawFrame]:
        """Shoot patterns one after the other, each when the iterator asks for it."""
        for pattern in patterns:
            yield self.shoot(pattern.codes, name=pattern.name)

    def _check_codes(self, codes: Codes) -> None:
        shape = self.projector.shape
        if codes.dtype != np.uint8 or codes.shape not in (shape, (*shape, 3)):
            raise SettingRefused(
                f"the projector shows uint8 codes of shape {shape}, not {codes.dtype} of {codes.shape}; "
                "make the picture in exactly its size"
            )

    def _photograph(self, shot: _Shot) -> RawFrame:
        """Show and capture, with a stronger remedy after each round that gave no good frame."""
        if shot.exposure_s is not None and shot.exposure_s not in (self._asked_s, self._exposure_s):
            self._set_exposure(shot.exposure_s)
        while True:
            with _talking_to(self.projector):
                shown = self.projector.show(shot.codes, name=shot.name)
            frame = self._first_good_frame(shot.name, shown.on_screen_s + self.profile.projector.latency_s)
            if frame is not None:
                return frame
            with self._closing_on_failure():
                self._mend(shot)

    def _mend(self, shot: _Shot) -> None:
        """Apply the next remedy, and the one after it to a camera that stays silent even so."""
        for remedy in shot.remedies:
            try:
                remedy()
            except CaptureTimeout as error:
                self._note("timeout", f"{shot.name}: {error}")
            else:
                return
        raise self._no_good_frame(shot)

    def _first_good_frame(self, name: str, settled_s: float) -> RawFrame | None:
        """None when the camera needs more than to be asked again."""
        timing = self.profile.timing
        wanted = Wanted(settled_s, self._exposure_s)
        silent = 0
        for _ in range(1 + timing.retries):
            try:
                with _talking_to(self.camera):
                    frame = self.camera.capture(after_s=settled_s, timeout_s=timing.timeout_s)
            except CaptureTimeout as error:
                self._note("timeout", f"{name}: {error}")
                silent += 1
                if silent == _SILENCE:
                    return None
                continue
            except (SettingRefused, DeviceBusy, DeviceForbidden):
                raise
            except DeviceError as error:
                self._note("failed", f"{name}: {error}")
                return None
            silent = 0
            rejection = self._association.rejection(frame, wanted, self.clock.now_s())
            if rejection is None:
                with _talking_to(self.projector):
                    check_on_screen(self.projector)  # unplugged during the exposure: the frame is spoilt
                return frame
            self._note(rejection.kind, f"{name}: {rejection.detail}")
        return None

    def _no_good_frame(self, shot: _Shot) -> CaptureTimeout:
        timing = self.profile.timing
        events = self.events[shot.first_event :]
        tried = "".join(f"; the camera was {event.kind}" for event in events if event.kind in ("reopened", "reset"))
        failed = [event for event in events if event.kind not in _MENDED]
        kinds = ", ".join(sorted({event.kind for event in failed}))
        return CaptureTimeout(
            f"no good frame of {shot.name!r} in {len(failed)} attempts of {timing.timeout_s:g} s ({kinds}), "
            f"{self.clock.now_s() - shot.started_s:.1f} s in all{tried}; last: {failed[-1].detail}; check cable, "
            "timing.timeout_s and projector.latency_s"
        )

    def _remedies(self) -> list[Callable[[], None]]:
        """What to do to a camera that gives no good frame: each after asking again did not help."""
        if not self._is_live:
            return []
        return [self._reopen, self._reset] if isinstance(self.camera, Resettable) else [self._reopen]

    def _reopen(self) -> None:
        self._note("reopened", f"{self._name_of(self.camera)}: gave no good frame")
        close_quietly(self.camera)
        self._open_camera()

    def _reset(self) -> None:
        name = self._name_of(self.camera)
        close_quietly(self.camera)
        try:
            if isinstance(self.camera, Resettable):
                self.camera.reset()
        except DeviceError as error:
            self._note("failed", f"{name} could not be reset: {error}")
        else:
            self._note("reset", f"{name}: gave no good frame after it was opened again")
        self._open_camera()

    def _open_camera(self) -> None:
        with _talking_to(self.camera):
            self.camera.open()
            self._restore_camera()

    def _restore_camera(self) -> None:
        """After it was opened again: the exposure as it was, and a new count of its frames."""
        self._association.forget_count()
        if self._exposure_s is None:
            return
        chosen_s = self.camera.set_exposure(self._exposure_s)
        if not abs(chosen_s - self._exposure_s) <= _SAME_EXPOSURE * self._exposure_s:
            raise SettingRefused(
                f"{self._name_of(self.camera)} was opened again and now exposes {chosen_s:.6g} s, not "
                f"{self._exposure_s:.6g} s as before: is it another camera?"
            )

    def _recovering(self, action: Callable[[], Result]) -> Result:
        """Do something, again and again as long as lost devices come back in time."""
        recovery = Recovery(self.clock, self.profile.timing.replug_timeout_s, self._note)
        while True:
            try:
                return action()
            except _Gone as gone:
                device, loss = gone.device, gone.loss
            if not (self._is_live and self._is_open):
                raise loss
            restore = self._restore_camera if device is self.camera else lambda: None
            with self._closing_on_failure():
                recovery.bring_back(device, self._name_of(device), loss, restore)

    @contextmanager
    def _closing_on_failure(self) -> Iterator[None]:
        """When the rig gives up: the projector black, nothing held."""
        try:
            yield
        except DeviceError:
            close_quietly(self)
            raise

    def _name_of(self, device: Openable) -> str:
        """The device in words, as the profile names it."""
        kind, name = "projector", self.profile.projector.output
        if device is self.camera:
            kind, name = "camera", self.profile.camera.device_id
        return f"{kind} {name}" if name else f"the {kind}"

    def _note(self, kind: str, detail: str) -> None:
        self.events.append(Event(self.clock.now_s(), kind, detail))


def open_rig(profile: Profile | str | Path, *, resume_at_s: float = 0.0) -> Rig:
    """Open the devices that a profile describes.

    Parameters
    ----------
    profile
        A profile, its file, or the bare name of one in ``hw_profiles``.
    resume_at_s
        Where virtual clocks start: ``session.last_clock_s`` when a session goes on.

    Returns
    -------
    The rig, open, its exposure at ``camera.exposure_s``; use it in a ``with`` statement, or close it.

    Raises
    ------
    ProfileError
        The profile cannot be used.
    DeviceError
        A device does not open.
    """
    if not isinstance(profile, Profile):
        profile = load_profile(profile)
    rig = Rig(profile, *make_devices(profile, resume_at_s))
    with ExitStack() as undo:
        undo.callback(rig.close)
        rig.open()
        rig.set_exposure(profile.camera.exposure_s)
        undo.pop_all()
    return rig
