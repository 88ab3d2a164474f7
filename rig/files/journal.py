"""The append-only journal of a session: one JSON object a line, on the disk before anything goes on."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rig.errors import SessionCorrupt, SessionError
from rig.files.atomic import session_error, sync

JOURNAL_NAME = "journal.jsonl"

Event = dict[str, Any]


def read_events(path: Path) -> list[Event]:
    """All complete events of a journal; a last line that a crash cut short is left out.

    Raises SessionError when there is no journal, SessionCorrupt when an earlier line is no event.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SessionError(f"{path}: cannot be read: {error.strerror}; is this a session's folder?") from error
    return _parse(path, data[: _complete_bytes(data)])


def _complete_bytes(data: bytes) -> int:
    return data.rfind(b"\n") + 1


def _parse(path: Path, data: bytes) -> list[Event]:
    events = []
    for number, line in enumerate(data.splitlines(), start=1):
        try:
            event = json.loads(line)
        except ValueError as error:
            raise corrupt_line(path, number) from error
        if not isinstance(event, dict) or "event" not in event:
            raise corrupt_line(path, number)
        events.append(event)
    return events


def corrupt_line(path: Path, number: int) -> SessionCorrupt:
    """Build the error for a line that this product did not write."""
    return SessionCorrupt(f"{path}: line {number} is damaged; restore the file from a copy, or start a new session")


class Journal:
    """A journal that is open for writing; made when it is not there."""

    def __init__(self, path: Path):
        self.path = path
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
            self._size_bytes = self._drop_torn_line()
            sync(path.parent)
        except OSError as error:
            raise session_error(error, path) from error

    def _drop_torn_line(self) -> int:
        size_bytes = _complete_bytes(self.path.read_bytes())
        os.ftruncate(self._descriptor, size_bytes)
        os.fsync(self._descriptor)
        return size_bytes

    def events(self) -> list[Event]:
        """Read everything back from the disk; raises SessionCorrupt."""
        return read_events(self.path)

    def append(self, event: Mapping[str, Any]) -> Event:
        """Add one event with the time of day, and return it when it is safely on the disk.

        Raises SessionError when the disk is full; the journal then is as before.
        """
        stamped = {**event, "time": datetime.now(UTC).isoformat(timespec="milliseconds")}
        line = json.dumps(stamped, allow_nan=False).encode() + b"\n"
        try:
            self._write(line)
        except OSError as error:
            os.ftruncate(self._descriptor, self._size_bytes)
            raise session_error(error, self.path, len(line)) from error
        self._size_bytes += len(line)
        return stamped

    def _write(self, line: bytes) -> None:
        written = 0
        while written < len(line):  # a nearly full disk takes a part first and refuses the rest
            written += os.write(self._descriptor, line[written:])
        os.fsync(self._descriptor)

    def close(self) -> None:
        """Let the file go; any number of times."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
