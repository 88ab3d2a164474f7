"""Where files of the page lie, by name: sessions, profiles, pictures, shows; below one folder, and none outside it."""

from __future__ import annotations

import re
from pathlib import Path

from rig.errors import ProfileError, UsageError
from rig.profile.schema import Profile, load_profile
from rig.session.folder import is_session

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,79}")
PROFILES, UPLOADS, SHOWS = "profiles", "uploads", "shows"
_OWN = (PROFILES, UPLOADS, SHOWS)
"""Folders below the root that are no sessions."""


class Folders:
    """The page's root and what lies below it.

    Parameters
    ----------
    root
        Folder of the sessions; made if it does not exist.
    """

    def __init__(self, root: Path):
        self.root = root.resolve()
        self.root.mkdir(parents=True, exist_ok=True)

    def session(self, name: str) -> Path:
        """Return the folder of a session, which need not exist. Raises UsageError for what is no name."""
        if name in _OWN:
            raise UsageError(f"{name!r} is the page's own folder; give the session another name")
        return self._inside(checked_name(name, "session"))

    def sessions(self) -> list[Path]:
        """Return the folders of all sessions, the one that was worked on last first."""
        found = [one for one in self.root.iterdir() if one.name not in _OWN and is_session(one)]
        return sorted(found, key=_last_change_s, reverse=True)

    def upload(self, name: str) -> Path:
        """Return the place of a picture or film that was handed in. Raises UsageError for what is no name."""
        return self._inside(checked_name(name, "file"), UPLOADS)

    def uploads(self) -> list[str]:
        """Return the names of what was handed in."""
        return self._names(UPLOADS, "")

    def show(self, name: str) -> Path:
        """Return the file of a saved show. Raises UsageError for what is no name."""
        return self._inside(f"{checked_name(name, 'show')}.toml", SHOWS)

    def shows(self) -> list[str]:
        """Return the names of the saved shows."""
        return self._names(SHOWS, ".toml")

    def own_profile(self, name: str) -> Path:
        """Return the file of a profile of this folder, which need not exist. Raises UsageError for what is no name."""
        return self._inside(f"{checked_name(name.removesuffix('.toml'), 'profile')}.toml", PROFILES)

    def profile(self, name: str) -> str:
        """Return what `rig` takes for a profile: the file of this folder's own, else the name of a shipped one.

        Raises
        ------
        ProfileError
            There is neither.
        """
        own = self.own_profile(name)
        if own.is_file():
            return str(own)
        if name not in self.shipped_profiles():
            known = ", ".join([*self.own_profiles(), *self.shipped_profiles()])
            raise ProfileError(f"{name}: no such profile; there are {known}")
        return name

    def read_profile(self, name: str) -> Profile:
        """Read a profile. Raises ProfileError."""
        return load_profile(self.profile(name))

    def own_profiles(self) -> list[str]:
        """Return the names of the profiles in this folder."""
        return self._names(PROFILES, ".toml")

    def shipped_profiles(self) -> list[str]:
        """Return the names of the profiles that come with the program."""
        return sorted(one.stem for one in shipped_folder().glob("*.toml"))

    def _names(self, folder: str, suffix: str) -> list[str]:
        there = (self.root / folder).glob(f"*{suffix}") if (self.root / folder).is_dir() else ()
        return sorted(one.name.removesuffix(suffix) for one in there if one.is_file() and _NAME.fullmatch(one.name))

    def _inside(self, name: str, folder: str = "") -> Path:
        """A path below the root; a link that leads out of it is refused, too."""
        path = self.root / folder / name
        if not path.resolve().is_relative_to(self.root):
            raise UsageError(f"{name}: leads out of {self.root}; remove the link")
        return path


def checked_name(name: str, kind: str) -> str:
    """Return a name that is a plain one. Raises UsageError for paths and signs that no file should have."""
    if not _NAME.fullmatch(name) or ".." in name:
        raise UsageError(
            f"{name[:80]!r} is no name of a {kind}; use letters, digits, '.', '_' and '-', at most 80, and begin with "
            "a letter or digit"
        )
    return name


def shipped_folder() -> Path:
    """Return the folder of the profiles that come with the program."""
    return Path(__file__).parents[3] / "hw_profiles"


def _last_change_s(session: Path) -> float:
    journal = session / "journal.jsonl"
    return journal.stat().st_mtime if journal.exists() else 0.0
