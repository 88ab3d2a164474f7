"""Later looks at a session's rig, as the page lists them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rig.errors import RigError
from rig.recheck.records import PAGE, RECORD, Recheck
from rig.records import Record
from rig.session import Session
from rig.session.alignment import RECHECKS, rechecks_of

_MOST_LOOKS = 10


@dataclass(frozen=True, kw_only=True)
class ListedLook(Record):
    """A later look, and what it found."""

    look: str
    """Name of its folder."""
    created: str
    """ISO 8601."""
    found: Recheck


def looks_at(folder: Path) -> list[ListedLook]:
    """Return the later looks at a session's rig that came to a result, the newest first; at most ten.

    Parameters
    ----------
    folder
        Of the session.

    Returns
    -------
    list of ListedLook
    """
    found = [_look(path) for path in reversed(rechecks_of(folder)[-_MOST_LOOKS:])]
    return [one for one in found if one is not None]


def look_page(folder: Path, look: str) -> Path:
    """Return the file of a look's page, which need not exist."""
    return folder / RECHECKS / look / PAGE


def _look(path: Path) -> ListedLook | None:
    """Read a look; None of one that broke off or is damaged: `rig verify` says more of it."""
    try:
        with Session.read(path) as session:
            if not session.is_finished(RECORD):
                return None
            found = session.finished(RECORD).load_record(RECORD, Recheck)
            created = next((str(event["time"]) for event in session.events()), "")
            return ListedLook(look=path.name, created=created, found=found)
    except RigError:
        return None
