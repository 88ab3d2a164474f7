"""The controls of the emulated camera: what the host may ask and set, with limits, automatics and refusals.

Units, selectors and request codes are those of the USB Video Class 1.1, tables A-8 to A-14 and chapter 4.2.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum, IntFlag

from rig.devices.usb.extension_unit import Query
from rig.emulated.usbip.device import Stall

CAMERA_TERMINAL, PROCESSING_UNIT, OUTPUT_TERMINAL, EXTENSION_UNIT = 1, 2, 3, 4
"""Identities of the camera's parts; 0 is the video control interface itself."""
EXPOSURE_UNIT_S = 1e-4
UNITY_GAIN = 100
"""Setting of the gain at which it does nothing."""
MANUAL_EXPOSURE, AUTO_EXPOSURE = 1, 8
"""Exposure modes: manual; aperture priority, in which the camera chooses the exposure."""
_ERROR_CODE_SELECTOR = 2


class RequestError(IntEnum):
    """Why a request was refused, for a host that asks after a stall."""

    NONE = 0
    NOT_READY = 1
    WRONG_STATE = 2
    OUT_OF_RANGE = 4
    INVALID_UNIT = 5
    INVALID_CONTROL = 6
    INVALID_REQUEST = 7
    INVALID_VALUE = 8


class Info(IntFlag):
    """Answer to GET_INFO."""

    GET = 1
    SET = 2
    DISABLED_BY_AUTOMATIC = 4
    CHANGES_BY_ITSELF = 8


@dataclass(frozen=True, slots=True)
class Automatic:
    """The control that takes another one over, and the value at which it does not."""

    name: str
    manual_value: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Control:
    """One control and its limits."""

    name: str
    unit: int
    selector: int
    bit: int
    """Its place in the unit's map of controls."""
    length: int
    """Bytes of its value."""
    minimum: int = 0
    maximum: int = 1
    step: int = 1
    default: int = 0
    choices: tuple[int, ...] = ()
    """The only values, if it is no range."""
    signed: bool = False
    automatic: Automatic | None = None
    info: Info = Info.GET | Info.SET

    def allows(self, value: int) -> bool:
        """Return whether the camera accepts a value."""
        if self.choices:
            return value in self.choices
        return self.minimum <= value <= self.maximum and (value - self.minimum) % self.step == 0


def camera_controls(exposure_range_s: tuple[float, float], exposure_s: float) -> tuple[Control, ...]:
    """Controls of the optics and the sensor; ``exposure_s`` is the one it begins with."""
    shortest, longest, first = (round(value / EXPOSURE_UNIT_S) for value in (*exposure_range_s, exposure_s))
    mode = Automatic("exposure_mode", MANUAL_EXPOSURE)
    changing = Info.GET | Info.SET | Info.CHANGES_BY_ITSELF
    at = CAMERA_TERMINAL
    return (
        Control(
            name="exposure_mode", unit=at, selector=0x02, bit=1, length=1, step=9, default=AUTO_EXPOSURE, choices=(1, 8)
        ),
        Control(name="exposure_priority", unit=at, selector=0x03, bit=2, length=1),
        Control(
            name="exposure",
            unit=at,
            selector=0x04,
            bit=3,
            length=4,
            minimum=shortest,
            maximum=longest,
            step=1,
            default=first,
            automatic=mode,
            info=changing,
        ),
        Control(
            name="focus",
            unit=at,
            selector=0x06,
            bit=5,
            length=2,
            minimum=0,
            maximum=250,
            step=5,
            default=0,
            automatic=Automatic("focus_automatic", 0),
            info=changing,
        ),
        Control(name="focus_automatic", unit=at, selector=0x08, bit=17, length=1, default=1),
    )


def processing_controls() -> tuple[Control, ...]:
    """Controls of the picture. Only the gain changes the picture; the others are kept as a camera keeps them."""
    white = Automatic("white_balance_automatic", 0)
    at = PROCESSING_UNIT
    return (
        Control(
            name="backlight_compensation",
            unit=at,
            selector=0x01,
            bit=8,
            length=2,
            minimum=0,
            maximum=2,
            step=1,
            default=0,
        ),
        Control(
            name="brightness",
            unit=at,
            selector=0x02,
            bit=0,
            length=2,
            minimum=-64,
            maximum=64,
            step=1,
            default=0,
            signed=True,
        ),
        Control(name="contrast", unit=at, selector=0x03, bit=1, length=2, minimum=0, maximum=95, step=1, default=32),
        Control(
            name="gain",
            unit=at,
            selector=0x04,
            bit=9,
            length=2,
            minimum=UNITY_GAIN,
            maximum=1600,
            step=1,
            default=UNITY_GAIN,
        ),
        Control(
            name="power_line_frequency",
            unit=at,
            selector=0x05,
            bit=10,
            length=1,
            minimum=0,
            maximum=2,
            step=1,
            default=1,
        ),
        Control(name="sharpness", unit=at, selector=0x08, bit=4, length=2, minimum=0, maximum=7, step=1, default=2),
        Control(name="gamma", unit=at, selector=0x09, bit=5, length=2, minimum=100, maximum=300, step=1, default=220),
        Control(
            name="white_balance",
            unit=at,
            selector=0x0A,
            bit=6,
            length=2,
            minimum=2800,
            maximum=6500,
            step=10,
            default=4600,
            automatic=white,
        ),
        Control(name="white_balance_automatic", unit=at, selector=0x0B, bit=12, length=1, default=1),
    )


