"""Sources of raw pictures from other programs: a pipe, a named pipe, standard input, shared memory.

Streams. With a size given, pictures of height x width x 3 bytes (red, green, blue) follow each other without
anything between. Without, each picture is a binary PPM (``P6``, maximum 255), so its size may change:
``ffmpeg -i film.mp4 -f image2pipe -vcodec ppm -`` writes that.

Shared memory. A file in ``/dev/shm``: 64 bytes of header (magic, width, height, counter; little-endian), then the
picture. The writer makes the counter odd, writes the picture, and makes it even: a reader that sees the same even
number before and after has a whole picture.
"""

from __future__ import annotations

import contextlib
import fcntl
import mmap
import os
import re
import select
import stat
import struct
from pathlib import Path

import numpy as np

from rig.devices.protocols import Clock
from rig.live.sources.source import Picture, PipeBroken, Pixels, SourceEnded

_PIPE_BYTES = 1 << 20
"""The most that Linux gives a user without asking root: fewer, larger reads."""
_SET_PIPE_SIZE = 1031
"""F_SETPIPE_SZ, which Python 3.11 has no name for everywhere."""
_LONGEST_HEADER = 64
"""Of a PPM: magic, two sizes and 255 need 20 bytes."""
_PPM = re.compile(rb"P6\s+(\d+)\s+(\d+)\s+255\s", re.DOTALL)
_LARGEST_PX = 16384
"""Larger sizes are garbage in a header."""
_MOST_PX = 64 << 20
"""Of a picture, 200 MB: what comes live is no larger, and a header of garbage must not ask for gigabytes."""
_LOOK_S = 0.002
_MAGIC = b"RIGFRAME"
_HEADER = struct.Struct("<8sIIQ")
_HEADER_BYTES = 64
SHARED_FOLDER = Path("/dev/shm")


def check_size(name: str, size: tuple[int, int]) -> None:
    """Raise PipeBroken for a (height, width) in pixels that no picture has."""
    height, width = size
    if not (0 < width <= _LARGEST_PX and 0 < height <= _LARGEST_PX and width * height <= _MOST_PX):
        raise PipeBroken(
            f"{name}: a picture of {width} x {height} px; the limit is {_LARGEST_PX} px and "
            f"{_MOST_PX >> 20} megapixels: make it smaller, or correct its header"
        )


