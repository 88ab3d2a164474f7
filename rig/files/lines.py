"""A file of lines that only grows: whole lines, also after a crash, a full disk or a signal."""

from __future__ import annotations

import os
import time
from pathlib import Path

from rig.files.atomic import session_error, sync


def complete_bytes(data: bytes) -> int:
    """Return how many bytes of a file belong to lines that were written to their end."""
    return data.rfind(b"\n") + 1


class AppendedFile:
    """A file of lines that is open for writing; made when it is not there, a torn last line is dropped.

    Parameters
    ----------
    path
        Of the file.
    sync_every_s
        At most so many seconds of lines are lost when the machine loses its power; a process that is killed loses none.

    Raises
    ------
    SessionError
        The disk refuses.
    """

    def __init__(self, path: Path, sync_every_s: float = 0.0):
        self.path = path
        self._sync_every_s = sync_every_s
        self._synced_s = time.monotonic()
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
            self._size_bytes = self._drop_torn_line()
            sync(path.parent)
        except OSError as error:
            raise session_error(error, path) from error

    def _drop_torn_line(self) -> int:
        size_bytes = complete_bytes(self.path.read_bytes())
        os.ftruncate(self._descriptor, size_bytes)
        os.fsync(self._descriptor)
        return size_bytes

    def append_line(self, line: bytes) -> None:
        """Add one line, its end included; raises SessionError when the disk is full; the file then is as before."""
        try:
            self._write(line)
        except OSError as error:
            os.ftruncate(self._descriptor, self._size_bytes)
            raise session_error(error, self.path, len(line)) from error
        self._size_bytes += len(line)

    def _write(self, line: bytes) -> None:
        written = 0
        while written < len(line):  # a nearly full disk takes a part first and refuses the rest
            written += os.write(self._descriptor, line[written:])
        if time.monotonic() - self._synced_s >= self._sync_every_s:
            os.fsync(self._descriptor)
            self._synced_s = time.monotonic()

    def close(self) -> None:
        """Let the file go, all of it on the disk; any number of times."""
        if self._descriptor >= 0:
            os.fsync(self._descriptor)
            os.close(self._descriptor)
            self._descriptor = -1
