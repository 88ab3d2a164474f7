"""A projector and a camera at the two ends of a wire: what one shows, the other sees."""

import cv2
import numpy as np

from rig.devices.driver_settings import CameraSettings, ProjectorSettings
from rig.devices.protocols import Clock, Codes, ExposureRange, RawFrame, Shown
from rig.errors import CaptureTimeout, DeviceLost, ProfileError

WIRES: dict[str, Codes] = {}


class WireProjector:
    def __init__(self, wire: str, shape: tuple[int, int], clock: Clock):
        self.shape = shape
        self._wire, self._clock = wire, clock

    def open(self) -> None:
        WIRES[self._wire] = np.zeros(self.shape, np.uint8)

    def close(self) -> None:
        WIRES.pop(self._wire, None)

    def show(self, codes: Codes, *, name: str) -> Shown:
        if self._wire not in WIRES:
            raise DeviceLost(f"the projector on wire {self._wire} is closed: open it before showing {name}")
        WIRES[self._wire] = codes.copy()
        return Shown(self._clock.now_s(), name)


class WireCamera:
    def __init__(self, wire: str, settings: CameraSettings, clock: Clock):
        self.shape = settings.shape
        self.full_scale_dn = settings.full_scale_dn
        self.exposure_range_s: ExposureRange = settings.exposure_range_s
        self._exposure_s = self.exposure_range_s.shortest_s
        self._wire, self._clock = wire, clock
        self._sequence = 0

    def open(self) -> None:
        self._sequence = 0

    def close(self) -> None:
        pass

    def set_exposure(self, exposure_s: float) -> float:
        self._exposure_s = exposure_s
        return exposure_s

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        if self._wire not in WIRES:
            raise CaptureTimeout(f"nothing is shown on wire {self._wire}")
        started_s = max(after_s, self._clock.now_s())
        self._clock.wait_until_s(started_s + self._exposure_s)
        self._sequence += 1
        height, width, channels = self.shape
        seen = cv2.resize(WIRES[self._wire], (width, height), interpolation=cv2.INTER_NEAREST)
        if seen.ndim == 2:
            seen = np.repeat(seen[:, :, None], channels, axis=2)
        noise = np.random.default_rng(self._sequence).integers(0, 2, self.shape)
        pixels = (seen[:, :, :channels] + noise).astype(np.uint16)
        return RawFrame(pixels=pixels, exposure_s=self._exposure_s, started_s=started_s, sequence=self._sequence)


def camera(settings: CameraSettings, clock: Clock) -> WireCamera:
    return WireCamera(_wire(settings), settings, clock)


def projector(settings: ProjectorSettings, clock: Clock) -> WireProjector:
    return WireProjector(_wire(settings), settings.shape, clock)


def _wire(settings: CameraSettings | ProjectorSettings) -> str:
    wire = settings.options.get("wire")
    if not isinstance(wire, str):
        raise ProfileError(f"{settings.name}: options.wire: missing; name the wire, e.g. wire = 'a'")
    return wire
