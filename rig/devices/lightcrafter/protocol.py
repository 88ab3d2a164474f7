"""The language of a DLP LightCrafter 4500 (controller DLPC350) over USB HID: bytes only.

Written from public descriptions of TI's programmer's guide (DLPU010) and of TI's sample code, tested against an
emulation, never seen on real hardware. What these sources do not tell, or tell differently, is left out: inverted
trigger outputs, bit depths 3, 5 and 6 of streamed patterns, image loading and firmware.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from rig.devices.usb.hid import REPORT_BYTES
from rig.errors import DeviceError, SettingRefused

VENDOR_ID, PRODUCT_ID = 0x0451, 0x6401
_READ, _REPLY, _REFUSED = 0x80, 0x40, 0x20
_HEAD = struct.Struct("<BBH")


class Command(IntEnum):
    """Commands: CMD2 is the high byte, CMD3 the low byte."""

    POWER = 0x0200
    SOFTWARE_VERSION = 0x0205
    LED_CURRENTS = 0x0B01
    LED_POLARITY = 0x1A05
    LED_ENABLE = 0x1A07
    HARDWARE_STATUS = 0x1A0A
    SYSTEM_STATUS = 0x1A0B
    MAIN_STATUS = 0x1A0C
    GAMMA = 0x1A0E
    VALIDATE = 0x1A1A
    DISPLAY_MODE = 0x1A1B
    TRIGGER_OUT_1 = 0x1A1D
    TRIGGER_OUT_2 = 0x1A1E
    PATTERN_SOURCE = 0x1A22
    PATTERN_TRIGGER = 0x1A23
    PATTERN_RUN = 0x1A24
    PATTERN_TIMES = 0x1A29
    LUT_CONTROL = 0x1A31
    LUT_OFFSET = 0x1A32
    LUT_ACCESS = 0x1A33
    LUT_DATA = 0x1A34


class DisplayMode(IntEnum):
    """What the controller does with its input."""

    VIDEO = 0
    PATTERN = 1


class Run(IntEnum):
    """State of a pattern sequence."""

    STOP = 0
    PAUSE = 1
    START = 2


class PatternTrigger(IntEnum):
    """What starts a pattern sequence."""

    VSYNC = 0
    INTERNAL_OR_EXTERNAL = 1


class EntryTrigger(IntEnum):
    """What starts one pattern of a sequence."""

    INTERNAL = 0
    EXTERNAL_POSITIVE = 1
    EXTERNAL_NEGATIVE = 2
    CONTINUE = 3


LEDS_BY_SEQUENCER = 0x08
"""LED_ENABLE: each colour's LED is lit while that colour's picture is shown; the state after power-on."""
MINIMUM_EXPOSURE_US = {1: 235, 2: 700, 4: 1700, 7: 4500, 8: 8333}
"""Shortest exposure by bit depth. [µs]"""
BIT_PLANES = 24
TRIGGER_STEP_S = 107.2e-9
TRIGGER_ZERO, TRIGGER_LAST = 0xBB, 0xD5
EXPOSURE_GAP_US = 230
"""An exposure lasts the whole frame period, or is shorter by at least this. [µs]"""
LONGEST_LUT = 128
LONGEST_MESSAGE = 512
"""With its head. [bytes]"""


@dataclass(frozen=True, slots=True)
class Reply:
    """The head of an answer, and what of its data lies in the first report."""

    sequence: int
    refused: bool
    length: int
    """Of all its data. [bytes]"""
    data: bytes


def request(command: Command, data: bytes = b"", *, sequence: int, reading: bool) -> list[bytes]:
    """Reports of 64 bytes that ask for, or set, something; the first begins with the head, all are padded with 0."""
    flags = _REPLY | (_READ if reading else 0)
    message = _HEAD.pack(flags, sequence, 2 + len(data)) + struct.pack("<H", command) + data
    padded = message + bytes(-len(message) % REPORT_BYTES)
    return [padded[at : at + REPORT_BYTES] for at in range(0, len(padded), REPORT_BYTES)]


def parse_reply(report: bytes) -> Reply:
    """Read the first report of an answer. Raises DeviceError for one that cannot be an answer."""
    if len(report) < _HEAD.size:
        raise DeviceError(
            f"LightCrafter: an answer of {len(report)} bytes, expected {REPORT_BYTES}; switch it off and on"
        )
    flags, sequence, length = _HEAD.unpack_from(report)
    if length > LONGEST_MESSAGE:
        raise DeviceError(
            f"LightCrafter: an answer of {length} bytes, the longest is {LONGEST_MESSAGE}; switch it off and on"
        )
    return Reply(sequence, bool(flags & _REFUSED), length, report[_HEAD.size : _HEAD.size + length])


@dataclass(frozen=True, slots=True)
class Version:
    """A version number."""

    major: int
    minor: int
    patch: int

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}.{self.patch}"


def parse_version(data: bytes) -> Version:
    """Version of the application software: the first of four little-endian words."""
    (word,) = struct.unpack_from("<I", data)
    return Version(word >> 24, word >> 16 & 0xFF, word & 0xFFFF)


@dataclass(frozen=True, slots=True)
class MainStatus:
    """What the controller does now."""

    parked: bool
    """Its mirrors are parked: no picture."""
    sequencer_running: bool
    frozen: bool
    gamma_on: bool
    """It undoes a gamma curve of the input, so that codes are not linear light."""


def parse_main_status(byte: int) -> MainStatus:
    """The four bits of the main status."""
    return MainStatus(*(bool(byte >> bit & 1) for bit in range(4)))


_HARDWARE_PROBLEMS = {2: "reset controller error", 3: "forced swap error", 6: "sequencer abort", 7: "sequencer error"}


def hardware_problems(byte: int) -> tuple[str, ...]:
    """Return what is wrong, by the hardware status; empty when all is well."""
    found = tuple(text for bit, text in _HARDWARE_PROBLEMS.items() if byte >> bit & 1)
    return found if byte & 1 else ("initialisation failed", *found)


_INVALID = {0: "exposure or frame period", 1: "pattern numbers"}
_DOUBTFUL = {
    2: "trigger out 1 is requested without a pause, or black sectors overlap",
    3: "no black was inserted before an externally triggered pattern",
    4: f"frame period and exposure differ by less than {EXPOSURE_GAP_US} µs",
}


def validation(byte: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """(what is invalid, what is doubtful) in a pattern sequence, by the controller's own check."""
    invalid, doubtful = (
        tuple(text for bit, text in texts.items() if byte >> bit & 1) for texts in (_INVALID, _DOUBTFUL)
    )
    return invalid, doubtful


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredPattern:
    """One entry of a pattern sequence from streamed video."""

    number: int
    """Which bit planes of the 24: number × bit depth is the first, in the order green, red, blue."""
    bit_depth: int
    leds: int = 7
    """Which LEDs light it: 1 red, 2 green, 4 blue, added up."""
    trigger: EntryTrigger = EntryTrigger.EXTERNAL_POSITIVE
    insert_black: bool = False
    buffer_swap: bool = False

    def packed(self) -> bytes:
        """The entry's three bytes. Raises SettingRefused for what the controller cannot show."""
        if self.bit_depth not in MINIMUM_EXPOSURE_US:
            raise SettingRefused(f"LightCrafter: bit depth {self.bit_depth}; it has to be one of 1, 2, 4, 7, 8")
        last = BIT_PLANES // self.bit_depth - 1
        if not 0 <= self.number <= last or not 0 <= self.leds <= 7:
            raise SettingRefused(
                f"LightCrafter: pattern {self.number} lit by LEDs {self.leds}; at {self.bit_depth} bits patterns "
                f"are 0 … {last}, LEDs 0 … 7"
            )
        flags = self.insert_black << 1 | self.buffer_swap << 2
        return bytes([self.trigger | self.number << 2, self.bit_depth | self.leds << 4, flags])


