"""Files that are there completely or not at all: ``.part``, fsync, rename, fsync of the folder."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path

from rig.errors import SessionError, UsageError

PART_SUFFIX = ".part"


def write_atomic(path: Path, write: Callable[[Path], None], *, size_bytes: int = 0) -> None:
    """Let ``write`` fill a neighbouring ``.part`` file, then put it in place; makes the folder when needed.

    ``size_bytes`` is about what it will need, for the message when the disk is full.

    Raises
    ------
    SessionError
        The disk is full or refuses; the old file, if any, is untouched.
    """
    part = path.with_name(path.name + PART_SUFFIX)
    try:
        _make_folder(path.parent)
        write(part)
        sync(part)
        os.replace(part, path)
        sync(path.parent)
    except OSError as error:
        if part.exists():
            part.unlink()
        raise session_error(error, path, size_bytes) from error


def check_output(path: Path) -> None:
    """Raise UsageError, before any work, when a file that the user named cannot stand where it was asked for."""
    if path.is_dir():
        raise UsageError(f"{path}: is a folder; give the name of a file in it")
    if not path.parent.is_dir():
        folder = path.parent
        raise UsageError(f"{path}: there is no folder {folder}; make it (mkdir -p {folder}), or correct the name")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise UsageError(f"{path}: you may not write into {path.parent.absolute()}; name a file in another folder")


def _make_folder(folder: Path) -> None:
    if not folder.is_dir():
        _make_folder(folder.parent)
        folder.mkdir(exist_ok=True)
        sync(folder.parent)


def write_bytes(path: Path, data: bytes) -> None:
    """Write ``data`` as a complete file; raises SessionError as :func:`write_atomic`."""

    def fill(part: Path) -> None:
        part.write_bytes(data)

    write_atomic(path, fill, size_bytes=len(data))


def sync(path: Path) -> None:
    """Force a file or a folder to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sha256_of(path: Path) -> str:
    """Hexadecimal SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def session_error(error: OSError, path: Path, needed_bytes: int = 0) -> SessionError:
    """Turn what the operating system says about a file into one line with advice."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        free = _free_megabytes(path)
        needs = f"needs about {needed_bytes / 1e6:.1f} MB, " if needed_bytes else ""
        return SessionError(
            f"the disk is full: {path} {needs}{free:.1f} MB are free; nothing was lost: "
            "free some space and run the same command again"
        )
    reason = error.strerror or str(error)
    return SessionError(f"cannot write {path}: {reason}; check the folder, then run the same command again")


def _free_megabytes(path: Path) -> float:
    folder = next(p for p in (path, *path.absolute().parents) if p.is_dir())
    return shutil.disk_usage(folder).free / 1e6
