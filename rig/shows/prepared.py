"""A saved show with all that is computed before its devices open, and whether that is still what its files say."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rig.live.plan import LivePlan, plan_live
from rig.session.alignment import RECHECKS, aligned_folder
from rig.session.folder import is_session
from rig.shows.saved import SavedShow, load_show, request_of
from rig.terminal import OnStep, silent

Stamps = frozenset[tuple[str, int, int]]
"""Path, time of the last change in ns, and size of each file that a plan was made of."""
_NEVER_READ = frozenset({"lock", "journal.jsonl", "report.html", "session.json"})
"""In a session's folder: they are written whenever it is opened, without a change of what was measured."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedShow:
    """A show that may begin at once."""

    show: SavedShow
    path: Path
    """Of its file."""
    plan: LivePlan
    stamps: Stamps
    """Of its files, before they were read."""

    def is_current(self) -> bool:
        """Whether its file, its profile and its session are those that it was prepared from."""
        return _stamps(self.path, self.show, Path(self.plan.profile.path)) == self.stamps


def prepare_show(name: str, on_step: OnStep = silent) -> PreparedShow:
    """Read a show and compute what it needs.

    Parameters
    ----------
    name
        File or name of the show.
    on_step
        Told how far it is.

    Returns
    -------
    PreparedShow

    Raises
    ------
    UsageError, ProfileError, SessionError
        It cannot begin.
    """
    show, path = load_show(name)
    before = _stamps(path, show, None)
    plan = plan_live(request_of(show, path), on_step)
    profile = Path(plan.profile.path)
    return PreparedShow(show=show, path=path, plan=plan, stamps=before | frozenset(_stamped(profile)))


def _stamps(path: Path, show: SavedShow, profile: Path | None) -> Stamps:
    """Stamp the show's file, its profile's where it is known, and all files of the session that it is shown by."""
    files = [path] if profile is None else [path, profile]
    folder = request_of(show, path).folder
    found = frozenset(stamp for file in files for stamp in _stamped(file))
    return found if folder is None or not is_session(folder) else found | frozenset(_of_session(folder))


def _of_session(folder: Path) -> Iterator[tuple[str, int, int]]:
    aligned = aligned_folder(folder)
    for place, folders, files in os.walk(aligned):
        folders[:] = [one for one in folders if one not in (RECHECKS, "frames")]
        for name in files:
            if name not in _NEVER_READ:
                yield from _stamped(Path(place) / name)


def _stamped(file: Path) -> Iterator[tuple[str, int, int]]:
    """One stamp, or none of a file that is not there."""
    try:
        status = file.stat()
    except OSError:
        return
    yield str(file), status.st_mtime_ns, status.st_size
