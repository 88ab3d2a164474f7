"""One process at a time works on a session; the lock of a process that died counts no more."""

from __future__ import annotations

import fcntl
import json
import os
import socket
from datetime import UTC, datetime
from pathlib import Path

from rig.errors import SessionLocked
from rig.files.atomic import session_error


class SessionLock:
    """An advisory lock on the file ``lock`` in a session's folder; the kernel drops it when its process ends.

    Raises SessionLocked, naming the owner, when another holds it.
    """

    def __init__(self, folder: Path):
        path = folder / "lock"
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise session_error(error, path) from error
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            owner = _owner(self._descriptor)
            self.release()
            raise SessionLocked(f"{folder}: {owner}; wait for it to end, or stop it") from error
        self._sign()

    def _sign(self) -> None:
        since = datetime.now(UTC).isoformat(timespec="seconds")
        owner = {"pid": os.getpid(), "host": socket.gethostname(), "since": since}
        os.ftruncate(self._descriptor, 0)
        os.pwrite(self._descriptor, json.dumps(owner).encode(), 0)

    def release(self) -> None:
        """Let the next one in; any number of times."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def _owner(descriptor: int) -> str:
    try:
        owner = json.loads(os.pread(descriptor, 4096, 0))
        return f"process {owner['pid']} on {owner['host']} works on it since {owner['since']}"
    except (ValueError, KeyError, TypeError):  # it has the lock, but has not signed yet
        return "another process works on it"
