"""One camera of a rig, looked after: its exposure, which of its frames are good, and what to do when none is."""

from __future__ import annotations

from collections.abc import Callable

from rig.capture.events import EventLog
from rig.capture.frame_checks import FrameValidator, Wanted
from rig.capture.recovery import close_quietly, talking_to
from rig.devices.protocols import Camera, Clock, RawFrame, Resettable
from rig.devices.refusals import check_exposure
from rig.errors import CaptureTimeout, DeviceBusy, DeviceError, DeviceForbidden, SettingRefused
from rig.profile.tables import CameraProfile, CaptureTiming

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
        self._asked_s = self._exposure_s = None

    def set_exposure(self, exposure_s: float) -> float:
        """Ask for an exposure, and return the one the camera chose. Raises SettingRefused outside its range."""
        check_exposure(exposure_s, self.device.exposure_range_s)
        with talking_to(self.device):
            chosen_s = self.device.set_exposure(exposure_s)
        self._asked_s, self._exposure_s = exposure_s, chosen_s
        return chosen_s

    def expose(self, exposure_s: float | None) -> None:
        """Set an exposure unless it is set already; None leaves it."""
        if exposure_s is not None and exposure_s not in (self._asked_s, self._exposure_s):
            self.set_exposure(exposure_s)

    def restore(self) -> None:
        """After it was opened again: the exposure as it was, and a new count of its frames."""
        self.forget_count()
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
