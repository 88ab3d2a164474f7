"""The emulated rig: a USB camera that looks at what a display shows, through the simulated room of a profile."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field
from types import TracebackType
from typing import Protocol

import numpy as np

from rig.devices.clock import SystemClock
from rig.devices.kms.readback import Readback
from rig.devices.protocols import Codes
from rig.devices.simulated.pair import SimulatedPair
from rig.devices.simulated.rigs import simulated_world_of
from rig.devices.v4l2.find import FoundCamera, find_camera
from rig.emulated.faults import Faults
from rig.emulated.room import RoomSource
from rig.emulated.usbip.attach import Attachment, attach
from rig.emulated.uvc.camera import UvcCamera
from rig.emulated.uvc.descriptors import VideoFormat, video_formats
from rig.emulated.watch import ReadableDisplay, ignore
from rig.errors import DeviceError, DeviceForbidden, DeviceLost, ProfileError
from rig.profile.schema import Profile

MODULES = ("vhci-hcd", "uvcvideo")
"""Stock modules of the kernel that the emulated camera needs."""
_PROMPT_SHARE = 2 / 3
"""Of the latency that the profile allows for: frames that would come later are lost instead."""
_LOOK_S = 0.1
"""Between two looks whether the kernel has taken the camera."""
_OTHER_FORMATS = ("GREY", "YUYV")


class OpenableDisplay(ReadableDisplay, Protocol):
    """A display that is opened and closed."""

    def open(self) -> None:
        """Make it ready."""
        ...

    def close(self) -> None:
        """Let it go; any number of times."""
        ...


@dataclass(frozen=True, slots=True)
class StillPicture:
    """Stands for a display that always shows the same picture."""

    codes: Codes

    def open(self) -> None:
        """Nothing to do."""

    def close(self) -> None:
        """Nothing to do."""

    def shape(self) -> tuple[int, int]:
        """(height, width)."""
        return self.codes.shape[0], self.codes.shape[1]

    def picture(self) -> Codes:
        """The picture."""
        return self.codes


@dataclass(slots=True, kw_only=True)
class EmulatedRig:
    """Plugged in between :meth:`plug` and :meth:`unplug`; in a ``with`` statement, from the beginning.

    Needs root, and a kernel with the modules vhci-hcd and uvcvideo.
    """

    profile: Profile
    """With a table [simulation]; ``camera.device_id`` says vendor, product and serial number of the emulated camera."""
    display: OpenableDisplay
    faults: Faults = field(default_factory=Faults)
    note: Callable[[str], None] = ignore
    """Called with what is worth telling while it runs."""
    _source: RoomSource = field(init=False)
    _attachment: Attachment | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self._source = RoomSource(
            real_time_world(self.profile), self.display, SystemClock(), prompt_s=self._prompt_s, note=self.note
        )

    @property
    def _prompt_s(self) -> float:
        return _PROMPT_SHARE * self.profile.projector.latency_s

    @property
    def alive(self) -> bool:
        """Whether the kernel still has the camera."""
        return self._attachment is not None and self._attachment.alive

    @property
    def late_frames(self) -> int:
        """Frames that were not sent because their light took too long to compute."""
        return self._source.late_frames

    def plug(self) -> None:
        """Plug the camera in; no-op while it is. Raises DeviceForbidden, DeviceError."""
        if not self.alive:
            self.display.open()
            self._attachment = attach(self._camera())

    def unplug(self) -> None:
        """Pull the cable; any number of times."""
        attachment, self._attachment = self._attachment, None
        if attachment is not None:
            attachment.unplug()
        self.display.close()

    def __enter__(self) -> EmulatedRig:
        self.plug()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.unplug()

    def _camera(self) -> UvcCamera:
        vendor_id, product_id, serial = usb_identity(self.profile)
        camera = self.profile.camera
        return UvcCamera(
            source=self._source,
            formats=camera_formats(self.profile),
            name=self.profile.name[:30],
            serial=serial,
            vendor_id=vendor_id,
            product_id=product_id,
            faults=self.faults,
            exposure_range_s=camera.exposure_range_s,
            exposure_s=camera.exposure_s,
            longest_delay_s=self._prompt_s,
        )


def real_time_world(profile: Profile) -> SimulatedPair:
    """The simulated room of a profile. Raises ProfileError when it has none, or one with a latency of its own."""
    world = simulated_world_of(profile)
    if world.settings.projector.latency_s or world.settings.projector.jitter_s:
        raise ProfileError(
            f"{profile.path}: simulation.projector.latency_s and jitter_s: an emulated rig has the latency of its real "
            "display; leave them out"
        )
    return world


def wait_for_camera(profile: Profile, timeout_s: float = 30.0) -> FoundCamera:
    """Wait until the kernel's driver has taken the emulated camera. Raises DeviceError when it does not."""
    clock, device_id = SystemClock(), profile.camera.device_id or ""
    until_s = clock.now_s() + timeout_s
    while True:
        try:
            return find_camera(device_id)
        except DeviceLost as error:
            if clock.now_s() > until_s:
                raise DeviceError(
                    f"the kernel did not take {device_id} as a camera within {timeout_s:g} s; look at dmesg"
                ) from error
        clock.wait_until_s(clock.now_s() + _LOOK_S)


