"""A rig: cameras and projectors on one clock, and the policy that stands above every back end.

Whatever frame is stale, repeated or malformed is rejected, noted and asked for again; a camera that gives none is
opened again, then reset (both in :mod:`rig.capture.tended_camera`); a device that went away is waited for
(:mod:`rig.capture.recovery`); while one projector shows a picture the others are black
(:mod:`rig.capture.projection`).
Every wait has a limit, and nothing waits for a fixed time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from types import MappingProxyType, TracebackType
from typing import Protocol, TypeVar

from rig.capture.events import MENDED, Event, EventLog
from rig.capture.projection import Projection
from rig.capture.recovery import Gone, Openable, Recovery, close_quietly
from rig.capture.tended_camera import TendedCamera
from rig.devices.drivers import make_devices
from rig.devices.protocols import Camera, Clock, Codes, Gain, Projector, RawFrame
from rig.devices.refusals import check_codes
from rig.errors import CaptureTimeout, DeviceError, UsageError
from rig.profile.schema import Profile

__all__ = ["Event", "NamedCodes", "Rig", "open_rig"]

Result = TypeVar("Result")
Device = TypeVar("Device")


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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shot:
    """What is wanted, and what is left to try."""

    codes: Codes
    name: str
    exposure_s: float | None
    camera: TendedCamera
    projector: str
    remedies: Iterator[Callable[[], None]]
    """For a camera that gives no good frame, the mildest first."""
    started_s: float
    first_event: int


class Rig:
    """Devices on one clock; use it in a ``with`` statement, which leaves every projector black.

    One thread at a time shoots; others wait. When it gives up on a device, it closes all.

    Parameters
    ----------
    profile
        What the devices are.
    camera, projector
        By the names that the profile gives them; or the only one itself.
    clock
        That all devices go by.
    """

    def __init__(
        self,
        profile: Profile,
        camera: Camera | Mapping[str, Camera],
        projector: Projector | Mapping[str, Projector],
        clock: Clock,
    ):
        self.profile = profile
        self.cameras: Mapping[str, Camera] = _by_name(camera, profile.cameras[0].name)
        """By name."""
        self.projectors: Mapping[str, Projector] = _by_name(projector, profile.projectors[0].name)
        """By name."""
        self.clock = clock
        self._log = EventLog(clock)
        self._lock = threading.RLock()
        self._is_open = False
        self._is_live = profile.cameras[0].driver != "replay"
        self._projection = Projection(self.projectors)
        self._tended = {
            one.name: TendedCamera(
                self.cameras[one.name], one, label=self._label(self.cameras[one.name]), clock=clock, log=self._log
            )
            for one in profile.cameras
        }

    @property
    def camera(self) -> Camera:
        """The only camera. Raises UsageError when there are several."""
        return self.cameras[_chosen("camera", self.cameras, None)]

    @property
    def projector(self) -> Projector:
        """The only projector. Raises UsageError when there are several."""
        return self.projectors[_chosen("projector", self.projectors, None)]

    @property
    def events(self) -> list[Event]:
        """What went wrong so far and was put right."""
        return self._log.events

    def _devices(self) -> tuple[Openable, ...]:
        return (*self.cameras.values(), *self.projectors.values())

    def open(self) -> None:
        """Open all devices, or none. Raises DeviceError."""
        with self._lock, ExitStack() as undo:
            for device in self._devices():
                undo.callback(device.close)
                device.open()
            for camera in self._tended.values():
                camera.forget_count()
            self._projection.forget()
            self._is_open = True
            undo.pop_all()

    def close(self) -> None:
        """Close all devices, each even if another fails; any number of times."""
        with self._lock, ExitStack() as each:
            for device in self._devices():
                each.callback(device.close)
            self._is_open = False
            for camera in self._tended.values():
                camera.forget()

    def __enter__(self) -> Rig:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def set_exposure(self, exposure_s: float, *, camera: str | None = None) -> float:
        """Ask for an exposure, and return the one the camera chose.

        Parameters
        ----------
        exposure_s
            Within the camera's range.
        camera
            Name; default: the only one.

        Returns
        -------
        float
            What the camera does. [s]

        Raises
        ------
        SettingRefused
            It is outside the camera's range.
        DeviceLost
            The camera went away and did not return.
        UsageError
            It is not clear which camera.
        """
        tended = self._tended[_chosen("camera", self.cameras, camera)]
        with self._lock:
            return self._recovering(lambda: tended.set_exposure(exposure_s))

    def set_gain(self, value: float, *, camera: str | None = None) -> Gain:
        """Ask for a gain until the rig is closed, and return what the camera did.

        Raises SettingRefused outside its range or without one, and as :meth:`set_exposure` does.
        """
        tended = self._tended[_chosen("camera", self.cameras, camera)]
        with self._lock:
            return self._recovering(lambda: tended.set_gain(value))

    def shoot(
        self,
        codes: Codes,
        *,
        name: str,
        exposure_s: float | None = None,
        camera: str | None = None,
        projector: str | None = None,
    ) -> RawFrame:
        """Show codes and return the first good frame that was exposed to them.

        All other projectors are black. A device that goes away is waited for, set as it was, and the picture shown
        again.

        Parameters
        ----------
        codes
            uint8 of exactly the projector's shape, (H, W) or (H, W, 3).
        name
            The pattern's name; a replay finds its frames by it.
        exposure_s
            Default: as last set.
        camera, projector
            Names; default: the only one.

        Returns
        -------
        RawFrame
            (H, W, C) digital numbers, and times on the rig's clock.

        Raises
        ------
        UsageError
            There are several cameras or projectors and none is named, or none has that name.
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
        tended = self._tended[_chosen("camera", self.cameras, camera)]
        shown_by = _chosen("projector", self.projectors, projector)
        with self._lock:
            check_codes(codes, self.projectors[shown_by].shape)
            shot = _Shot(
                codes=codes,
                name=name,
                exposure_s=exposure_s,
                camera=tended,
                projector=shown_by,
                remedies=iter(tended.remedies()),
                started_s=self.clock.now_s(),
                first_event=len(self.events),
            )
            return self._recovering(lambda: self._photograph(shot))

    def shoot_all(self, patterns: Iterable[NamedCodes]) -> Iterator[RawFrame]:
        """Shoot patterns one after the other, each when the iterator asks for it.

        Parameters
        ----------
        patterns
            Names and codes.

        Yields
        ------
        RawFrame
            Of each.
        """
        for pattern in patterns:
            yield self.shoot(pattern.codes, name=pattern.name)

    def _photograph(self, shot: _Shot) -> RawFrame:
        """Show and capture, with a stronger remedy after each round that gave no good frame."""
        shot.camera.expose(shot.exposure_s)
        while True:
            latencies_s = {one.name: one.latency_s for one in self.profile.projectors}
            settled_s = self._projection.show(shot.projector, shot.codes, shot.name, latencies_s)
            timing, check = self.profile.timing, self._projection.check
            frame = shot.camera.first_good_frame(shot.name, settled_s, timing, check)
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
                self._log.note("timeout", f"{shot.name}: {error}")
            else:
                return
        raise self._no_good_frame(shot)

    def _no_good_frame(self, shot: _Shot) -> CaptureTimeout:
        timing = self.profile.timing
        events = self.events[shot.first_event :]
        tried = "".join(f"; the camera was {event.kind}" for event in events if event.kind in ("reopened", "reset"))
        failed = [event for event in events if event.kind not in MENDED]
        kinds = ", ".join(sorted({event.kind for event in failed}))
        return CaptureTimeout(
            f"no good frame of {shot.name!r} in {len(failed)} attempts of {timing.timeout_s:g} s ({kinds}), "
            f"{self.clock.now_s() - shot.started_s:.1f} s in all{tried}; last: {failed[-1].detail}; check cable, "
            "timing.timeout_s and projector.latency_s"
        )

    def _recovering(self, action: Callable[[], Result]) -> Result:
        """Do something, again and again as long as lost devices come back in time."""
        recovery = Recovery(self.clock, self.profile.timing.replug_timeout_s, self._log.note)
        while True:
            try:
                return action()
            except Gone as gone:
                device, loss = gone.device, gone.loss
            if not (self._is_live and self._is_open):
                raise loss
            with self._closing_on_failure():
                recovery.bring_back(device, self._label(device), loss, self._restoring(device))

    def _restoring(self, device: Openable) -> Callable[[], None]:
        """What makes a device that was opened again what it was before."""
        return next((one.restore for one in self._tended.values() if one.device is device), self._projection.forget)

    @contextmanager
    def _closing_on_failure(self) -> Iterator[None]:
        """When the rig gives up: the projectors black, nothing held."""
        try:
            yield
        except DeviceError:
            close_quietly(self)
            raise

    def _label(self, device: Openable) -> str:
        """The device in words, as the profile names it."""
        for camera in self.profile.cameras:
            if self.cameras[camera.name] is device:
                return _label("camera", camera.device_id, camera.name, len(self.cameras))
        for projector in self.profile.projectors:
            if self.projectors[projector.name] is device:
                return _label("projector", projector.output, projector.name, len(self.projectors))
        raise KeyError("no device of this rig")


