"""Plugs an emulated USB device into this machine's own kernel: usbip without a network.

The kernel's vhci-hcd is a USB host controller whose ports lead to sockets. One end of a socket pair goes to the
kernel, which then finds the device, loads its driver and talks to it as to any other; the other end is served
here. Packets are those of the kernel's Documentation/usb/usbip_protocol.rst, big-endian.
"""

from __future__ import annotations

import errno
import os
import socket
import struct
import threading
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from io import BufferedReader
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

from rig.emulated.usbip.device import (
    HOST_READS,
    ISO_PACKET_BYTES,
    Bytes,
    Descriptors,
    Setup,
    Stall,
    StandardRequests,
    Transfer,
    UsbDevice,
    UsbSpeed,
)
from rig.errors import DeviceError, DeviceForbidden

__all__ = ["Attachment", "Descriptors", "Setup", "Stall", "Transfer", "UsbDevice", "UsbSpeed", "attach", "serve"]

CONTROLLER = Path("/sys/devices/platform/vhci_hcd.0")
_SUBMIT, _UNLINK, _SUBMITTED, _UNLINKED = 1, 2, 3, 4
_HEADER_BYTES = 48
_COMMAND = struct.Struct(">5I")
_SUBMIT_TAIL = struct.Struct(">IIIiI8s")
_SUBMIT_REPLY = struct.Struct(">5IiIIII8x")
_UNLINK_REPLY = struct.Struct(">5Ii24x")
_MOST_PACKETS = 1024
_SOCKET_BYTES = 4 << 20
"""Several frames: the device's threads do not wait for the kernel."""
_PORT_FREE = 4
_LOOK_AGAIN_S = 0.02
"""A device is known some 0.4 s after it was plugged in; by default it sleeps two seconds later."""
_JOIN_TIMEOUT_S = 30.0
"""Longer than any exposure that a thread may still wait for."""


class Attachment:
    """A device that is plugged in, until :meth:`unplug`, or until the host or this process lets go.

    Usable in a ``with`` statement, which unplugs.
    """

    def __init__(self, device: UsbDevice, link: socket.socket, port: int | None = None):
        self.port = port
        """Of the host controller; None when another program is the host."""
        self._device = device
        self._link = link
        self._standard = StandardRequests(device)
        self._pending: dict[int, Transfer] = {}
        self._lock = threading.Lock()
        self._server = threading.Thread(target=self._serve, name=f"usb port {port}")
        device.plugged()
        self._server.start()

    @property
    def alive(self) -> bool:
        """Whether the host still has the device."""
        return self._server.is_alive()

    def wait(self, longest_s: float) -> None:
        """Wait until the host has let go, or so long."""
        self._server.join(longest_s)

    def unplug(self) -> None:
        """Pull the cable; any number of times. The device's threads have ended when this returns."""
        with suppress(OSError):
            self._link.shutdown(socket.SHUT_RDWR)
        if threading.current_thread() is not self._server:
            self._server.join(_JOIN_TIMEOUT_S)

    def __enter__(self) -> Attachment:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.unplug()

    def _serve(self) -> None:
        try:
            with self._link, self._link.makefile("rb") as commands, suppress(OSError):
                while header := commands.read(_HEADER_BYTES):
                    self._obey(header, commands)
        finally:
            with self._lock:
                self._pending.clear()
            self._device.unplugged()

    def _obey(self, header: bytes, commands: BufferedReader) -> None:
        command, number, _, host_reads, endpoint = _COMMAND.unpack_from(_whole(header, _HEADER_BYTES))
        if command == _SUBMIT:
            self._submit(number, endpoint | (HOST_READS if host_reads else 0), header, commands)
        elif command == _UNLINK:
            self._unlink(number, int.from_bytes(header[20:24], "big"))
        else:
            raise ConnectionAbortedError(f"usbip command {command} of the host is not known")

    def _submit(self, number: int, endpoint: int, header: bytes, commands: BufferedReader) -> None:
        _, length, _, packet_count, _, setup = _SUBMIT_TAIL.unpack_from(header, _COMMAND.size)
        data = b"" if endpoint & HOST_READS else _whole(commands.read(length), length)
        if endpoint & ~HOST_READS == 0:
            self._control(number, Setup.parse(setup), data)
            return
        iso_bytes = ISO_PACKET_BYTES * packet_count if 0 < packet_count <= _MOST_PACKETS else 0
        table = _whole(commands.read(iso_bytes), iso_bytes)
        transfer = Transfer(
            number=number, endpoint=endpoint, length=length, data=data, packet_table=table, answer=self._answer
        )
        with self._lock:
            self._pending[number] = transfer
        self._device.submit(transfer)

    def _control(self, number: int, setup: Setup, data: bytes) -> None:
        try:
            reply = self._standard.answer(setup, data)
        except Stall:
            self._send(_submit_reply(number, -errno.EPIPE, 0))
            return
        if setup.host_reads:
            self._send(_submit_reply(number, 0, len(reply)), reply)
        else:
            self._send(_submit_reply(number, 0, len(data)))

    def _unlink(self, number: int, victim: int) -> None:
        with self._lock:
            found = self._pending.pop(victim, None) is not None
            self._write([_UNLINK_REPLY.pack(_UNLINKED, number, 0, 0, 0, -errno.ECONNRESET if found else 0)])

    def _answer(self, transfer: Transfer, data: Sequence[Bytes], status: int, packet_table: bytes) -> bool:
        """Send a transfer's result, unless the host has taken it back."""
        reads = bool(transfer.endpoint & HOST_READS)
        count = sum(map(len, data)) if reads else transfer.length
        packet_count = len(transfer.packet_table) // ISO_PACKET_BYTES
        reply = _submit_reply(transfer.number, status, count if status == 0 else 0, packet_count)
        with self._lock:
            if self._pending.pop(transfer.number, None) is None:
                return False
            try:
                self._write([reply, *(data if reads else ()), packet_table])
            except OSError:  # the cable is out
                return False
        return True

    def _send(self, *pieces: Bytes) -> None:
        with self._lock:
            self._write(pieces)

    def _write(self, pieces: Sequence[Bytes]) -> None:
        sent = self._link.sendmsg(pieces)
        if sent < sum(map(len, pieces)):
            self._link.sendall(b"".join(pieces)[sent:])


