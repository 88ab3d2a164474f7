"""What session.json begins with: layout, seed, versions, and which profile the session was made with."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rig.errors import SessionCorrupt, SessionError
from rig.records import Json, Record, read_record

SCHEMA = 2
"""The layout of a session that this version writes and reads."""


@dataclass(frozen=True, kw_only=True)
class ProfileStamp(Record):
    """Which profile a session was made with."""

    name: str
    sha256: str
    source: str
    """Path of the file that was read: relative paths in the profile begin in its folder."""


@dataclass(frozen=True, kw_only=True)
class SessionHeader(Record):
    """The part of session.json that no step changes."""

    schema: int
    seed: int
    versions: Mapping[str, str]
    """Of procam-rig and of the libraries that made the session, by name."""
    profile: ProfileStamp
    volatile: Mapping[str, str]
    """When and where it was made: the only part that is not the same when the session is made again."""


def read_header(path: Path) -> SessionHeader:
    """Read the header of a session.

    Raises
    ------
    SessionError
        Another version of procam-rig made the session, with a layout that this one does not read.
    SessionCorrupt
        The file is damaged.
    """
    try:
        found: Json = json.loads(path.read_bytes())
        schema = found["schema"] if isinstance(found, dict) else None
        if isinstance(schema, int) and schema != SCHEMA:
            raise _other_layout(path, schema)
        return read_record(SessionHeader, found)
    except (ValueError, KeyError) as error:
        raise SessionCorrupt(f"{path}: is damaged; restore it from a copy, or start a new session") from error


def _other_layout(path: Path, schema: int) -> SessionError:
    if schema > SCHEMA:
        return SessionError(
            f"{path}: layout {schema} is newer than {SCHEMA}, the newest that this version reads; update procam-rig"
        )
    return SessionError(
        f"{path}: layout {schema} was made with an older version of procam-rig; start a new session, or use version 0.1"
    )
