"""Devices that go away, refuse, fall silent and hang as they are told."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rig.devices.clock import VirtualClock
from rig.devices.protocols import Codes, RawFrame, Shown
from rig.errors import (
    CaptureTimeout,
    DeviceError,
    DeviceLost,
)

CAMERA_SHAPE = (4, 5, 1)
PROJECTOR_SHAPE = (3, 6)
LIMIT_S = 20.0
WHITE = np.full(PROJECTOR_SHAPE, 255, np.uint8)


@dataclass
class FakeDevice:
    """Away between two times; refuses to be opened with the errors that it is given."""

    clock: VirtualClock
    away_s: tuple[float, float] = (np.inf, np.inf)
    refusals: list[DeviceError] = field(default_factory=list)
    calls: list[str] = field(default_factory=list)
    is_open: bool = False
    close_fails: bool = False

    def open(self) -> None:
        if self.is_open:
            return
        self.calls.append("open")
        if self.is_away:
            raise DeviceLost("nothing is plugged in")
        if self.refusals:
            raise self.refusals.pop(0)
        self.is_open = True

    def close(self) -> None:
        self.calls.append("close")
        self.is_open = False
        if self.close_fails:
            raise DeviceLost("no such device")

    @property
    def is_away(self) -> bool:
        return self.away_s[0] <= self.clock.now_s() < self.away_s[1]

    def check(self) -> None:
        if self.is_away or not self.is_open:
            raise DeviceLost("it was unplugged")


@dataclass
class FakeProjector(FakeDevice):
    """Notes what it is asked to show."""

    shape: tuple[int, int] = PROJECTOR_SHAPE

    def show(self, codes: Codes, *, name: str) -> Shown:
        self.check()
        self.calls.append(name)
        return Shown(self.clock.now_s(), name)


@dataclass
class FakeCamera(FakeDevice):
    """Gives noisy frames, but none while it is silent: until it was opened ``cured_after`` times."""

    shape: tuple[int, int, int] = CAMERA_SHAPE
    full_scale_dn: int = 4095
    exposure_range_s: tuple[float, float] = (1e-3, 1.0)
    exposure_s: float = 1e-3
    rounding: float = 1.0
    sequence: int = 0
    cured_after: int = 0
    frozen: bool = False
    failure: DeviceError | None = None

    def open(self) -> None:
        if not self.is_open:
            self.sequence, self.exposure_s = 0, 1e-3
        super().open()

    def set_exposure(self, exposure_s: float) -> float:
        self.check()
        self.exposure_s = round(exposure_s, 3) * self.rounding
        return self.exposure_s

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        self.check()
        if self.calls.count("open") < self.cured_after and not self.frozen:
            if self.failure is not None:
                raise self.failure
            self.clock.wait_until_s(self.clock.now_s() + timeout_s)
            raise CaptureTimeout(f"no frame within {timeout_s:g} s")
        self.sequence += 1
        started_s = max(after_s, self.clock.now_s())
        self.clock.wait_until_s(started_s + self.exposure_s)
        self.check()
        is_copy = self.frozen and self.calls.count("open") < self.cured_after
        seed = 0 if is_copy else round(started_s * 1e6)
        pixels = np.random.default_rng(seed).integers(100, 200, self.shape, dtype=np.uint16)
        return RawFrame(pixels=pixels, exposure_s=self.exposure_s, started_s=started_s, sequence=self.sequence)


@dataclass
class ResettableCamera(FakeCamera):
    """Can be switched off and on."""

    reset_fails: bool = False

    def reset(self) -> None:
        if self.reset_fails:
            raise DeviceError("it is no USB device")
        assert not self.is_open, "it has to be closed before it is reset"
        self.calls.append("reset")
        self.away_s = (self.clock.now_s(), self.clock.now_s() + 1.5)


@dataclass
class HungCamera(ResettableCamera):
    """Hangs from the second frame on; then opening it fails too, until it was reset."""

    def open(self) -> None:
        super().open()
        if self.calls.count("open") > 1 and "reset" not in self.calls:
            self.close()
            raise CaptureTimeout("it streams, but no frame came")

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        self.cured_after = 0 if self.sequence == 0 or "reset" in self.calls else 99
        return super().capture(after_s=after_s, timeout_s=timeout_s)