def _whole(data: bytes, length: int) -> bytes:
    if len(data) != length:
        raise ConnectionAbortedError(f"the host hung up after {len(data)} of {length} bytes")
    return data


def _submit_reply(number: int, status: int, length: int, packet_count: int = 0) -> bytes:
    return _SUBMIT_REPLY.pack(_SUBMITTED, number, 0, 0, 0, status, length, 0, packet_count, 0)


class _Port(NamedTuple):
    number: int
    is_free: bool
    is_super_speed: bool


def attach(device: UsbDevice, *, port: int | None = None) -> Attachment:
    """Plug a device into the kernel, into a free port or a certain one.

    Raises DeviceForbidden without root's rights, DeviceError when the kernel has no vhci-hcd or no free port.
    """
    for number in [port] if port is not None else _free_ports():
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        with ExitStack() as undo, theirs:
            undo.callback(ours.close)
            for end in (ours, theirs):
                end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SOCKET_BYTES)
            if _connect(number, theirs, device.speed):
                undo.pop_all()
                attachment = Attachment(device, ours, number)
                threading.Thread(target=_keep_awake, args=(attachment, number), name=f"usb port {number} awake").start()
                return attachment
    raise DeviceError(f"no free USB port in {CONTROLLER}: unplug another emulated device")


def _keep_awake(attachment: Attachment, port: int) -> None:
    """Tell the kernel, as soon as it knows the device, never to put it to sleep.

    vhci-hcd keeps one note for all its ports of which port wakes up (Linux 6.12): while another device is plugged in or
    out the note gets lost, and the device that was to wake up is taken for a new one. A thread of its own, because the
    kernel takes the word only when the device has answered all that a new one is asked.
    """
    while attachment.alive:
        for delay in CONTROLLER.glob(f"usb*/*-{port + 1}/power/autosuspend_delay_ms"):
            with suppress(OSError):  # it has gone meanwhile
                delay.write_text("-1")
                return
        attachment.wait(_LOOK_AGAIN_S)


def serve(device: UsbDevice, link: socket.socket) -> Attachment:
    """Serve a device to any host that speaks usbip at the other end of a stream socket; takes the socket over."""
    return Attachment(device, link)


def _free_ports() -> list[int]:
    try:
        status = (CONTROLLER / "status").read_text()
    except OSError as error:
        raise DeviceError(f"this kernel emulates no USB port ({error}); as root: modprobe vhci-hcd") from error
    return [port.number for port in _ports(status) if port.is_free and not port.is_super_speed]


def _ports(status: str) -> list[_Port]:
    """What the controller's `status` says: a headline, then hub, port, state, … a line each."""
    rows = [line.split() for line in status.splitlines()[1:] if line.strip()]
    return [_Port(int(row[1]), int(row[2]) == _PORT_FREE, row[0] == "ss") for row in rows]


def _connect(port: int, theirs: socket.socket, speed: UsbSpeed) -> bool:
    """Give the kernel its end. False when another program was faster."""
    request = f"{port} {theirs.fileno()} {0x10001 + port} {int(speed)}"
    try:
        descriptor = os.open(CONTROLLER / "attach", os.O_WRONLY)
    except PermissionError as error:
        raise DeviceForbidden(f"plugging in an emulated device needs root's rights: {error}; use sudo") from error
    except OSError as error:
        raise DeviceError(f"this kernel emulates no USB port ({error}); as root: modprobe vhci-hcd") from error
    try:
        os.write(descriptor, request.encode())
    except OSError as error:
        if error.errno == errno.EBUSY:
            return False
        raise DeviceError(f"the kernel refuses a USB device at port {port}: {error}; look at dmesg") from error
    finally:
        os.close(descriptor)
    return True
