"""The append-only journal of a session: one JSON object a line, on the disk before anything goes on.

Each line ends in a seal: a hash of the line and of the seal before it, so that no line can change, or go missing
between others, without being noticed. Journals of older versions have none; they are read as they are.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rig.errors import SessionCorrupt, SessionError
from rig.files.lines import AppendedFile, complete_bytes

JOURNAL_NAME = "journal.jsonl"

Event = dict[str, Any]

_SEALED = re.compile(rb'(.*), "seal": "([0-9a-f]{16})"\}', re.DOTALL)
"""A line: its text without the seal, and the seal."""
_SEAL_DIGITS = 16
"""Of SHA-256: against accidents, not against forgers."""


def read_events(path: Path) -> list[Event]:
    """All complete events of a journal; a last line that a crash cut short is left out.

    Raises SessionError when there is no journal, SessionCorrupt when an earlier line is no event.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SessionError(f"{path}: cannot be read: {error.strerror}; is this a session's folder?") from error
    return _parse(path, data[: complete_bytes(data)])


def _parse(path: Path, data: bytes) -> list[Event]:
    events, seal = [], b""
    for number, line in enumerate(data.splitlines(), start=1):
        try:
            event = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise corrupt_line(path, number) from error
        sealed = _SEALED.fullmatch(line)
        if (sealed is None and seal) or (sealed is not None and sealed[2] != _seal_of(seal, sealed[1])):
            raise corrupt_line(path, number)
        if not isinstance(event, dict) or "event" not in event:
            raise corrupt_line(path, number)
        seal = b"" if sealed is None else sealed[2]
        event.pop("seal", None)
        events.append(event)
    return events


def _seal_of(before: bytes, text: bytes) -> bytes:
    """Return the seal of a line's text after the line with the seal ``before``."""
    return hashlib.sha256(before + text).hexdigest()[:_SEAL_DIGITS].encode()


def corrupt_line(path: Path, number: int) -> SessionCorrupt:
    """Build the error for a line that this product did not write."""
    return SessionCorrupt(f"{path}: line {number} is damaged; restore the file from a copy, or start a new session")


class Journal(AppendedFile):
    """A journal that is open for writing; made when it is not there."""

    def __init__(self, path: Path):
        super().__init__(path)
        self._seal = _last_seal(path.read_bytes())

    def events(self) -> list[Event]:
        """Read everything back from the disk; raises SessionCorrupt."""
        return read_events(self.path)

    def append(self, event: Mapping[str, Any]) -> Event:
        """Add one event with the time of day, and return it when it is safely on the disk.

        Raises SessionError when the disk is full; the journal then is as before.
        """
        stamped = {**event, "time": datetime.now(UTC).isoformat(timespec="milliseconds")}
        text = json.dumps(stamped, allow_nan=False).encode().removesuffix(b"}")
        seal = _seal_of(self._seal, text)
        self.append_line(text + b', "seal": "' + seal + b'"}\n')
        self._seal = seal
        return stamped


def _last_seal(data: bytes) -> bytes:
    """Return the seal of the last of complete lines; none of journals of older versions."""
    lines = data.splitlines()
    last = _SEALED.fullmatch(lines[-1]) if lines else None
    return b"" if last is None else last[2]
