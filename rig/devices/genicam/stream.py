"""The stream of a camera: buffers that Aravis fills, each looked at once."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import byref, c_size_t, c_uint64
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig.devices.genicam.aravis import aravis
from rig.devices.genicam.formats import Bytes
from rig.devices.protocols import Clock
from rig.errors import DeviceError

SOCKET_BUFFER_BYTES = 8 << 20
"""Of a stream over a plain socket: with the default of the kernel a third of a burst at 50 frames/s was lost."""
ORDINARY_SOCKET = 1
"""Of Aravis' options of a stream: no packet socket."""
BUFFERS = 6
"""Frames that may be under way at once."""
_COMPLETE = 0
_PACKET_TIMEOUT_US, _RETENTION_US = 20_000, 100_000
"""When a missing packet is asked for again, and when a frame counts as incomplete."""
_IDS = 0xFFFF
"""Block ids of GigE Vision 1 count to here, and begin again with 1."""
_LIMIT_FILE = Path("/proc/sys/net/core/rmem_max")


@dataclass(frozen=True, slots=True, kw_only=True)
class FilledBuffer:
    """A buffer that holds a frame, or what has arrived of one."""

    pointer: int
    is_complete: bool
    has_leader: bool
    """Whether its first packet came. Without it, the block id and both times are of a frame that the buffer held
    before, or zero."""
    number: int
    """Counted up over all that the camera sent since the program began."""
    lost: int
    """Frames that never arrived, before this one."""
    device_s: float
    """Its time stamp on the camera's clock."""
    arrived_s: float
    """When its first packet came, on the rig's clock."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamCounters:
    """Of a stream since it began."""

    complete: int
    failed: int
    underruns: int
    resent_packets: int
    missing_packets: int


@dataclass(slots=True, kw_only=True)
class GenicamSearch:
    """What came while a frame was searched for."""

    frames: int = 0
    incomplete: int = 0
    early: int = 0

    def __str__(self) -> str:
        if not self.frames:
            return "no frame came at all"
        return f"{self.frames} frames came, {self.incomplete} with packets missing, {self.early} exposed too early"


class GenicamStream:
    """The stream of an open camera; buffers belong to Aravis while they wait.

    Parameters
    ----------
    camera
        Aravis' pointer.
    payload_bytes
        Of a frame.
    is_gige
        Whether it comes over the network.
    clock
        The rig's.
    """

    def __init__(self, camera: int, payload_bytes: int, *, is_gige: bool, clock: Clock):
        self._is_gige, self._clock = is_gige, clock
        self._pointer: int | None = aravis().call("arv_camera_create_stream", camera, None, None)
        if not self._pointer:
            raise DeviceError("the camera gives no stream; close the program that has it, or switch it off and on")
        if is_gige:
            aravis().set_properties(
                self._pointer,
                socket_buffer=0,
                socket_buffer_size=SOCKET_BUFFER_BYTES,
                packet_timeout=_PACKET_TIMEOUT_US,
                frame_retention=_RETENTION_US,
            )
        for _ in range(BUFFERS):
            aravis().call(
                "arv_stream_push_buffer", self._pointer, aravis().call("arv_buffer_new_allocate", payload_bytes)
            )
        self._number = 0
        self._last_id: int | None = None
        self._last_arrived_ns = 0

    def next(self, until_s: float) -> FilledBuffer | None:
        """Wait for a frame; None when none has come by ``until_s``."""
        wait_s = max(until_s - self._clock.now_s(), 0.0)
        pointer = aravis().call("arv_stream_timeout_pop_buffer", self._pointer, int(wait_s * 1e6))
        return self._filled(pointer) if pointer else None

    def drop_waiting(self) -> int:
        """Give back what came before now, and return how many frames that were."""
        dropped = 0
        while pointer := aravis().call("arv_stream_try_pop_buffer", self._pointer):
            self._filled(pointer)
            aravis().call("arv_stream_push_buffer", self._pointer, pointer)
            dropped += 1
        return dropped

    def forget_ids(self) -> None:
        """The camera was started again: it counts anew."""
        self._last_id = None

    def _filled(self, pointer: int) -> FilledBuffer:
        arrived_ns = int(aravis().call("arv_buffer_get_system_timestamp", pointer))
        is_complete = aravis().call("arv_buffer_get_status", pointer) == _COMPLETE
        has_leader = is_complete or arrived_ns > self._last_arrived_ns
        lost = 0
        if has_leader:
            self._last_arrived_ns = max(arrived_ns, self._last_arrived_ns)
            lost = self._lost_before(int(aravis().call("arv_buffer_get_frame_id", pointer)))
        return FilledBuffer(
            pointer=pointer,
            is_complete=is_complete,
            has_leader=has_leader,
            number=self._number,
            lost=lost,
            device_s=aravis().call("arv_buffer_get_timestamp", pointer) * 1e-9,
            arrived_s=arrived_ns * 1e-9 - time.time() + self._clock.now_s(),
        )

    def _lost_before(self, block: int) -> int:
        """Count on to a block, and tell how many never arrived before it."""
        step = 1 if self._last_id is None else block - self._last_id
        if step < 0 and self._last_id is not None and self._last_id <= _IDS:
            step += _IDS
        self._last_id = block
        step = max(step, 1)
        self._number += step
        return step - 1

    @contextmanager
    def bytes_of(self, filled: FilledBuffer) -> Iterator[Bytes]:
        """The frame's bytes, for the length of a ``with`` statement; copy what has to last. Gives the buffer back."""
        size = c_size_t()
        data = aravis().call("arv_buffer_get_data", filled.pointer, byref(size))
        try:
            held = (ctypes.c_uint8 * (size.value if data else 0)).from_address(data or 1)
            yield np.frombuffer(memoryview(held), np.uint8)
        finally:
            self.give_back(filled)

    def give_back(self, filled: FilledBuffer) -> None:
        """Let Aravis fill a buffer again."""
        aravis().call("arv_stream_push_buffer", self._pointer, filled.pointer)

    def counters(self) -> StreamCounters:
        """Return what was counted so far."""
        complete, failed, underruns, resent, missing = counts = [c_uint64() for _ in range(5)]
        aravis().call("arv_stream_get_statistics", self._pointer, *map(byref, counts[:3]))
        if self._is_gige:
            aravis().call("arv_gv_stream_get_statistics", self._pointer, byref(resent), byref(missing))
        return StreamCounters(
            complete=complete.value,
            failed=failed.value,
            underruns=underruns.value,
            resent_packets=resent.value,
            missing_packets=missing.value,
        )

    def close(self) -> None:
        """End it, and free its buffers."""
        pointer, self._pointer = self._pointer, None
        if pointer is not None:
            aravis().call("g_object_unref", pointer)


def socket_buffer_limit() -> int | None:
    """Return the bytes that the kernel lets a socket keep; None where it does not say."""
    try:
        return int(_LIMIT_FILE.read_text())
    except (OSError, ValueError):
        return None
