"""A USB host made of a socket: what the kernel's vhci-hcd would send, made by hand."""

import socket
import struct
from dataclasses import dataclass, field

from rig.emulated.usbip.device import (
    IsoPacket,
    pack_packets,
    parse_packets,
)


@dataclass(frozen=True)
class HostReply:
    status: int
    data: bytes
    packets: list[IsoPacket] = field(default_factory=list)


class Host:
    """The other end of the cable: what vhci-hcd would send, made by hand."""

    def __init__(self, link: socket.socket):
        link.settimeout(20)
        self.link = link
        self.number = 0
        self.reads: dict[int, bool] = {}

    def command(self, direction: int, endpoint: int, length: int, setup: bytes = bytes(8), packets: int = 0) -> int:
        self.number += 1
        self.reads[self.number] = bool(direction)
        head = struct.pack(">5I", 1, self.number, 0x10001, direction, endpoint)
        self.link.sendall(head + struct.pack(">IIIiI", 0, length, 0, packets, 1) + setup)
        return self.number

    def unlink(self, victim: int) -> int:
        self.number += 1
        self.link.sendall(struct.pack(">5II24x", 2, self.number, 0x10001, 0, 0, victim))
        return self.number

    def receive(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            piece = self.link.recv(count - len(data))
            if not piece:
                raise ConnectionError("the device hung up")
            data += piece
        return data

    def reply(self) -> tuple[int, HostReply]:
        """Number of the command that it answers, and the answer."""
        command, number, _, _, _, status, length, _, count, _ = struct.unpack(">5IiIIII8x", self.receive(48))
        if command == 4:
            return number, HostReply(status, b"")
        assert command == 3
        data = self.receive(length) if self.reads[number] else b""
        return number, HostReply(status, data, parse_packets(self.receive(16 * count)))

    def control(self, asked: tuple[int, int, int, int], data: bytes | int = 0) -> HostReply:
        """Ask by (request type, request, value, index); ``data`` to write, or how many bytes to read."""
        length = data if isinstance(data, int) else len(data)
        setup = struct.pack("<BBHHH", *asked, length)
        number = self.command(asked[0] >> 7, 0, length, setup)
        if isinstance(data, bytes):
            self.link.sendall(data)
        answered, reply = self.reply()
        assert answered == number
        return reply

    def submit_iso(self, count: int = 32, size: int = 3072) -> int:
        number = self.command(1, 1, count * size, packets=count)
        self.link.sendall(pack_packets(IsoPacket(index * size, size) for index in range(count)))
        return number
