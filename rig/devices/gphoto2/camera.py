"""A still camera: manual, its exposure by its own steps, one picture each time one is asked for.

Its pictures have no time stamps that could be trusted: the shutter is released when the picture on the wall is known
to be there, and not sooner, by the rig's clock. So an exposure cannot have begun before the command was given.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from pydantic import Field, ValidationError

from rig.devices.driver_settings import CameraSettings
from rig.devices.fingerprint import Fingerprint
from rig.devices.gphoto2.gain import StillGain, still_gain
from rig.devices.gphoto2.pictures import WantedPicture, from_jpeg, from_raw
from rig.devices.gphoto2.port import StillPort
from rig.devices.protocols import Clock, ExposureRange, RawFrame
from rig.devices.refusals import check_exposure
from rig.devices.while_open import while_open
from rig.errors import CaptureTimeout, ProfileError, SettingRefused
from rig.files.toml import Table

FORMATS = ("JPEG", "RAW")
SHUTTER_SPEED = "shutterspeed"
_FORMATS = ("imageformat", "imagequality")
"""Settings of which one or the other says what files it writes."""
_PROGRAM, _MANUAL = "expprogram", ("M", "Manual")
_FOCUS = ("focusmode", "afmode")
_BATTERY, _LEAST_BATTERY = "batterylevel", 5
"""Percent: with less a session does not end well."""
_LEARNED = 16
"""Delays that are remembered."""


class StillOptions(Table):
    """The table [camera.options] of driver ``gphoto2``."""

    settings: Mapping[str, str] = Field(default_factory=dict)
    """By gphoto2's names (``iso = "100"``), set when it is opened, and read back."""


@dataclass(slots=True, kw_only=True)
class _OpenedStill:
    """Everything that exists while the camera is open."""

    port: StillPort
    speeds: dict[str, float]
    """Exposure of each step that is within the profile's range. [s]"""
    exposure_s: float
    gain: StillGain | None
    """None where it offers no sensitivities."""
    delays_s: list[float] = field(default_factory=list)
    """From the command to the picture, less the exposure: mirror, shutter, and the way of the file."""


class StillCamera:
    """A digital still camera under manual control.

    Parameters
    ----------
    device_id
        Its serial number, its port (``usb:001,004``), or ``virtual:FOLDER``.
    wanted
        Size, depth and filters of its pictures.
    pixel_format
        ``JPEG`` or ``RAW``.
    exposure_range_s
        Of its steps, those within are used.
    options
        What else the profile says.
    clock
        The rig's.
    """

    def __init__(
        self,
        device_id: str,
        wanted: WantedPicture,
        *,
        pixel_format: Literal["JPEG", "RAW"],
        exposure_range_s: tuple[float, float],
        options: StillOptions,
        clock: Clock,
    ):
        self.device_id = device_id
        self._wanted, self._format, self._options, self._clock = wanted, pixel_format, options, clock
        self._exposure_range_s = ExposureRange(*exposure_range_s)
        self._opened: _OpenedStill | None = None
        self._fingerprint, self._last_print = Fingerprint(), (0, 0, b"")
        self._pictures = 0

    @property
    def shape(self) -> tuple[int, int, int]:
        """(height, width, numbers a pixel)."""
        return self._wanted.shape

    @property
    def full_scale_dn(self) -> int:
        """Largest digital number."""
        return self._wanted.full_scale_dn

    @property
    def exposure_range_s(self) -> ExposureRange:
        """Shortest and longest exposure."""
        return self._exposure_range_s

    @property
    def delay_s(self) -> float | None:
        """Longest time of late from the command to the picture, less the exposure; None before the first."""
        opened = self._opened
        return max(opened.delays_s) if opened is not None and opened.delays_s else None

    @property
    def _name(self) -> str:
        return f"camera {self.device_id}"

    def open(self) -> None:
        """Open it, and see that it is manual, fed and focused by hand.

        Raises
        ------
        DeviceLost, DeviceBusy
            It is not there, or another program has it.
        SettingRefused
            Its dial, lens or battery have to be seen to first; the message says how.
        """
        if self._opened is not None:
            return
        port = StillPort(self.device_id, self._name)
        with ExitStack() as undo:
            undo.callback(port.close)
            self._check_state(port)
            if "Off" in port.choices("autofocus"):
                port.hold("autofocus", "Off")
            self._choose_format(port)
            for setting, value in self._options.settings.items():
                port.hold(setting, value)
            speeds = self._speeds(port)
            shown = seconds(port.value(SHUTTER_SPEED) or "")
            exposure_s = min(speeds.values()) if shown is None else shown
            self._opened = _OpenedStill(port=port, speeds=speeds, exposure_s=exposure_s, gain=still_gain(port))
            undo.pop_all()

    def _check_state(self, port: StillPort) -> None:
        program = port.value(_PROGRAM)
        if program is not None and program not in _MANUAL:
            raise SettingRefused(f"{self._name}: the dial is at {program}; turn it to M (manual)")
        for setting in _FOCUS:
            mode = port.value(setting)
            if mode is not None and not mode.lower().startswith("m"):
                raise SettingRefused(
                    f"{self._name}: the lens focuses by itself ({mode}); set its switch to MF (manual)"
                )
        battery = re.match(r"(\d+)\s*%", port.value(_BATTERY) or "")
        if battery is not None and int(battery[1]) < _LEAST_BATTERY:
            raise SettingRefused(f"{self._name}: the battery is at {battery[1]} %; charge it, or use mains power")

    def _choose_format(self, port: StillPort) -> None:
        """Choose raw or JPEG alone, where the camera has a setting for it."""
        for setting in _FORMATS:
            entries = port.choices(setting)
            raw = _raw_of(entries)
            alone = [one for one in raw if "+" not in one]
            jpeg = [one for one in entries if one not in raw]
            usable = alone if self._format == "RAW" else jpeg
            if usable and port.value(setting) not in usable:
                port.hold(setting, usable[0])

    def _speeds(self, port: StillPort) -> dict[str, float]:
        entries = port.choices(SHUTTER_SPEED)
        known = {text: exposure_s for text in entries if (exposure_s := seconds(text)) is not None}
        usable = {text: exposure_s for text, exposure_s in known.items() if self._exposure_range_s.holds(exposure_s)}
        if not usable:
            listed = ", ".join(entries) or "none"
            raise SettingRefused(
                f"{self._name} offers no shutter speed within camera.exposure_range_s {self._exposure_range_s}: "
                f"{listed}; turn its dial to M, or correct the range"
            )
        return usable

    def close(self) -> None:
        """Let it go; any number of times, from any state."""
        opened, self._opened = self._opened, None
        if opened is not None:
            if opened.gain is not None:
                opened.gain.put_back()
            opened.port.close()

    def gain_control(self) -> StillGain | None:
        """Its sensitivity, while it is open; closing it puts back what was there."""
        return None if self._opened is None else self._opened.gain

    def set_exposure(self, exposure_s: float) -> float:
        """Choose the step that is nearest in its logarithm, and return its exposure.

        Raises SettingRefused outside the range, DeviceLost when closed or gone.
        """
        with while_open(self._opened, name=self._name, doing="setting its exposure", close=self.close) as opened:
            check_exposure(exposure_s, self._exposure_range_s)
            text = min(opened.speeds, key=lambda one: abs(math.log(opened.speeds[one] / exposure_s)))
            opened.port.hold(SHUTTER_SPEED, text)
            opened.exposure_s = opened.speeds[text]
            return opened.exposure_s

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        """Wait until ``after_s``, release the shutter, and return the picture.

        Raises CaptureTimeout when the camera takes longer than ``timeout_s``, DeviceLost when closed or gone.
        """
        until_s = self._clock.now_s() + timeout_s
        with while_open(self._opened, name=self._name, doing="capturing", close=self.close) as opened:
            self._clock.wait_until_s(min(after_s, until_s))
            began_s = self._clock.now_s()
            if began_s + opened.exposure_s + min(opened.delays_s, default=0.0) > until_s:
                raise self._too_late(timeout_s)
            data = opened.port.release(opened.exposure_s)
            ended_s = self._clock.now_s()
            opened.delays_s = [*opened.delays_s[1 - _LEARNED :], max(ended_s - began_s - opened.exposure_s, 0.0)]
            if ended_s > until_s:
                raise self._too_late(timeout_s)
            self._clock.wait_until_s(began_s + opened.exposure_s)
            return self._frame(data, opened.exposure_s, began_s)

    def _too_late(self, timeout_s: float) -> CaptureTimeout:
        return CaptureTimeout(f"{self._name}: no picture within {timeout_s:g} s; give timing.timeout_s more time")

    def _frame(self, data: bytes, exposure_s: float, began_s: float) -> RawFrame:
        pixels = from_raw(data, self._wanted) if self._format == "RAW" else from_jpeg(data, self._wanted)
        self._pictures += 1
        fingerprint = self._fingerprint.of(np.frombuffer(data, np.uint8))
        repeats, self._last_print = fingerprint == self._last_print, fingerprint
        return RawFrame(
            pixels=pixels, exposure_s=exposure_s, started_s=began_s, sequence=self._pictures, repeats=repeats
        )


