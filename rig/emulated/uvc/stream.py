"""From a frame to the bytes on the cable: payload headers, packets, and transfers that wait for them."""

from __future__ import annotations

import threading
import time
from collections import deque
from enum import IntFlag
from functools import lru_cache
from typing import Protocol

import numpy as np

from rig.emulated.usbip.device import ISO_PACKET_BYTES as TABLE_ROW_BYTES
from rig.emulated.usbip.device import IsoPacket, Transfer, pack_packets, parse_packets
from rig.emulated.uvc.descriptors import ISO_PACKET_BYTES, PAYLOAD_HEADER_BYTES, Transport

_ROOM_BYTES = ISO_PACKET_BYTES - PAYLOAD_HEADER_BYTES


class PayloadFlag(IntFlag):
    """Bits of a payload's header."""

    FRAME_PARITY = 0x01
    """Toggles with each frame."""
    END_OF_FRAME = 0x02
    ERROR = 0x40
    END_OF_HEADER = 0x80


class Parcel(Protocol):
    """A frame on its way."""

    @property
    def is_begun(self) -> bool:
        """Whether some of it is sent."""
        ...

    @property
    def is_sent(self) -> bool:
        """Whether all of it is."""
        ...

    def send(self, transfer: Transfer) -> None:
        """Answer a transfer with the next piece; a transfer that the host took back changes nothing."""
        ...


class IsochronousParcel:
    """A frame in packets of 3072 bytes, each with its header."""

    def __init__(self, frame: bytes, flags: int):
        count = max(1, -(-len(frame) // _ROOM_BYTES))
        packets = np.empty((count, ISO_PACKET_BYTES), np.uint8)
        packets[:, 0] = PAYLOAD_HEADER_BYTES
        packets[:, 1] = flags | PayloadFlag.END_OF_HEADER
        packets[-1, 1] |= PayloadFlag.END_OF_FRAME
        pixels = np.frombuffer(frame, np.uint8)
        full = (count - 1) * _ROOM_BYTES
        packets[:-1, PAYLOAD_HEADER_BYTES:] = pixels[:full].reshape(count - 1, _ROOM_BYTES)
        packets[-1, PAYLOAD_HEADER_BYTES : PAYLOAD_HEADER_BYTES + len(frame) - full] = pixels[full:]
        length = full + len(frame) - full + count * PAYLOAD_HEADER_BYTES
        self._bytes = packets.reshape(-1).data[:length]
        self._position = 0

    @property
    def is_begun(self) -> bool:
        """Whether some of it is sent."""
        return self._position > 0

    @property
    def is_sent(self) -> bool:
        """Whether all of it is."""
        return self._position >= len(self._bytes)

    def send(self, transfer: Transfer) -> None:
        """Fill as many packets of a transfer as there are."""
        room = len(transfer.packet_table) // TABLE_ROW_BYTES * ISO_PACKET_BYTES
        piece = self._bytes[self._position : self._position + room]
        if transfer.complete(piece, packet_table=_filled_table(transfer.packet_table, len(piece))):
            self._position += len(piece)


@lru_cache(maxsize=64)
def _filled_table(table: bytes, length: int) -> bytes:
    """The table of a transfer whose packets are full until ``length`` bytes are used up."""
    left = length
    filled = []
    for packet in parse_packets(table):
        used = min(packet.length, left, ISO_PACKET_BYTES)
        filled.append(IsoPacket(packet.offset, packet.length, used))
        left -= used
    return pack_packets(filled)


class BulkParcel:
    """A frame behind one header; a transfer that is not full ends it."""

    def __init__(self, frame: bytes, flags: int, payload_bytes: int):
        header = bytes([PAYLOAD_HEADER_BYTES, flags | PayloadFlag.END_OF_HEADER | PayloadFlag.END_OF_FRAME])
        self._bytes = memoryview(header + frame)
        self._position = 0
        self._needs_end = len(self._bytes) < payload_bytes

    @property
    def is_begun(self) -> bool:
        """Whether some of it is sent."""
        return self._position > 0

    @property
    def is_sent(self) -> bool:
        """Whether all of it is."""
        return self._position >= len(self._bytes) and not self._needs_end

    def send(self, transfer: Transfer) -> None:
        """Fill a transfer, or as much as there is."""
        piece = self._bytes[self._position : self._position + transfer.length]
        if transfer.complete(piece):
            self._position += len(piece)
            self._needs_end = self._needs_end and len(piece) == transfer.length


class Sender:
    """Brings frames and the host's transfers together; used by the thread that exposes and by the one that listens."""

    def __init__(self, transport: Transport):
        self.last_picture = b""
        """Of the last frame that was sent, or at least begun."""
        self._transport = transport
        self._transfers: deque[Transfer] = deque()
        self._parcel: Parcel | None = None
        self._picture = b""
        self._begin_until_s = 0.0
        self._parity = 0
        self._lock = threading.Lock()

    def submit(self, transfer: Transfer) -> None:
        """A transfer to fill."""
        with self._lock:
            self._transfers.append(transfer)
            self._pump()

    def send(
        self, picture: bytes, payload_bytes: int, *, begin_until_s: float, error: bool = False, torn: bool = False
    ) -> bool:
        """Send a frame, or (torn) half of it, if that can begin in time.

        False when it is lost, as another one is still on its way.
        """
        with self._lock:
            self._drop_late()
            if self._parcel is not None:
                return False
            self._picture, self._begin_until_s = picture, begin_until_s
            frame = picture[: len(picture) // 2] if torn else picture
            flags = self._parity | (PayloadFlag.ERROR if error else 0)
            self._parity ^= PayloadFlag.FRAME_PARITY
            if self._transport is Transport.ISOCHRONOUS:
                self._parcel = IsochronousParcel(frame, flags)
            else:
                self._parcel = BulkParcel(frame, flags, payload_bytes)
            self._pump()
            return True

    def clear(self) -> None:
        """Forget the frame and all transfers: the host has stopped."""
        with self._lock:
            self._transfers.clear()
            self._parcel = None
            self.last_picture = b""

    def _drop_late(self) -> None:
        """Hosts time a frame by its arrival: one that comes late would look younger than it is."""
        if self._parcel is not None and not self._parcel.is_begun and time.monotonic() > self._begin_until_s:
            self._parcel = None

    def _pump(self) -> None:
        self._drop_late()
        while self._parcel is not None and self._transfers:
            self._parcel.send(self._transfers.popleft())
            if self._parcel.is_begun:
                self.last_picture = self._picture
            if self._parcel.is_sent:
                self._parcel = None
