"""Where a session's rig was seen again: sessions inside of it, the newest of which may be where it stands now."""

from __future__ import annotations

from pathlib import Path

from rig.session.folder import is_session
from rig.session.store import Session

RECHECKS = "rechecks"
"""Folder of a session in which the later looks at the same rig lie, each a session of its own."""
_ALIGNED = "model"
"""The step with which a later look can take the place of the session."""


def rechecks_of(folder: Path) -> list[Path]:
    """Return the later looks at a session's rig, oldest first.

    Parameters
    ----------
    folder
        Of the session.

    Returns
    -------
    list of Path
        Folders of sessions.
    """
    inner = folder / RECHECKS
    found = sorted(inner.iterdir()) if inner.is_dir() else []
    return [path for path in found if is_session(path)]


def next_recheck(folder: Path) -> Path:
    """Return the folder of the next look: one above the highest number that is there."""
    inner = folder / RECHECKS
    numbers = [int(path.name) for path in inner.iterdir() if path.name.isdigit()] if inner.is_dir() else []
    return inner / f"{max(numbers, default=0) + 1:03d}"


def aligned_folder(folder: Path) -> Path:
    """Return where the rig of a session was measured last: the newest look that was realigned, else the session.

    Parameters
    ----------
    folder
        Of the session, or of one of its looks, which stands for itself.

    Returns
    -------
    Path
        Of a session.

    Raises
    ------
    SessionError, SessionCorrupt
        A later look cannot be read.
    """
    for path in reversed(rechecks_of(folder)):
        with Session.read(path) as session:
            if session.is_finished(_ALIGNED):
                return path
    return folder
