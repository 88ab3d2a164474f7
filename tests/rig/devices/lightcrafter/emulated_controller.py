"""An emulated DLP LightCrafter 4500: answers the commands of its controller, and says no where the guide says so.

A second, independent reading of the public descriptions: it shares no code with the driver that it tests.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from rig.devices.protocols import Clock
from rig.errors import DeviceLost

MESSAGE_LIMIT = 512
REPORT = 64
VERSION = (4 << 24 | 0 << 16 | 0).to_bytes(4, "little")
MODE_DELAY, CHECK_DELAY = 3, 2
"""How many messages a change of mode, and a check of a sequence, outlast."""


@dataclass(kw_only=True)
class LightCrafterFaults:
    """What goes wrong; may be changed at any time."""

    silent: bool = False
    refused: set[int] = field(default_factory=set)
    """Commands that are answered by NACK."""
    ignored: set[int] = field(default_factory=set)
    """Writes that are acknowledged and not done."""
    short_answers: bool = False
    babble: bool = False
    """Reports without a request."""
    hardware_status: int = 0x01


@dataclass(kw_only=True)
class _Registers:
    power: int = 0
    source: int = 0x08
    led_polarity: int = 0
    led_enable: int = 0x08
    led_currents: bytes = bytes([151, 120, 125])
    gamma: int = 0x80
    mode: int = 0
    running: int = 0
    pattern_source: int = 3
    trigger: int = 1
    trigger_out_1: bytes = bytes([0, 0xBB, 0xBB])
    trigger_out_2: bytes = bytes([0, 0xBB])
    times: bytes = bytes(8)
    control: bytes = bytes(4)
    mailbox: int = 0
    offset: int = 0
    table: bytes = bytes(384)
    valid: int | None = None


Reader = Callable[[], bytes]
Writer = Callable[[bytes], bool]


class LightCrafterEmulation:
    """The controller: reports of 64 bytes go in by `receive`, answers come out by `next_report`. Thread-safe."""

    def __init__(self) -> None:
        self.faults = LightCrafterFaults()
        self.registers = _Registers()
        self.history: list[tuple[int, bytes]] = []
        """Each write that was carried out: command, data."""
        self._lock = threading.Lock()
        self._answers: deque[bytes] = deque()
        self._partial = b""
        self._pending: tuple[int, int] | None = None
        self._pending_check = 0
        self._readers = self._make_readers()
        self._writers = self._make_writers()

    def receive(self, report: bytes) -> None:
        """Take one output report."""
        with self._lock:
            if len(report) != REPORT:
                return
            self._partial += report
            length = 4 + int.from_bytes(self._partial[2:4], "little")
            if not 6 <= length <= MESSAGE_LIMIT:
                self._answer(self._partial[0], self._partial[1], b"", refused=True)
                self._partial = b""
            elif len(self._partial) >= length:
                message, self._partial = self._partial[:length], b""
                self._message(message)

    def next_report(self) -> bytes | None:
        """Give the next input report, or None."""
        with self._lock:
            if self.faults.babble:
                return bytes(range(REPORT))
            return self._answers.popleft() if self._answers else None

    def _message(self, message: bytes) -> None:
        flags, sequence, data = message[0], message[1], message[6:]
        command = message[5] << 8 | message[4]
        self._age()
        if self.faults.silent:
            return
        asleep = self.registers.power and command not in (0x0200, 0x1A0A, 0x1A0B, 0x1A0C)
        if flags & 0x3F or command in self.faults.refused or asleep:
            return self._answer(flags, sequence, b"", refused=True)
        if flags & 0x80:
            reader = self._readers.get(command)
            answer = reader() if reader and not data else None
            return self._answer(flags, sequence, answer or b"", refused=answer is None)
        done = self._write(command, data)
        if flags & 0x40:
            self._answer(flags, sequence, b"", refused=not done)
        return None

    def _write(self, command: int, data: bytes) -> bool:
        writer = self._writers.get(command)
        if writer is None:
            return False
        if command in self.faults.ignored:
            return True
        done = writer(data)
        if done:
            self.history.append((command, data))
        return done

    def _answer(self, flags: int, sequence: int, data: bytes, *, refused: bool) -> None:
        if self.faults.short_answers:
            data = data[:0]
        head = bytes([flags & 0xC0 | (0x20 if refused else 0), sequence]) + len(data).to_bytes(2, "little")
        whole = head + data
        whole += bytes(-len(whole) % REPORT)
        self._answers.extend(whole[at : at + REPORT] for at in range(0, len(whole), REPORT))

    def _make_readers(self) -> dict[int, Reader]:
        at = self.registers

        def table() -> bytes:
            return at.table[3 * at.offset :][: 3 * (at.control[0] + 1)] if at.mailbox == 2 else b""

        return {
            0x0200: lambda: bytes([at.power]),
            0x0205: lambda: VERSION * 4,
            0x0B01: lambda: at.led_currents,
            0x1A00: lambda: bytes([at.source]),
            0x1A05: lambda: bytes([at.led_polarity]),
            0x1A07: lambda: bytes([at.led_enable]),
            0x1A0A: lambda: bytes([self.faults.hardware_status]),
            0x1A0B: lambda: b"\1",
            0x1A0C: lambda: bytes([(at.power and 1) | (not at.power) << 1 | (at.gamma >> 7) << 3]),
            0x1A0E: lambda: bytes([at.gamma]),
            0x1A1A: self._checked,
            0x1A1B: lambda: bytes([at.mode]),
            0x1A1D: lambda: at.trigger_out_1,
            0x1A1E: lambda: at.trigger_out_2,
            0x1A22: lambda: bytes([at.pattern_source]),
            0x1A23: lambda: bytes([at.trigger]),
            0x1A24: lambda: bytes([at.running]),
            0x1A29: lambda: at.times,
            0x1A31: lambda: at.control,
            0x1A32: lambda: bytes([at.offset]),
            0x1A33: lambda: bytes([at.mailbox]),
            0x1A34: table,
        }

    def _make_writers(self) -> dict[int, Writer]:
        return {
            0x0200: self._byte("power", (0, 1)),
            0x0B01: self._bytes("led_currents", 3),
            0x1A00: self._byte("source", range(0x30)),
            0x1A05: self._byte("led_polarity", (0, 1)),
            0x1A07: self._byte("led_enable", range(16)),
            0x1A0E: self._gamma,
            0x1A1A: self._start_check,
            0x1A1B: self._change_mode,
            0x1A1D: self._stopped(self._bytes("trigger_out_1", 3)),
            0x1A1E: self._stopped(self._bytes("trigger_out_2", 2)),
            0x1A22: self._stopped(self._byte("pattern_source", (0, 3))),
            0x1A23: self._stopped(self._byte("trigger", range(5))),
            0x1A24: self._run,
            0x1A29: self._stopped(self._bytes("times", 8)),
            0x1A31: self._stopped(self._bytes("control", 4)),
            0x1A32: self._byte("offset", range(128)),
            0x1A33: self._stopped(self._byte("mailbox", range(4))),
            0x1A34: self._stopped(self._fill_table),
        }

    def _byte(self, name: str, allowed: range | tuple[int, ...]) -> Writer:
        def write(data: bytes) -> bool:
            if len(data) != 1 or data[0] not in allowed:
                return False
            setattr(self.registers, name, data[0])
            return True

        return write

    def _bytes(self, name: str, length: int) -> Writer:
        def write(data: bytes) -> bool:
            if len(data) != length:
                return False
            setattr(self.registers, name, data)
            return True

        return write

    def _stopped(self, writer: Writer) -> Writer:
        """What may only be changed while no sequence runs, and makes a new check necessary."""

        def write(data: bytes) -> bool:
            if self.registers.running == 2:
                return False
            self.registers.valid = None
            return writer(data)

        return write

    def _gamma(self, data: bytes) -> bool:
        if len(data) != 1 or data[0] & 0x7E or self.registers.mode:
            return False
        self.registers.gamma = data[0]
        return True

    def _change_mode(self, data: bytes) -> bool:
        if len(data) != 1 or data[0] > 1:
            return False
        self._pending = (MODE_DELAY, data[0])
        return True

    def _age(self) -> None:
        """Changes that take a while come nearer with every message."""
        if self._pending is not None:
            left, mode = self._pending
            self._pending = (left - 1, mode) if left else None
            if not left:
                self.registers.mode, self.registers.running = mode, 0
        if self._pending_check:
            self._pending_check -= 1
            self.registers.valid = None if self._pending_check else self._verdict()

    def _fill_table(self, data: bytes) -> bool:
        at, start = self.registers, 3 * self.registers.offset
        if at.mailbox != 2 or not data or len(data) % 3 or start + len(data) > len(at.table):
            return False
        at.table = at.table[:start] + data + at.table[start + len(data) :]
        return True

    def _start_check(self, data: bytes) -> bool:
        if len(data) != 1 or self.registers.running == 2 or not self.registers.mode:
            return False
        self._pending_check, self.registers.valid = CHECK_DELAY, None
        return True

    def _checked(self) -> bytes:
        return bytes([0x80 if self.registers.valid is None else self.registers.valid])

    def _verdict(self) -> int:
        at = self.registers
        exposure, period = (int.from_bytes(at.times[half : half + 4], "little") for half in (0, 4))
        entries = [at.table[3 * index : 3 * index + 3] for index in range(at.control[0] + 1)]
        bad_time = bad_number = False
        for first, second, _ in entries:
            depth, number = second & 0x0F, first >> 2
            shortest = (0, 235, 700, 1570, 1700, 2000, 2500, 4500, 8333)[depth] if depth <= 8 else 0
            bad_time |= exposure < shortest or exposure > period
            bad_number |= not 1 <= depth <= 8 or (number + 1) * depth > 24
        near = exposure != period and period - exposure < 230
        return bad_time | bad_number << 1 | near << 4

    def _run(self, data: bytes) -> bool:
        at = self.registers
        if len(data) != 1 or data[0] > 2:
            return False
        if data[0] == 2 and (not at.mode or at.valid is None or at.valid & 3):
            return False
        at.running = data[0]
        return True


class InProcessTransport:
    """Exchanges reports with an emulated controller without USB; a :class:`rig.devices.usb.hid.HidTransport`.

    Set ``unplugged`` to pull the cable.
    """

    def __init__(self, device: LightCrafterEmulation, clock: Clock):
        self.device = device
        self.clock = clock
        self.unplugged = False
        self.closed = 0
        """How often it was closed."""

    def write_report(self, report: bytes) -> None:
        """Give the controller a report. Raises DeviceLost when unplugged."""
        self._check_plugged()
        self.device.receive(report)

    def read_report(self, timeout_s: float) -> bytes | None:
        """Return the next report, or None after the time. Raises DeviceLost when unplugged."""
        self._check_plugged()
        report = self.device.next_report()
        if report is None:
            self.clock.wait_until_s(self.clock.now_s() + timeout_s)
        return report

    def close(self) -> None:
        """Count it."""
        self.closed += 1

    def _check_plugged(self) -> None:
        if self.unplugged:
            raise DeviceLost("the emulated LightCrafter is unplugged; plug it in again")
