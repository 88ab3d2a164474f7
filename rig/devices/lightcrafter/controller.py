"""A DLP LightCrafter 4500 (controller DLPC350) over USB HID.

Written from public descriptions of TI's programmer's guide (DLPU010), tested against an emulation, **never seen on
real hardware**. Everything that is set is read back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rig.devices.lightcrafter import protocol
from rig.devices.lightcrafter.protocol import Command, DisplayMode, MainStatus, Run, StoredPattern, Version
from rig.devices.protocols import Clock
from rig.devices.usb.hid import HidTransport, find_hid_device, open_hid
from rig.errors import DeviceError, DeviceLost, SettingRefused

_POLL_S = 0.1
"""Between two questions whether it has done what it was told."""
_STALE_REPORTS = 32
"""How many old reports are thrown away before the device is said to babble."""


@dataclass(frozen=True, slots=True)
class LightCrafterState:
    """What is put back when the rig lets go."""

    led_currents: tuple[int, int, int]
    gamma: int
    leds: int


def open_lightcrafter(serial: str | None, clock: Clock) -> LightCrafter:
    """Open the LightCrafter that is plugged in, or the one with a serial number.

    Raises DeviceLost, DeviceForbidden, DeviceBusy.
    """
    device = find_hid_device(protocol.VENDOR_ID, protocol.PRODUCT_ID, serial)
    return LightCrafter(open_hid(device), clock)


class LightCrafter:
    """The controller's commands; methods raise DeviceLost when it is silent or gone, SettingRefused when it says no.

    Parameters
    ----------
    transport
        Open; is closed with this object.
    clock
        For waiting between polls.
    reply_timeout_s
        For one answer.
    settle_timeout_s
        For a change of mode.
    """

    def __init__(
        self, transport: HidTransport, clock: Clock, *, reply_timeout_s: float = 1.0, settle_timeout_s: float = 5.0
    ):
        self._transport = transport
        self._clock = clock
        self._reply_timeout_s = reply_timeout_s
        self._settle_timeout_s = settle_timeout_s
        self._sequence = 0

    def close(self) -> None:
        """Let the device go as it is; any number of times."""
        self._transport.close()

    def version(self) -> Version:
        """Version of the application software."""
        return protocol.parse_version(self._read(Command.SOFTWARE_VERSION, 16))

    def main_status(self) -> MainStatus:
        """Return what the controller does now."""
        return protocol.parse_main_status(self._read(Command.MAIN_STATUS, 1)[0])

    def check_hardware(self) -> None:
        """Raise DeviceError when the controller reports a fault."""
        problems = protocol.hardware_problems(self._read(Command.HARDWARE_STATUS, 1)[0])
        if not self._read(Command.SYSTEM_STATUS, 1)[0] & 1:
            problems += ("memory test failed",)
        if problems:
            raise DeviceError(f"LightCrafter reports: {', '.join(problems)}; switch it off and on")

    def wake(self) -> None:
        """Leave standby, if it is in it."""
        if self._read(Command.POWER, 1)[0] & 0x03:
            self._write(Command.POWER, b"\0")
            self._await("leaving standby", lambda: not self._read(Command.POWER, 1)[0] & 0x03)

    def standby(self) -> None:
        """Park the mirrors and save power."""
        self._write(Command.POWER, b"\1")
        self._await("standby", lambda: bool(self._read(Command.POWER, 1)[0] & 0x03))

    def display_mode(self) -> DisplayMode:
        """Video or patterns."""
        return DisplayMode(self._read(Command.DISPLAY_MODE, 1)[0] & 1)

    def set_display_mode(self, mode: DisplayMode) -> None:
        """Switch between video and patterns; stops a running sequence first."""
        now = self.display_mode()
        if now is DisplayMode.PATTERN:
            self.run(Run.STOP)
        if now is not mode:
            self._write(Command.DISPLAY_MODE, bytes([mode]))
            self._await(f"display mode {mode.name}", lambda: self.display_mode() is mode)

    def gamma_off(self) -> None:
        """Make codes linear light; video mode only. It comes back when the device is switched off."""
        self._set(Command.GAMMA, b"\0")
        self._await("gamma off", lambda: not self.main_status().gamma_on)

    def led_currents(self) -> tuple[int, int, int]:
        """LED currents (red, green, blue) in steps: 0 off, larger brighter."""
        return protocol.parse_led_currents(self._read(Command.LED_CURRENTS, 3))

    def set_led_currents(self, steps: tuple[int, int, int]) -> None:
        """Set the LED currents. Refuses what can harm the board, and boards whose polarity was changed."""
        wire = protocol.packed_led_currents(steps)
        if self._read(Command.LED_POLARITY, 1)[0] & 1:
            raise SettingRefused(
                "LightCrafter: the LED polarity was changed from its default, so that a current's meaning is not "
                "known; restore the default firmware settings"
            )
        self._set(Command.LED_CURRENTS, wire)

    def leds_by_sequencer(self) -> None:
        """Light each colour's LED while that colour is shown."""
        self._set(Command.LED_ENABLE, bytes([protocol.LEDS_BY_SEQUENCER]))

    def set_trigger_out_1(self, rising_delay_s: float = 0.0, falling_delay_s: float = 0.0) -> None:
        """Trigger out 1: high while a pattern is shown, its edges moved by -20.05 … +2.787 µs."""
        edges = [protocol.trigger_delay(delay_s) for delay_s in (rising_delay_s, falling_delay_s)]
        self._set(Command.TRIGGER_OUT_1, bytes([0, *edges]))

    def set_trigger_out_2(self, rising_delay_s: float = 0.0) -> None:
        """Trigger out 2: a pulse at the start of a sequence, moved by -20.05 … +2.787 µs."""
        self._set(Command.TRIGGER_OUT_2, bytes([0, protocol.trigger_delay(rising_delay_s)]))

    def run(self, state: Run) -> None:
        """Stop, pause or start the pattern sequence; asks again until it obeys."""

        def obeys() -> bool:
            if self._read(Command.PATTERN_RUN, 1)[0] & 0x03 == state:
                return True
            self._write(Command.PATTERN_RUN, bytes([state]))
            return False

        self._await(f"pattern sequence {state.name}", obeys)

    def set_up_patterns(
        self, patterns: list[StoredPattern], *, exposure_us: int, frame_period_us: int, refresh_rate_hz: float
    ) -> tuple[str, ...]:
        """Set up a sequence of patterns from streamed video, started by each VSYNC; `run` starts it.

        Parameters
        ----------
        patterns
            1 … 128; the first with the trigger EXTERNAL_POSITIVE, the others CONTINUE.
        exposure_us, frame_period_us
            Of each pattern. [µs]
        refresh_rate_hz
            Of the video signal; all patterns have to fit into its period.

        Returns
        -------
        What the controller finds doubtful, in words.

        Raises
        ------
        SettingRefused
            What the controller cannot show, or finds invalid.
        """
        entries, times = _checked(patterns, exposure_us, frame_period_us, refresh_rate_hz)
        self.set_display_mode(DisplayMode.PATTERN)
        self.run(Run.STOP)
        self._set(Command.PATTERN_SOURCE, b"\0")
        self._set(Command.PATTERN_TRIGGER, bytes([protocol.PatternTrigger.VSYNC]))
        self._set(Command.LUT_CONTROL, bytes([len(patterns) - 1, 1, len(patterns) - 1, 0]))
        self._set(Command.PATTERN_TIMES, times)
        self._send_lut(entries)
        return self.validate()

    def validate(self) -> tuple[str, ...]:
        """Have the sequence checked; returns what is doubtful. Raises SettingRefused when it is invalid."""
        self._write(Command.VALIDATE, b"\0")
        self._await("validation", lambda: not self._read(Command.VALIDATE, 1)[0] & 0x80)
        invalid, doubtful = protocol.validation(self._read(Command.VALIDATE, 1)[0])
        if invalid:
            raise SettingRefused(
                f"LightCrafter finds the sequence invalid: {', '.join(invalid)}; "
                "change what is named, or show fewer patterns"
            )
        return doubtful

    def state(self) -> LightCrafterState:
        """Return what `restore` puts back."""
        gamma, leds = (self._read(command, 1)[0] for command in (Command.GAMMA, Command.LED_ENABLE))
        return LightCrafterState(self.led_currents(), gamma, leds)

    def prepare_video(self, led_currents: tuple[int, int, int] | None) -> None:
        """Make it a linear projector: video mode, LEDs by the sequencer, gamma off, LED currents set.

        None leaves the LED currents. It has to be awake.
        """
        self.set_display_mode(DisplayMode.VIDEO)
        self.leds_by_sequencer()
        self.gamma_off()
        if led_currents is not None:
            self.set_led_currents(led_currents)

    def restore(self, state: LightCrafterState) -> None:
        """Video mode, with the LED currents, LED control and gamma that were found."""
        self.set_display_mode(DisplayMode.VIDEO)
        self._write(Command.LED_CURRENTS, bytes(255 - step for step in state.led_currents))
        self._write(Command.GAMMA, bytes([state.gamma]))
        self._write(Command.LED_ENABLE, bytes([state.leds]))

    def _send_lut(self, entries: bytes) -> None:
        self._write(Command.LUT_ACCESS, b"\2")
        try:
            self._write(Command.LUT_OFFSET, b"\0")
            self._write(Command.LUT_DATA, entries)
            self._write(Command.LUT_OFFSET, b"\0")
            self._compare(Command.LUT_DATA, entries)
        finally:
            self._write(Command.LUT_ACCESS, b"\0")

    def _set(self, command: Command, data: bytes) -> None:
        self._write(command, data)
        self._compare(command, data)

    def _compare(self, command: Command, data: bytes) -> None:
        done = self._read(command, len(data))
        if done != data:
            raise SettingRefused(
                f"LightCrafter: {command.name} was set to {data.hex(' ')}, but reads {done.hex(' ')}; "
                "end other programs that control it"
            )

    def _read(self, command: Command, length: int) -> bytes:
        reply = self._exchange(command, b"", reading=True)
        data = reply.data
        while len(data) < reply.length:
            more = self._transport.read_report(self._reply_timeout_s)
            if more is None:
                raise self._silent(command)
            data += more
        if reply.length < length:
            raise DeviceError(
                f"LightCrafter: {command.name} answered with {reply.length} bytes, expected {length}; "
                "is its firmware at least 2.0?"
            )
        return data[:length]

    def _write(self, command: Command, data: bytes) -> None:
        self._exchange(command, data, reading=False)

    def _exchange(self, command: Command, data: bytes, *, reading: bool) -> protocol.Reply:
        self._drain()
        self._sequence = self._sequence % 255 + 1
        for report in protocol.request(command, data, sequence=self._sequence, reading=reading):
            self._transport.write_report(report)
        reply = self._reply(command)
        if reply.refused:
            verb = "reading" if reading else f"the value {data.hex(' ')} for"
            raise SettingRefused(f"LightCrafter refuses {verb} {command.name}; is its firmware at least 2.0?")
        return reply

    def _reply(self, command: Command) -> protocol.Reply:
        """The answer to the last request; older answers are thrown away."""
        deadline_s = self._clock.now_s() + self._reply_timeout_s
        for _ in range(_STALE_REPORTS):
            report = self._transport.read_report(deadline_s - self._clock.now_s())
            if report is None:
                break
            reply = protocol.parse_reply(report)
            if reply.sequence == self._sequence:
                return reply
        raise self._silent(command)

    def _drain(self) -> None:
        for _ in range(_STALE_REPORTS):
            if self._transport.read_report(0.0) is None:
                return
        raise DeviceError("LightCrafter sends reports without being asked; switch it off and on")

    def _silent(self, command: Command) -> DeviceLost:
        return DeviceLost(
            f"LightCrafter gave no answer to {command.name} within {self._reply_timeout_s:g} s; switch it off and on"
        )

    def _await(self, what: str, done: Callable[[], bool]) -> None:
        deadline_s = self._clock.now_s() + self._settle_timeout_s
        while not done():
            if self._clock.now_s() >= deadline_s:
                raise SettingRefused(
                    f"LightCrafter: {what} not reached within {self._settle_timeout_s:g} s; switch it off and on"
                )
            self._clock.wait_until_s(self._clock.now_s() + _POLL_S)


def _checked(
    patterns: list[StoredPattern], exposure_us: int, frame_period_us: int, refresh_rate_hz: float
) -> tuple[bytes, bytes]:
    """The look-up table's and the times' bytes. Raises SettingRefused."""
    if not 1 <= len(patterns) <= protocol.LONGEST_LUT:
        raise SettingRefused(f"LightCrafter: {len(patterns)} patterns; it has to be 1 … {protocol.LONGEST_LUT}")
    entries = b"".join(pattern.packed() for pattern in patterns)
    times = protocol.packed_times(exposure_us, frame_period_us, patterns)
    total_us, available_us = len(patterns) * frame_period_us, 1e6 / refresh_rate_hz
    if total_us > available_us:
        raise SettingRefused(
            f"LightCrafter: {len(patterns)} patterns of {frame_period_us} µs last {total_us} µs, a video frame at "
            f"{refresh_rate_hz:g} Hz only {available_us:.0f} µs; show fewer, or lower their bit depth"
        )
    return entries, times
