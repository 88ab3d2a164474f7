"""A camera that photographs a display output by reading back what is shown on it."""

from typing import Protocol

import numpy as np

from rig.devices.clock import SystemClock
from rig.devices.protocols import RawFrame
from rig.errors import CaptureTimeout, DeviceLost, SettingRefused

BLACK_DN, DN_PER_CODE, NOISE_DN = 200, 10, 2


class Screen(Protocol):
    """What is shown on an output; `rig.devices.kms.readback.Readback` is one."""

    def open(self) -> None: ...

    def close(self) -> None: ...

    def frame_id(self) -> int:
        """0 when nothing is shown."""
        ...

    def picture(self) -> np.ndarray:
        """(H, W, 3) uint8."""
        ...


class ReadbackCamera:
    """Every second pixel of an output, from now on, in 12 bits, with a little noise."""

    full_scale_dn = 4095
    exposure_range_s = (1e-4, 2.0)

    def __init__(self, screen: Screen, *, projector_shape: tuple[int, int], clock: SystemClock):
        height, width = projector_shape
        self.shape = (height // 2, width // 2, 1)
        self._clock = clock
        self._readback = screen
        self._random = np.random.default_rng(7)
        self._exposure_s = 0.02
        self._sequence = 0
        self._open = False

    def open(self) -> None:
        self._readback.open()
        self._open = True

    def close(self) -> None:
        self._readback.close()
        self._open = False

    def set_exposure(self, exposure_s: float) -> float:
        self._check_open()
        shortest, longest = self.exposure_range_s
        if not shortest <= exposure_s <= longest:
            raise SettingRefused(f"{exposure_s} s is outside {shortest} … {longest} s")
        self._exposure_s = exposure_s
        return exposure_s

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        self._check_open()
        until_s = self._clock.now_s() + timeout_s
        self._clock.wait_until_s(min(after_s, until_s))
        if after_s > until_s:
            raise CaptureTimeout(f"no frame within {timeout_s} s")
        started_s = self._clock.now_s()
        pixels = self._exposed()
        self._clock.wait_until_s(started_s + self._exposure_s)
        self._sequence += 1
        return RawFrame(pixels=pixels, exposure_s=self._exposure_s, started_s=started_s, sequence=self._sequence)

    def _exposed(self) -> np.ndarray:
        light = self._readback.picture()[::2, ::2, :1] if self._readback.frame_id() else np.zeros(self.shape)
        noise = self._random.integers(-NOISE_DN, NOISE_DN + 1, self.shape)
        return (BLACK_DN + DN_PER_CODE * light.astype(np.int64) + noise).astype(np.uint16)

    def _check_open(self) -> None:
        if not self._open:
            raise DeviceLost("the camera is closed")
