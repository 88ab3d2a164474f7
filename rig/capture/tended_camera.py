"""One camera of a rig, looked after: its exposure, which of its frames are good, and what to do when none is.

A frame belongs to a picture when its exposure began after the picture's light had settled, with the exposure that was
set, and when it is no copy of an older frame with a new time stamp: the noise of a real sensor never comes twice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.capture.events import EventLog
from rig.capture.recovery import close_quietly, talking_to
from rig.devices.protocols import Camera, Clock, Gain, RawFrame, Resettable, gain_control_of
from rig.devices.refusals import check_exposure
from rig.errors import CaptureTimeout, DeviceBusy, DeviceError, DeviceForbidden, SettingRefused
from rig.profile.tables import CameraProfile, CaptureTiming

EXPOSURE_TOLERANCE = 0.01
"""Relative; a frame whose exposure differs by more is from before the camera took the setting over."""
_SILENCE = 2
"""Time limits that pass one after the other without any frame before the camera is opened again."""
_SAME_EXPOSURE = 1e-6
"""Relative; a camera that is opened again has to expose as before."""


class TendedCamera:
    """A camera with what is known of it while the rig is open.

    Parameters
    ----------
    device
        The camera.
    settings
        Its table of the profile.
    label
        How messages call it.
    clock, log
        The rig's.
    """

    def __init__(self, device: Camera, settings: CameraProfile, *, label: str, clock: Clock, log: EventLog):
        self.device = device
        self.label = label
        self._clock = clock
        self._log = log
        self._is_live = settings.driver != "replay"
        self._asked_s: float | None = None
        self._exposure_s: float | None = None
        self._gain: float | None = None
        self._validator = FrameValidator(
            device.shape, device.full_scale_dn, 1 / settings.frame_rate_hz, live=self._is_live
        )

    def open(self) -> None:
        """Open it, as it was when it was open before. Raises DeviceError."""
        with talking_to(self.device):
            self.device.open()
            self.restore()

    def forget_count(self) -> None:
        """It was opened: its frames are counted anew."""
        self._validator.forget_count()

    def forget(self) -> None:
        """It is closed: its exposure is not set any more."""
        self._asked_s = self._exposure_s = self._gain = None

    def set_exposure(self, exposure_s: float) -> float:
        """Ask for an exposure, and return the one the camera chose. Raises SettingRefused outside its range."""
        check_exposure(exposure_s, self.device.exposure_range_s)
        with talking_to(self.device):
            chosen_s = self.device.set_exposure(exposure_s)
        self._asked_s, self._exposure_s = exposure_s, chosen_s
        return chosen_s

    def set_gain(self, value: float) -> Gain:
        """Ask for a gain, and return what the camera did. Raises SettingRefused outside its range, or without one."""
        with talking_to(self.device):
            control = gain_control_of(self.device)
            if control is None:
                raise SettingRefused(f"{self.label} has no gain that could be set; change its exposure")
            gain = control.change(value)
        self._gain = gain.value
        return gain

    def expose(self, exposure_s: float | None) -> None:
        """Set an exposure unless it is set already; None leaves it."""
        if exposure_s is not None and exposure_s not in (self._asked_s, self._exposure_s):
            self.set_exposure(exposure_s)

    def restore(self) -> None:
        """After it was opened again: gain and exposure as they were, and a new count of its frames."""
        self.forget_count()
        if self._gain is not None and (control := gain_control_of(self.device)) is not None:
            control.change(self._gain)
        if self._exposure_s is None:
            return
        chosen_s = self.device.set_exposure(self._exposure_s)
        if not abs(chosen_s - self._exposure_s) <= _SAME_EXPOSURE * self._exposure_s:
            raise SettingRefused(
                f"{self.label} was opened again and now exposes {chosen_s:.6g} s, not "
                f"{self._exposure_s:.6g} s as before: is it another camera?"
            )

    def first_good_frame(
        self, name: str, settled_s: float, timing: CaptureTiming, check_picture: Callable[[], None]
    ) -> RawFrame | None:
        """Return the first good frame of a picture; None when the camera needs more than to be asked again.

        ``check_picture`` raises when the picture went away during the exposure: then the frame is spoilt.
        """
        wanted = Wanted(settled_s, self._exposure_s)
        silent = 0
        for _ in range(1 + timing.retries):
            try:
                with talking_to(self.device):
                    frame = self.device.capture(after_s=settled_s, timeout_s=timing.timeout_s)
            except CaptureTimeout as error:
                self._log.note("timeout", f"{name}: {error}")
                silent += 1
                if silent == _SILENCE:
                    return None
                continue
            except (SettingRefused, DeviceBusy, DeviceForbidden):
                raise
            except DeviceError as error:
                self._log.note("failed", f"{name}: {error}")
                return None
            silent = 0
            rejection = self._validator.rejection(frame, wanted, self._clock.now_s())
            if rejection is None:
                check_picture()
                return frame
            self._log.note(rejection.kind, f"{name}: {rejection.detail}")
        return None

    def remedies(self) -> list[Callable[[], None]]:
        """What to do to a camera that gives no good frame, the mildest first: each after asking again did not help."""
        if not self._is_live:
            return []
        return [self._reopen, self._reset] if isinstance(self.device, Resettable) else [self._reopen]

    def _reopen(self) -> None:
        self._log.note("reopened", f"{self.label}: gave no good frame")
        close_quietly(self.device)
        self.open()

    def _reset(self) -> None:
        close_quietly(self.device)
        try:
            if isinstance(self.device, Resettable):
                self.device.reset()
        except DeviceError as error:
            self._log.note("failed", f"{self.label} could not be reset: {error}")
        else:
            self._log.note("reset", f"{self.label}: gave no good frame after it was opened again")
        self.open()


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a frame has to be."""

    settled_s: float
    """Its exposure begins then or later, on the rig's clock."""
    exposure_s: float | None
    """None: any."""


