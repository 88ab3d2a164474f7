"""Streaming: buffers of the driver in our memory, filled, looked at, and given back."""

from __future__ import annotations

import errno
import math
import mmap
import select
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import numpy as np

from rig.devices.protocols import Clock
from rig.devices.v4l2 import abi
from rig.devices.v4l2.formats import Bytes
from rig.devices.v4l2.node import BUSY, GONE, Node, device_error
from rig.errors import DeviceError

BUFFERS = 4
"""One that fills, one that is read, two in reserve; more would only hold older frames."""
_LONGEST_POLL_S = 60.0
"""Longer waits are several; poll's own limit is 24 days."""
_HALF = 1 << 31


class StreamBroken(DeviceError):
    """The driver gave up this stream, but is still there; a new stream may run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Filled:
    """A buffer that the driver has filled; it has to be given back."""

    index: int
    bytes_used: int
    has_error: bool
    flags: int
    stamp_s: float
    number: int
    """The driver's sequence, made to count on over overflow and restart."""
    lost: int
    """Frames that the driver skipped just before although it had an empty buffer."""
    unseen: int
    """Frames that it skipped just before as it had none."""


class Stream:
    """Capturing with memory-mapped buffers. Give every filled buffer back; stop before closing the node."""

    def __init__(self, node: Node, clock: Clock):
        self._node = node
        self._clock = clock
        self._maps: list[mmap.mmap] = []
        self._given_s: list[float] = []
        self._number = 0
        self._last: tuple[int, float] | None = None
        self._poll = select.poll()
        self._has_buffers = False

    def start(self) -> None:
        """Ask for buffers, give them to the driver, and let the frames come. Raises DeviceError."""
        wanted = abi.RequestBuffers(count=BUFFERS, type=abi.VIDEO_CAPTURE, memory=abi.MEMORY_MMAP)
        granted = self._node.call(abi.REQBUFS, wanted, "asking for buffers", BUSY)
        self._has_buffers = True
        self._last = None
        for index in range(granted.count):
            buffer = self._node.call(abi.QUERYBUF, self._buffer(index), "asking where a buffer is")
            self._maps.append(mmap.mmap(self._node.fd, buffer.length, offset=buffer.m.offset))
            self._given_s.append(0.0)
            self.give_back(index)
        self._poll.register(self._node.fd, select.POLLIN)
        self._node.call(abi.STREAMON, abi.Integer(abi.VIDEO_CAPTURE), "starting to stream", BUSY)

    def stop(self) -> None:
        """Stop, and let the buffers go; from any state. Raises DeviceError, but not when the device is gone."""
        if not self._has_buffers:
            return
        self._has_buffers = False
        with suppress(KeyError):
            self._poll.unregister(self._node.fd)
        try:
            self._node.ioctl(abi.STREAMOFF, abi.Integer(abi.VIDEO_CAPTURE))
        except OSError as error:
            if error.errno not in GONE:
                raise device_error(error, "stopping the stream", self._node.path) from error
        finally:
            self._unmap()
        with suppress(OSError):  # freed with the node at the latest
            self._node.ioctl(abi.REQBUFS, abi.RequestBuffers(type=abi.VIDEO_CAPTURE, memory=abi.MEMORY_MMAP))

    def _unmap(self) -> None:
        for mapped in self._maps:
            with suppress(BufferError):  # somebody looks at it still; it goes when they do
                mapped.close()
        self._maps.clear()
        self._given_s.clear()

    def next(self, until_s: float) -> Filled | None:
        """Wait for a filled buffer; None when none has come by ``until_s``.

        Raises DeviceLost within milliseconds of an unplugging, StreamBroken when only the stream ended.
        """
        while True:
            wait_s = min(max(0.0, until_s - self._clock.now_s()), _LONGEST_POLL_S)
            events = self._poll.poll(math.ceil(wait_s * 1e3))
            buffer = self._dequeue(bool(events) and bool(events[0][1] & (select.POLLERR | select.POLLHUP)))
            if buffer is not None:
                return self._filled(buffer)
            if self._clock.now_s() >= until_s:
                return None

    def _dequeue(self, alarmed: bool) -> abi.Buffer | None:
        """Take a buffer if there is one; a poll that reports an error gets its reason from here."""
        try:
            return self._node.ioctl(abi.DQBUF, self._buffer())
        except OSError as error:
            if error.errno == errno.EAGAIN and not alarmed:
                return None
            raise self._failure(error, "waiting for a frame") from error

    def _filled(self, buffer: abi.Buffer) -> Filled:
        stamp_s = buffer.timestamp.seconds + buffer.timestamp.microseconds * 1e-6
        has_error = bool(buffer.flags & abi.BUFFER_ERROR)
        lost, unseen = (0, 0) if has_error and self._is_old(stamp_s) else self._counted(buffer.sequence, stamp_s)
        return Filled(
            index=buffer.index,
            bytes_used=buffer.bytesused,
            has_error=has_error,
            flags=buffer.flags,
            stamp_s=stamp_s,
            number=self._number,
            lost=lost,
            unseen=unseen,
        )

    def _is_old(self, stamp_s: float) -> bool:
        """Whether a stamp tells of no new frame.

        A camera that is unplugged gives its buffers back with the error flag as they are: stamp and sequence are
        zero, or those of the frame that they held before.
        """
        return stamp_s <= (0.0 if self._last is None else self._last[1])

    def _counted(self, sequence: int, stamp_s: float) -> tuple[int, int]:
        lost, unseen = self._count(sequence)
        self._last = sequence, stamp_s
        return lost, unseen

    def _count(self, sequence: int) -> tuple[int, int]:
        """Count on, and tell how many frames were lost, and how many skipped for want of a buffer.

        Nobody lost a frame for which there was no buffer: a gap counts only if some buffer was with the driver
        already when the frame before it came.
        """
        if self._last is None:
            self._number += 1
            return 0, 0
        last_sequence, last_stamp_s = self._last
        step = (sequence - last_sequence) & 0xFFFFFFFF
        if not 0 < step < _HALF:
            step = 1
        self._number += step
        had_buffer = any(given_s <= last_stamp_s for given_s in self._given_s)
        return (step - 1, 0) if had_buffer else (0, step - 1)

    @contextmanager
    def bytes_of(self, filled: Filled) -> Iterator[Bytes]:
        """The buffer's bytes, for the length of a ``with`` statement; copy what has to last."""
        yield np.frombuffer(self._maps[filled.index], np.uint8, filled.bytes_used)

    def give_back(self, index: int) -> None:
        """Let the driver fill a buffer again. Raises DeviceLost, or StreamBroken when it does not take it."""
        self._given_s[index] = self._clock.now_s()
        try:
            self._node.ioctl(abi.QBUF, self._buffer(index))
        except OSError as error:
            raise self._failure(error, "giving a buffer back") from error

    def _failure(self, error: OSError, doing: str) -> DeviceError:
        failure = device_error(error, doing, self._node.path)
        return failure if error.errno in GONE else StreamBroken(str(failure))

    def _buffer(self, index: int = 0) -> abi.Buffer:
        return abi.Buffer(index=index, type=abi.VIDEO_CAPTURE, memory=abi.MEMORY_MMAP)