def _label(kind: str, address: str | None, name: str, count: int) -> str:
    """The kind alone says it when there is one device without an address."""
    if count == 1:
        return f"{kind} {address}" if address else f"the {kind}"
    return f"{kind} {name} ({address})" if address else f"{kind} {name}"


def _by_name(device: Device | Mapping[str, Device], name: str) -> Mapping[str, Device]:
    return MappingProxyType(dict(device) if isinstance(device, Mapping) else {name: device})


def _chosen(kind: str, devices: Mapping[str, object], name: str | None) -> str:
    """The name of the device that is meant. Raises UsageError when that is not clear."""
    if name in devices:
        return str(name)
    names = ", ".join(devices)
    if name is not None:
        raise UsageError(f"no {kind} of this rig is named {name!r}; there are: {names}")
    if len(devices) > 1:
        raise UsageError(f"this rig has {len(devices)} {kind}s ({names}): say which, {kind}=NAME")
    return next(iter(devices))


def open_rig(profile: Profile, *, resume_at_s: float = 0.0) -> Rig:
    """Open the devices that a profile describes.

    Parameters
    ----------
    profile
        What is to be opened, and how.
    resume_at_s
        Where virtual clocks start: ``session.last_clock_s`` when a session goes on.

    Returns
    -------
    The rig, open, each camera's exposure at its ``exposure_s``; use it in a ``with`` statement, or close it.

    Raises
    ------
    ProfileError
        The profile cannot be used.
    DeviceError
        A device does not open.
    """
    rig = Rig(profile, *make_devices(profile, resume_at_s))
    with ExitStack() as undo:
        undo.callback(rig.close)
        rig.open()
        for camera in profile.cameras:
            rig.set_exposure(camera.exposure_s, camera=camera.name)
        undo.pop_all()
    return rig
