"""The folder of a study: one line a point in ``points.jsonl``, arrays beside, and a copy of the study."""

from __future__ import annotations

import gc
import io
import json
import os
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import SessionCorrupt, SessionError
from rig.files.atomic import session_error, write_bytes
from rig.files.lines import AppendedFile, complete_bytes
from rig.session.lock import SessionLock
from rig.sweeps.records import PointLine

POINTS, ARRAYS, STUDY, PAGE, TABLE = "points.jsonl", "arrays", "study.toml", "sweep.html", "points.csv"
_SYNC_S = 1.0
"""Power failures may cost so much; a lost process costs nothing that was written."""
_FIELDS = frozenset(PointLine.__dataclass_fields__)
_NEEDED = {"id", "subject", "version", "inputs", "status"}
_STATUSES = ("done", "refused", "killed")
_SEAL = b', "seal": "'
"""Of a line, before eight digits of its CRC-32: a digit that a disk or an editor changed is noticed."""
_SEALED = len(_SEAL) + len('01234567"}')


@contextmanager
def no_collections() -> Iterator[None]:
    """Leave Python's collector of circles out while a hundred thousand records are made, none of which is a circle."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


class SweepFolder:
    """A study's folder, held by one process at a time; in a ``with`` statement.

    Parameters
    ----------
    path
        Of the folder; made when it is not there.

    Raises
    ------
    SessionLocked, SessionError
        Another process works in it; the disk refuses.
    """

    def __init__(self, path: Path):
        self.path = path
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise session_error(error, path) from error
        self._lock = SessionLock(path)
        self._points: AppendedFile | None = None

    def __enter__(self) -> SweepFolder:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            if self._points is not None:
                self._points.close()
        finally:
            self._lock.release()

    def lines(self) -> dict[str, PointLine]:
        """Return what is known of each point, by its name; of several tries the last."""
        return {line.id: line for line in read_lines(self.path)}

    def add(self, line: PointLine) -> None:
        """Write a point's line; raises SessionError when the disk is full, and the file then is as before."""
        if self._points is None:
            self._points = AppendedFile(self.path / POINTS, _SYNC_S)
        self._points.append_line(sealed(json.dumps(line.as_json(), allow_nan=False).encode()) + b"\n")

    def add_arrays(self, point: str, arrays: Mapping[str, NDArray[np.generic]]) -> str:
        """Write a point's arrays and return the file's place in the folder; before its line, which names it."""
        stream = io.BytesIO()
        np.savez_compressed(stream, **dict(arrays))  # type: ignore[arg-type]
        name = f"{ARRAYS}/{point}.npz"
        write_bytes(self.path / name, stream.getvalue())
        return name

    def keep_study(self, text: bytes) -> bool:
        """Keep a copy of the study; tell whether another one was there."""
        kept = self.path / STUDY
        before = kept.read_bytes() if kept.is_file() else text
        if before != text or not kept.is_file():
            write_bytes(kept, text)
        return before != text


def sealed(text: bytes) -> bytes:
    """Return a point's line, a JSON object, with its seal."""
    return text[:-1] + _SEAL + b'%08x"}' % zlib.crc32(text[:-1])


def _is_as_written(text: bytes) -> bool:
    """Whether a line has its seal; lines of versions without seals (before 0.2) have none."""
    if text[-_SEALED : len(_SEAL) - _SEALED] != _SEAL:
        return True
    return text[-_SEALED:] == sealed(text[:-_SEALED] + b"}")[-_SEALED:]


def read_lines(folder: Path) -> Iterator[PointLine]:
    """Yield the lines of a folder's points; one that a crash cut short is left out.

    Raises
    ------
    SessionError, SessionCorrupt
        The file cannot be read; a line is no point's.
    """
    path = folder / POINTS
    try:
        data = path.read_bytes() if path.exists() else b""
    except OSError as error:
        raise SessionError(f"{path}: cannot be read: {error.strerror}; check the disk and its permissions") from error
    for number, text in enumerate(data[: complete_bytes(data)].splitlines(), start=1):
        yield _line_of(text, path, number)


def _line_of(text: bytes, path: Path, number: int) -> PointLine:
    try:
        values: Any = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise _damaged(path, number) from error
    if not isinstance(values, dict) or not _is_as_written(text):
        raise _damaged(path, number)
    values.pop("seal", None)
    if not _NEEDED <= values.keys() <= _FIELDS or not _is_line(values):
        raise _damaged(path, number)
    return PointLine(**values)


def _is_line(values: Mapping[str, Any]) -> bool:
    tables = isinstance(values["inputs"], dict) and isinstance(values.get("figures", {}), dict)
    return tables and values["status"] in _STATUSES


def _damaged(path: Path, number: int) -> SessionCorrupt:
    return SessionCorrupt(f"{path}: line {number} is damaged; delete that line, and its point is computed again")


def is_complete(folder: Path, name: str) -> bool:
    """Whether a file of the folder is there and not older than the points."""
    try:
        return os.stat(folder / name).st_mtime >= os.stat(folder / POINTS).st_mtime
    except OSError:
        return False