def _raw_of(entries: Sequence[str]) -> list[str]:
    return [one for one in entries if re.search(r"raw|nef|arw|cr[23w]", one, re.IGNORECASE)]


def raw_entries(port: StillPort) -> list[str]:
    """Return the camera's choices that make raw files, alone or beside a JPEG."""
    return [one for setting in _FORMATS for one in _raw_of(port.choices(setting))]


def seconds(text: str) -> float | None:
    """Return the exposure of a shutter speed as cameras write it (``1/50``, ``0.0200s``, ``2"``); None of others."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)(?:/(\d+(?:\.\d+)?))?\s*(?:s|sec|\")?", text.strip())
    if found is None or float(found[1]) == 0:
        return None
    return float(found[1]) / float(found[2] or 1)


def from_profile(settings: CameraSettings, clock: Clock) -> StillCamera:
    """Make the camera of a profile's table [[camera]], closed: driver ``gphoto2``. Raises ProfileError."""
    form = settings.pixel_format
    if form not in FORMATS:
        raise ProfileError(
            f"camera.pixel_format: is {form!r}, of a still camera it is {' or '.join(FORMATS)}; write one of them"
        )
    if form == "JPEG" and (settings.mosaic is not None or settings.bit_depth != 8):
        raise ProfileError("camera.pixel_format: JPEG has a bit depth of 8 and no mosaic; correct them, or take RAW")
    if form == "RAW" and settings.channels != 3:
        raise ProfileError(
            "camera.channels: a raw file has three; write 3, or name its filters in camera.mosaic for one channel"
        )
    try:
        options = StillOptions.model_validate(dict(settings.options))
    except ValidationError as error:
        lines = [f"camera.options.{'.'.join(map(str, one['loc']))}: {one['msg']}" for one in error.errors()]
        raise ProfileError("\n".join(lines)) from error
    return StillCamera(
        settings.device_id or "",
        WantedPicture(settings.shape, settings.full_scale_dn, settings.mosaic),
        pixel_format="RAW" if form == "RAW" else "JPEG",
        exposure_range_s=settings.exposure_range_s,
        options=options,
        clock=clock,
    )