def packed_times(exposure_us: int, frame_period_us: int, patterns: list[StoredPattern]) -> bytes:
    """Exposure and frame period of each pattern. Raises SettingRefused for times that the guide excludes."""
    shortest = max(MINIMUM_EXPOSURE_US[pattern.bit_depth] for pattern in patterns)
    if exposure_us < shortest:
        raise SettingRefused(
            f"LightCrafter: exposure {exposure_us} µs, at this bit depth at least {shortest} µs; "
            "lengthen it, or take fewer bits"
        )
    if exposure_us != frame_period_us and frame_period_us - exposure_us < EXPOSURE_GAP_US:
        raise SettingRefused(
            f"LightCrafter: exposure {exposure_us} µs in a frame period of {frame_period_us} µs; "
            f"make them equal, or leave {EXPOSURE_GAP_US} µs"
        )
    return struct.pack("<II", exposure_us, frame_period_us)


def trigger_delay(delay_s: float) -> int:
    """A trigger edge's delay in the controller's steps. Raises SettingRefused outside -20.05 … +2.787 µs."""
    steps = TRIGGER_ZERO + round(delay_s / TRIGGER_STEP_S)
    if not 0 <= steps <= TRIGGER_LAST:
        raise SettingRefused(f"LightCrafter: trigger delay {delay_s * 1e6:.3f} µs; it has to be in -20.05 … 2.787 µs")
    return steps


LED_STEP_LIMIT = 190
"""Above about 195 users report boards that stop."""
LED_TOTAL_LIMIT_A = 4.3
_LED_AMPERES = (0.0069, 0.0071, 0.0063)
_BOARD_A = 0.9611


def led_total_a(steps: tuple[int, int, int]) -> float:
    """Estimate of the board's supply current at these LED currents, in amperes."""
    return _BOARD_A + sum(factor * step for factor, step in zip(_LED_AMPERES, steps, strict=True))


def packed_led_currents(steps: tuple[int, int, int]) -> bytes:
    """LED currents on the wire, where 255 is off. Raises SettingRefused for currents that can harm the board."""
    for name, step in zip(("red", "green", "blue"), steps, strict=True):
        if not 0 <= step <= LED_STEP_LIMIT:
            raise SettingRefused(
                f"LightCrafter: {name} LED current {step} is outside 0 … {LED_STEP_LIMIT}; after power-on it is "
                "104, 135, 130 (red, green, blue)"
            )
    total_a = led_total_a(steps)
    if total_a > LED_TOTAL_LIMIT_A:
        raise SettingRefused(
            f"LightCrafter: LED currents {steps} draw about {total_a:.2f} A, the limit is {LED_TOTAL_LIMIT_A} A; "
            "lower them"
        )
    return bytes(255 - step for step in steps)


def parse_led_currents(data: bytes) -> tuple[int, int, int]:
    """LED currents in steps, 0 off, larger brighter; as TI's own program shows them."""
    red, green, blue = (255 - value for value in data[:3])
    return red, green, blue