class StreamSource:
    """Raw pictures from a pipe or a file; never waits longer than it is told.

    Parameters
    ----------
    path
        Of a named pipe or a file; None for standard input.
    size
        (height, width) of pictures without header; None when each has its PPM header.
    clock
        To wait with until somebody writes.
    """

    def __init__(self, path: Path | None, size: tuple[int, int] | None, clock: Clock):
        self._path = path
        self._size = size
        self._clock = clock
        self._descriptor: int | None = None
        self._begun = False
        self._header = bytearray()
        self._pixels: Pixels | None = None
        self._room = np.empty((0, 0, 3), np.uint8)
        self._filled = 0

    @property
    def name(self) -> str:
        """The words for where it comes from."""
        return "standard input" if self._path is None else self._path.name

    @property
    def frame_rate_hz(self) -> None:
        """Whatever the writer's is."""
        return

    def open(self) -> None:
        """Look for a writer; does not wait for one. Raises PipeBroken."""
        self.close()
        try:
            self._descriptor = os.dup(0) if self._path is None else os.open(self._path, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as error:
            raise PipeBroken(f"{self._path}: cannot be read: {error.strerror}; make it with mkfifo") from error
        if stat.S_ISDIR(os.fstat(self._descriptor).st_mode):
            self.close()
            raise PipeBroken(f"{self.name or self._path}: is a folder; give a named pipe that mkfifo made, or a file")
        with contextlib.suppress(OSError):  # a file, or a limit of the system's
            fcntl.fcntl(self._descriptor, _SET_PIPE_SIZE, _PIPE_BYTES)
        self._begun, self._filled = False, 0
        self._header.clear()
        self._pixels = None if self._size is None else self._room_for(self._size)

    def _room_for(self, size: tuple[int, int]) -> Pixels:
        """Memory for pictures, allocated when their size changes."""
        if self._room.shape[:2] != size:
            self._room = np.empty((*size, 3), np.uint8)
        return self._room

    def read(self, timeout_s: float) -> Picture | None:
        """Read on; None while the picture is not complete. Raises SourceEnded, PipeBroken."""
        until_s = self._clock.now_s() + timeout_s
        while (left_s := until_s - self._clock.now_s()) > 0:
            if not self._read_some(left_s):
                continue
            pixels = self._pixels
            if pixels is not None and self._filled == pixels.nbytes:
                self._filled = 0
                self._header.clear()
                if self._size is None:
                    self._pixels = None
                return Picture(pixels)
        return None

    def _read_some(self, timeout_s: float) -> bool:
        """Read what is there of the header or the picture; False when nothing was."""
        if self._descriptor is None:
            raise PipeBroken(f"{self.name}: is closed")
        if not select.select([self._descriptor], [], [], timeout_s)[0]:
            return False
        try:
            count = self._read_header() if self._pixels is None else self._read_pixels(self._pixels)
        except BlockingIOError:
            return False
        except OSError as error:
            raise PipeBroken(f"{self.name}: cannot be read: {error.strerror}; start its writer again") from error
        if count == 0:
            self._meet_the_end()
        self._begun = self._begun or count > 0
        return count > 0

    def _meet_the_end(self) -> None:
        """Nobody has the other end open: not yet, or no more."""
        is_fifo = self._path is not None and self._path.is_fifo()
        if is_fifo and not self._begun:
            self._clock.wait_until_s(self._clock.now_s() + _LOOK_S)
            return
        if self._filled or self._header:
            raise PipeBroken(
                f"{self.name}: ended in the middle of a picture, after {self._filled} bytes of it; is --size right?"
            )
        raise SourceEnded

    def _read_header(self) -> int:
        """One byte at a time, for what follows the header has to stay in the pipe."""
        data = os.read(self._descriptor or 0, 1)
        self._header += data
        found = _PPM.fullmatch(self._header)
        if found:
            width, height = int(found[1]), int(found[2])
            check_size(self.name, (height, width))
            self._pixels = self._room_for((height, width))
        elif len(self._header) >= _LONGEST_HEADER or (len(self._header) > 1 and self._header[:2] != b"P6"):
            raise PipeBroken(
                f"{self.name}: no PPM picture (P6, 255), it begins with {bytes(self._header[:8])!r}; "
                "give --size WIDTHxHEIGHT for pictures without header"
            )
        return len(data)

    def _read_pixels(self, pixels: Pixels) -> int:
        count = os.readv(self._descriptor or 0, [pixels.reshape(-1).data[self._filled :]])
        self._filled += count
        return count

    def close(self) -> None:
        """Let it go."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None


class SharedMemorySource:
    """The newest picture that another program holds in shared memory.

    It is read like a file: memory that its writer shortens would stop a program that has it mapped.
    """

    def __init__(self, name: str, clock: Clock, folder: Path = SHARED_FOLDER):
        self._path = folder / name
        self._clock = clock
        self._descriptor: int | None = None
        self._last = 0
        self._pixels = np.empty((0, 0, 3), np.uint8)

    @property
    def name(self) -> str:
        """The name of the memory."""
        return f"shared memory {self._path.name}"

    @property
    def frame_rate_hz(self) -> None:
        """Whatever the writer's is."""
        return

    def open(self) -> None:
        """Look at the memory. Raises PipeBroken when there is none, or it has another format."""
        self.close()
        try:
            self._descriptor = os.open(self._path, os.O_RDONLY)
        except OSError as error:
            raise PipeBroken(
                f"{self._path}: cannot be read: {error.strerror}; start the program that writes it"
            ) from error
        self._last = 0
        self._header()

    def _header(self) -> tuple[int, int, int]:
        """(height, width, counter). Raises PipeBroken."""
        if self._descriptor is None:
            raise PipeBroken(f"{self._path}: is closed")
        try:
            data = os.pread(self._descriptor, _HEADER.size, 0)
        except OSError as error:
            raise PipeBroken(f"{self._path}: cannot be read: {error.strerror}; give a file's name") from error
        if len(data) < _HEADER.size or not data.startswith(_MAGIC):
            raise PipeBroken(f"{self._path}: does not begin with {_MAGIC.decode()}; see docs/how-to/live.md")
        _, width, height, counter = _HEADER.unpack(data)
        check_size(str(self._path), (height, width))
        return height, width, counter

    def read(self, timeout_s: float) -> Picture | None:
        """Copy the newest whole picture; None when there is no newer one. Raises PipeBroken."""
        until_s = self._clock.now_s() + timeout_s
        while True:
            height, width, before = self._header()
            if before % 2 == 0 and before != self._last and self._copy((height, width, 3), before):
                return Picture(self._pixels)
            now_s = self._clock.now_s()
            if now_s >= until_s:
                self._follow()
                return None
            self._clock.wait_until_s(min(now_s + _LOOK_S, until_s))

    def _copy(self, shape: tuple[int, int, int], before: int) -> bool:
        """False when the writer wrote meanwhile."""
        if self._pixels.shape != shape:
            self._pixels = np.empty(shape, np.uint8)
        count = os.preadv(self._descriptor or 0, [self._pixels.reshape(-1).data], _HEADER_BYTES)
        if self._header()[2] != before:
            return False
        if count < self._pixels.nbytes:
            raise PipeBroken(
                f"{self._path}: says {shape[1]} x {shape[0]} px, but has {count} bytes of picture; correct its writer"
            )
        self._last = before
        return True

    def _follow(self) -> None:
        """A writer that starts again makes new memory of the same name."""
        try:
            is_same = os.stat(self._path).st_ino == os.fstat(self._descriptor or 0).st_ino
        except FileNotFoundError as error:
            raise SourceEnded from error
        if not is_same:
            self.open()

    def close(self) -> None:
        """Let the memory go; it stays its writer's."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None


class SharedMemoryWriter:
    """Makes and fills shared memory for :class:`SharedMemorySource`; for programs in Python, and as the format's proof.

    Parameters
    ----------
    name
        Of the file in ``/dev/shm``.
    shape
        (height, width) of the pictures.
    """

    def __init__(self, name: str, shape: tuple[int, int], folder: Path = SHARED_FOLDER):
        self.path = folder / name
        self._shape = shape
        self._counter = 0
        size_bytes = _HEADER_BYTES + 3 * shape[0] * shape[1]
        with self.path.open("w+b") as file:
            file.truncate(size_bytes)
            self._map = mmap.mmap(file.fileno(), size_bytes)
        self._write_header()

    def _write_header(self) -> None:
        height, width = self._shape
        self._map[: _HEADER.size] = _HEADER.pack(_MAGIC, width, height, self._counter)

    def write(self, pixels: Pixels) -> None:
        """Hand over (H, W, 3) codes, red first."""
        self._counter += 1
        self._write_header()
        there = np.frombuffer(self._map, np.uint8, pixels.size, _HEADER_BYTES)
        np.copyto(there, pixels.reshape(-1))
        del there
        self._counter += 1
        self._write_header()

    def close(self) -> None:
        """Remove the memory; who has it mapped keeps it."""
        self._map.close()
        self.path.unlink(missing_ok=True)
