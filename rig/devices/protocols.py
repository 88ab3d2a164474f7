"""What a camera, a projector and a clock are to this product: protocols, not base classes.

Back ends speak device units (digital numbers, codes) and know no policy: limits, validation, retries and the
rejection of stale frames sit once, above all of them, in :class:`rig.capture.rig.Rig`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import cv2
import numpy as np
from numpy.typing import NDArray

Codes = NDArray[np.uint8]
"""(H, W) or (H, W, 3) projector codes."""


class ExposureRange(NamedTuple):
    """Shortest and longest exposure."""

    shortest_s: float
    longest_s: float

    def holds(self, exposure_s: float) -> bool:
        """Whether an exposure is possible."""
        return self.shortest_s <= exposure_s <= self.longest_s

    def nearest_s(self, exposure_s: float) -> float:
        """The possible exposure that is next to one."""
        return min(max(exposure_s, self.shortest_s), self.longest_s)

    def __str__(self) -> str:
        return f"{self.shortest_s:g} … {self.longest_s:g}"


def signature_of(codes: Codes) -> str:
    """A picture in 48 grey numbers, as hex: tells whether two pictures are the same but for rounding."""
    grey = codes if codes.ndim == 2 else codes.mean(axis=2).astype(np.uint8)
    return np.asarray(cv2.resize(grey, (8, 6), interpolation=cv2.INTER_AREA), dtype=np.uint8).tobytes().hex()


@dataclass(frozen=True, slots=True, kw_only=True)
class RawFrame:
    """One exposure, in digital numbers, exactly as the sensor gave it."""

    pixels: NDArray[np.uint16]
    """(H, W, C) digital numbers, C last even when 1, in memory that no later frame changes. [dn]"""
    exposure_s: float
    """What the device did, not what was asked."""
    started_s: float
    """Start of the exposure on the rig's clock."""
    sequence: int
    """The driver's counter; always higher than that of the frame before, but for a device that was opened again."""
    lost: int = 0
    """Frames that were lost just before this one, as far as the driver can tell."""
    repeats: bool = False
    """It is, byte for byte, the frame that came just before it, whether that one was returned or passed over."""


@dataclass(frozen=True, slots=True)
class Shown:
    """A picture that the projector has accepted."""

    on_screen_s: float
    """When the device says that it was on screen; light may come later by the display's latency."""
    name: str
    """The pattern's name, as given to :meth:`Projector.show`."""


@runtime_checkable
class Clock(Protocol):
    """The rig's only source of time and its only way to wait."""

    def now_s(self) -> float:
        """Monotonic time, in seconds."""
        ...

    def wait_until_s(self, time_s: float) -> None:
        """Return at or after ``time_s``; at once if that has passed."""
        ...


@runtime_checkable
class Camera(Protocol):
    """A camera under manual control."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """(height, width, channels) of its frames, in pixels."""
        ...

    @property
    def full_scale_dn(self) -> int:
        """The largest digital number; a pixel that has it is saturated."""
        ...

    @property
    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure; an ExposureRange, or any two numbers."""
        ...

    def open(self) -> None:
        """Make it ready; no-op when open. Raises DeviceLost."""
        ...

    def close(self) -> None:
        """Let it go; any number of times, from any state."""
        ...

    def set_exposure(self, exposure_s: float) -> float:
        """Ask for an exposure; returns the one the device chose. Raises SettingRefused outside its range."""
        ...

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        """Return a frame whose exposure should begin at or after ``after_s`` (the device may err: look at it).

        Raises CaptureTimeout when none comes within ``timeout_s``, DeviceLost when closed or gone.
        """
        ...


@runtime_checkable
class Resettable(Protocol):
    """A device that can be switched off and on from here, when nothing else helps."""

    def reset(self) -> None:
        """Reset it; it has to be closed, and opened again afterwards. Raises DeviceError."""
        ...


@runtime_checkable
class Advising(Protocol):
    """A camera that knows what its transport lacks."""

    def advice(self) -> tuple[str, ...]:
        """Return a sentence each, with the setting to change; nothing when all is well."""
        ...


class Gain(NamedTuple):
    """A camera's amplification, in its own numbers."""

    value: float
    least: float
    most: float
    unit: str
    """dB, ISO, or steps of the camera's own."""


class GainControl(Protocol):
    """The gain of an open camera, for looking: sessions have the one that their profile says."""

    def now(self) -> Gain:
        """Read it from the camera. Raises DeviceLost."""
        ...

    def change(self, value: float) -> Gain:
        """Ask for a gain; returns what the camera did. Raises SettingRefused outside its range, DeviceLost."""
        ...

    def profile_lines(self) -> str:
        """Return what a profile has to say so that sessions have the gain of now."""
        ...


@runtime_checkable
class Amplifying(Protocol):
    """A camera that may have a gain."""

    def gain_control(self) -> GainControl | None:
        """Return the control; None where the camera has none, or is closed. Closing leaves the gain as it was."""
        ...


def gain_control_of(camera: object) -> GainControl | None:
    """Return the control of a camera's gain; None where there is none."""
    return camera.gain_control() if isinstance(camera, Amplifying) else None


@runtime_checkable
class Watched(Protocol):
    """A projector that notices when its picture is not on screen any more."""

    def check_on_screen(self) -> None:
        """Raise DeviceLost unless what was shown last is still on screen; quick, asked after every frame."""
        ...


def check_on_screen(display: object) -> None:
    """Ask a projector whether its picture is still on screen, where it can tell. Raises DeviceLost."""
    if isinstance(display, Watched):
        display.check_on_screen()


@runtime_checkable
class Projector(Protocol):
    """A display output that shows codes unscaled."""

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), in pixels."""
        ...

    def open(self) -> None:
        """Make it ready; no-op when open. Raises DeviceLost."""
        ...

    def close(self) -> None:
        """Show black and let go; any number of times, from any state."""
        ...

    def show(self, codes: Codes, *, name: str) -> Shown:
        """Show uint8 codes of exactly its shape, and say when they were on screen.

        ``name`` is a label for logs; a replay finds its photographs by it. Raises DeviceLost, SettingRefused.
        """
        ...
