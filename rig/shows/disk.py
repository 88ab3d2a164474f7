"""Recordings of a show within a limit: the oldest pictures go first, journals stay."""

from __future__ import annotations

import contextlib
from pathlib import Path

_PICTURES = ("shown-*.png", "photograph-*.exr")


def keep_within(folder: Path, limit_bytes: int) -> int:
    """Delete the oldest pictures of recordings until all together are within a limit.

    Parameters
    ----------
    folder
        In which recordings lie, a folder each.
    limit_bytes
        Of their pictures together.

    Returns
    -------
    int
        How many were deleted.
    """
    found = sorted(_pictures(folder))
    total, deleted = sum(size for _, size, _ in found), 0
    for _, size, path in found:
        if total <= limit_bytes:
            break
        with contextlib.suppress(OSError):
            path.unlink()
            deleted += 1
        total -= size
    return deleted


def _pictures(folder: Path) -> list[tuple[float, int, Path]]:
    """Time, size and path of each picture; what vanishes meanwhile is none."""
    found = []
    for pattern in _PICTURES:
        for path in folder.glob(f"*/{pattern}"):
            with contextlib.suppress(OSError):
                status = path.stat()
                found.append((status.st_mtime, status.st_size, path))
    return found