@dataclass(frozen=True, slots=True)
class Rejection:
    """Why a frame is not the one that was asked for."""

    kind: str
    """stale, ahead, repeated, lost, malformed or exposure."""
    detail: str


class FrameValidator:
    """Judges the frames of one camera, in the order in which it delivers them.

    Parameters
    ----------
    shape
        (height, width, channels) of the camera's frames.
    full_scale_dn
        The largest digital number that they may hold.
    period_s
        Between two frames; a time stamp further ahead of the clock is wrong.
    live
        Whether frames come from a sensor, with noise that never repeats. A recording may give a frame twice.
    """

    def __init__(self, shape: tuple[int, int, int], full_scale_dn: int, period_s: float, *, live: bool):
        self._shape = shape
        self._full_scale_dn = full_scale_dn
        self._period_s = period_s
        self._live = live
        self._last: RawFrame | None = None
        self._last_sequence: int | None = None

    def forget_count(self) -> None:
        """The camera was opened again: its counter may begin anew."""
        self._last_sequence = None

    def rejection(self, frame: RawFrame, wanted: Wanted, now_s: float) -> Rejection | None:
        """Say what is wrong with the next frame; None when it is good. Remembers it either way."""
        found = (
            self._out_of_order(frame)
            or self._malformed(frame)
            or self._wrong_time(frame, wanted.settled_s, now_s)
            or _wrong_exposure(frame, wanted.exposure_s)
            or self._copied(frame)
            or self._after_a_gap(frame)
        )
        self._remember(frame)
        return found

    def _remember(self, frame: RawFrame) -> None:
        """A lower number on a newer frame is a counter that began anew: believed from the next frame on."""
        newer = self._last is None or frame.started_s > self._last.started_s
        if newer or self._last_sequence is None or frame.sequence > self._last_sequence:
            self._last_sequence = frame.sequence
        self._last = frame

    def _out_of_order(self, frame: RawFrame) -> Rejection | None:
        last = self._last_sequence
        if last is None or frame.sequence > last:
            return None
        return Rejection("repeated", f"frame {frame.sequence} came after frame {last}")

    def _malformed(self, frame: RawFrame) -> Rejection | None:
        pixels = frame.pixels
        if pixels.dtype != np.uint16 or pixels.shape != self._shape:
            detail = f"frame of {pixels.dtype} {pixels.shape}, expected uint16 {self._shape}"
            return Rejection("malformed", detail)
        brightest = int(pixels.max())
        if brightest > self._full_scale_dn:
            return Rejection("malformed", f"pixel of {brightest} dn, full scale is {self._full_scale_dn} dn")
        return None

    def _wrong_time(self, frame: RawFrame, settled_s: float, now_s: float) -> Rejection | None:
        if not frame.started_s >= settled_s:
            early_ms = (settled_s - frame.started_s) * 1e3
            return Rejection("stale", f"exposure began {early_ms:.1f} ms before the picture settled")
        ahead_s = frame.started_s - now_s
        if ahead_s > self._period_s:
            detail = f"time stamp is {ahead_s:.3g} s ahead of the clock: the camera uses another clock"
            return Rejection("ahead", detail)
        return None

    def _copied(self, frame: RawFrame) -> Rejection | None:
        if not self._live or not (frame.repeats or self._equals_last(frame)) or _is_constant(frame.pixels):
            return None
        return Rejection("repeated", f"frame {frame.sequence} has the pixels of the frame before: frozen?")

    def _equals_last(self, frame: RawFrame) -> bool:
        """The middle row alone tells two frames of a sensor apart."""
        if self._last is None or frame.pixels.shape != self._last.pixels.shape:
            return False
        middle = len(frame.pixels) // 2
        return np.array_equal(frame.pixels[middle], self._last.pixels[middle]) and np.array_equal(
            frame.pixels, self._last.pixels
        )

    def _after_a_gap(self, frame: RawFrame) -> Rejection | None:
        """Nobody can tell whether a frame is a copy of one that was lost."""
        if not self._live or not frame.lost:
            return None
        return Rejection("lost", f"{frame.lost} frames before frame {frame.sequence}")


def _wrong_exposure(frame: RawFrame, set_s: float | None) -> Rejection | None:
    if set_s is not None and not abs(frame.exposure_s - set_s) <= EXPOSURE_TOLERANCE * set_s:
        return Rejection("exposure", f"exposed {frame.exposure_s:.6g} s, set {set_s:.6g} s")
    return None


def _is_constant(pixels: NDArray[np.uint16]) -> bool:
    """Black or saturated everywhere: such frames are equal without being copies."""
    return bool(pixels.min() == pixels.max())