def usb_identity(profile: Profile) -> tuple[int, int, str]:
    """(vendor, product, serial) of ``camera.device_id``. Raises ProfileError unless it is `usb-VVVV:PPPP-SERIAL`."""
    kind, _, rest = (profile.camera.device_id or "").partition("-")
    ids, _, serial = rest.partition("-")
    vendor, _, product = ids.partition(":")
    try:
        if kind == "usb" and serial:
            return int(vendor, 16), int(product, 16), serial
    except ValueError:
        pass
    raise ProfileError(
        f"{profile.path}: camera.device_id: {profile.camera.device_id!r} names no emulated camera; "
        "give e.g. 'usb-1209:0001-EMULATED1'"
    )


def camera_formats(profile: Profile) -> tuple[VideoFormat, ...]:
    """The profile's format first, and plain ones beside it, all in the profile's size."""
    camera = profile.camera
    fourccs = dict.fromkeys([(camera.pixel_format or "GREY").strip(), *_OTHER_FORMATS])
    rates_hz = dict.fromkeys([camera.frame_rate_hz, camera.frame_rate_hz / 2])
    try:
        return video_formats(tuple(fourccs), ((camera.width_px, camera.height_px),), tuple(rates_hz))
    except ValueError as error:
        raise ProfileError(f"{profile.path}: camera.pixel_format: {error}") from error


def open_display(profile: Profile, output: str | None = None) -> Readback:
    """The display that the profile's projector drives, or another one; closed. Raises ProfileError."""
    named = output or profile.projector.output
    if named is None or (output is None and profile.projector.driver != "kms"):
        raise ProfileError(
            f"{profile.path}: projector.output: an emulated rig looks at a KMS output; name one (--display), "
            "or give it a still picture (--picture)"
        )
    return Readback(named)


def still(codes: Codes) -> StillPicture:
    """A display that always shows this picture, (H, W) or (H, W, 3)."""
    return StillPicture(np.asarray(codes, dtype=np.uint8))


def load_modules() -> None:
    """Have the kernel load what the emulated camera needs. Raises DeviceForbidden, DeviceError."""
    try:
        done = subprocess.run(["modprobe", "-a", *MODULES], capture_output=True, text=True, check=False)
    except OSError as error:
        raise DeviceError(f"modprobe: {error.strerror}; install kmod, and run this as root (sudo)") from error
    if done.returncode != 0:
        text = done.stderr.strip()
        if "not permitted" in text:
            raise DeviceForbidden(f"{text}; run this as root (sudo)")
        raise DeviceError(f"{text}; the emulated camera needs the kernel modules {', '.join(MODULES)}")
