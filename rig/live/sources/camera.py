"""A camera as a source of pictures: not the one that watches the rig, but one that films something to show."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rig.devices.protocols import Camera, Clock, ExposureRange, RawFrame
from rig.devices.v4l2.camera import V4l2Camera
from rig.devices.v4l2.controls import exposure_range_of
from rig.devices.v4l2.describe import ControlAbility, FormatAbility, describe
from rig.devices.v4l2.find import find_camera
from rig.devices.v4l2.formats import PIXEL_FORMATS
from rig.errors import CaptureTimeout, DeviceError
from rig.live.sources.source import CameraMissing, Picture, Pixels

_FORMATS = ("MJPG", "YUYV", "UYVY", "NV12", "RGB3", "BGR3", "GREY")
"""The ones that are quick over USB first."""
_COLOUR_CHANNELS = 3


class CameraSource:
    """Pictures of a V4L2 camera, as they come. Its exposure stays as it is: set it before, e.g. with v4l2-ctl.

    Parameters
    ----------
    device_id
        As ``rig devices`` prints it.
    shape
        (height, width) of the projector; the camera's nearest size above it is taken, else its largest.
    clock
        The machine's.
    """

    def __init__(self, device_id: str, shape: tuple[int, int], clock: Clock):
        self._device_id = device_id
        self._shape = shape
        self._clock = clock
        self._camera: Camera | None = None
        self._pixels = np.empty((0, 0, 3), np.uint8)

    @property
    def name(self) -> str:
        """The words for this camera."""
        return f"camera {self._device_id}"

    @property
    def frame_rate_hz(self) -> None:
        """The camera's own clock decides."""
        return

    def open(self) -> None:
        """Find it and start it. Raises CameraMissing."""
        self.close()
        try:
            camera = best_camera(self._device_id, self._shape, self._clock)
            camera.open()
        except DeviceError as error:
            raise CameraMissing(str(error)) from error
        self._camera = camera

    def read(self, timeout_s: float) -> Picture | None:
        """Take the next frame that it gives. Raises CameraMissing."""
        if self._camera is None:
            raise CameraMissing(f"{self.name} is closed")
        try:
            frame = self._camera.capture(after_s=-math.inf, timeout_s=timeout_s)
        except CaptureTimeout:
            return None
        except DeviceError as error:
            raise CameraMissing(str(error)) from error
        if self._pixels.shape[:2] != frame.pixels.shape[:2]:
            self._pixels = np.empty((*frame.pixels.shape[:2], _COLOUR_CHANNELS), np.uint8)
        codes_of(frame, self._camera.full_scale_dn, self._pixels)
        return Picture(self._pixels)

    def close(self) -> None:
        """Let it go."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None


def codes_of(frame: RawFrame, full_scale_dn: int, out: Pixels) -> None:
    """Write a frame as 8-bit codes to ``out``, (H, W, 3); a grey frame to all three."""
    shift = max(full_scale_dn.bit_length() - 8, 0)
    np.copyto(out, frame.pixels >> shift, casting="unsafe")


def best_camera(device_id: str, shape: tuple[int, int], clock: Clock) -> Camera:
    """The camera with the format, size and rate that suit a projector. Raises DeviceError."""
    found = find_camera(device_id)
    abilities = describe(found.node)
    known = [ability for ability in abilities.formats if ability.pixel_format.strip() in _FORMATS]
    if not known:
        offered = ", ".join(sorted({ability.pixel_format for ability in abilities.formats})) or "none"
        raise DeviceError(
            f"camera {device_id} offers {offered}, live pictures need one of {', '.join(_FORMATS)}; take another camera"
        )

    def rank(ability: FormatAbility) -> tuple[bool, int, float, int]:
        covers = ability.height_px >= shape[0] and ability.width_px >= shape[1]
        area = ability.height_px * ability.width_px
        rate_hz = max(ability.frame_rates_hz, default=0.0)
        return covers, -area if covers else area, rate_hz, -_FORMATS.index(ability.pixel_format.strip())

    best = max(known, key=rank)
    channels = max(PIXEL_FORMATS[best.pixel_format.strip()].channels)
    rate_hz = max(best.frame_rates_hz, default=30.0)
    return V4l2Camera(
        found.device_id,
        shape=(best.height_px, best.width_px, channels),
        pixel_format=best.pixel_format,
        bit_depth=8,
        frame_rate_hz=rate_hz,
        exposure_range_s=_exposure_range_s(abilities.controls, 1 / rate_hz),
        controls={},
        clock=clock,
    )


def _exposure_range_s(controls: Sequence[ControlAbility], period_s: float) -> ExposureRange:
    """All that its control allows; without one a camera exposes for its whole period."""
    return exposure_range_of(controls) or ExposureRange(period_s, period_s)