@dataclass(frozen=True, slots=True)
class VendorRegister:
    """A control of the vendor's own: bytes of a fixed number, without limits."""

    name: str
    selector: int
    default: bytes
    info: Info = Info.GET | Info.SET


REGISTER = VendorRegister("register", 1, bytes(32))
FIRMWARE = VendorRegister("firmware", 2, b"1.04", Info.GET)
VENDOR_CONTROLS = (REGISTER, FIRMWARE)


class ControlBank:
    """The controls of one camera and their present values; safe to share between threads."""

    def __init__(self, controls: tuple[Control, ...], vendor_controls: tuple[VendorRegister, ...] = VENDOR_CONTROLS):
        self.controls = controls
        self.last_error = RequestError.NONE
        """Why the last request was refused."""
        self._vendor_controls = vendor_controls
        self._lock = threading.Lock()
        self.reset()

    def reset(self) -> None:
        """All as when it was switched on."""
        with self._lock:
            self._values = {control.name: control.default for control in self.controls}
            self._bytes = {control.name: control.default for control in self._vendor_controls}

    def value(self, name: str) -> int:
        """Present value of a control."""
        with self._lock:
            return self._values[name]

    def put(self, name: str, value: int) -> None:
        """Take over what an automatic sets: no limits, no refusal."""
        with self._lock:
            self._values[name] = value

    def request(self, unit: int, selector: int, request: int, data: bytes) -> bytes:
        """Answer the host. Raises Stall when refused, and keeps the reason for when it asks."""
        if unit == 0 and selector == _ERROR_CODE_SELECTOR:
            return self._describe_error(request)
        self.last_error = RequestError.NONE
        if unit == EXTENSION_UNIT:
            return self._vendor(selector, request, data)
        for control in self.controls:
            if (control.unit, control.selector) == (unit, selector):
                return self._integer(control, request, data)
        known = unit in {control.unit for control in self.controls}
        raise self.refuse(RequestError.INVALID_CONTROL if known else RequestError.INVALID_UNIT)

    def refuse(self, error: RequestError) -> Stall:
        """The exception to raise; the reason is kept."""
        self.last_error = error
        return Stall()

    def _describe_error(self, request: int) -> bytes:
        return bytes([Info.GET if request == Query.GET_INFO else self.last_error])

    def _integer(self, control: Control, request: int, data: bytes) -> bytes:
        if request == Query.SET_CUR:
            self._set(control, data)
            return b""
        if request == Query.GET_INFO:
            return bytes([control.info | (Info.DISABLED_BY_AUTOMATIC if self._is_automatic(control) else 0)])
        if request == Query.GET_LEN:
            return control.length.to_bytes(2, "little")
        numbers = {
            Query.GET_CUR: self.value(control.name),
            Query.GET_MIN: control.minimum,
            Query.GET_MAX: control.maximum,
            Query.GET_RES: control.step,
            Query.GET_DEF: control.default,
        }
        if request not in numbers:
            raise self.refuse(RequestError.INVALID_REQUEST)
        return numbers[Query(request)].to_bytes(control.length, "little", signed=control.signed)

    def _is_automatic(self, control: Control) -> bool:
        by = control.automatic
        return by is not None and self.value(by.name) != by.manual_value

    def _set(self, control: Control, data: bytes) -> None:
        value = int.from_bytes(data, "little", signed=control.signed)
        if len(data) != control.length:
            raise self.refuse(RequestError.INVALID_VALUE)
        if self._is_automatic(control):
            raise self.refuse(RequestError.WRONG_STATE)
        if not control.allows(value):
            raise self.refuse(RequestError.INVALID_VALUE if control.choices else RequestError.OUT_OF_RANGE)
        self.put(control.name, value)

    def _vendor(self, selector: int, request: int, data: bytes) -> bytes:
        control = next((each for each in self._vendor_controls if each.selector == selector), None)
        if control is None:
            raise self.refuse(RequestError.INVALID_CONTROL)
        length = len(control.default)
        if request == Query.SET_CUR:
            self._set_vendor(control, data)
            return b""
        answers = {
            Query.GET_CUR: self._bytes[control.name],
            Query.GET_MIN: bytes(length),
            Query.GET_MAX: b"\xff" * length,
            Query.GET_RES: b"\x01" + bytes(length - 1),
            Query.GET_DEF: control.default,
            Query.GET_LEN: length.to_bytes(2, "little"),
            Query.GET_INFO: bytes([control.info]),
        }
        if request not in answers:
            raise self.refuse(RequestError.INVALID_REQUEST)
        return answers[Query(request)]

    def _set_vendor(self, control: VendorRegister, data: bytes) -> None:
        if Info.SET not in control.info:
            raise self.refuse(RequestError.INVALID_REQUEST)
        if len(data) != len(control.default):
            raise self.refuse(RequestError.INVALID_VALUE)
        with self._lock:
            self._bytes[control.name] = data


def bit_map(controls: Iterable[Control], length: int) -> bytes:
    """A unit's map of its controls."""
    return sum(1 << control.bit for control in controls).to_bytes(length, "little")
