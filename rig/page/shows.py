"""Saved shows as the page edits them: the fields of their files, with the page's names in place of paths."""

from __future__ import annotations

from rig.errors import UsageError
from rig.files.toml import check_model
from rig.page.server.folders import PROFILES, UPLOADS, Folders, checked_name
from rig.page.workplace import source_of
from rig.records import JsonObject
from rig.session.folder import is_session
from rig.shows.saved import SavedShow, load_show, write_show

_UP = "../"
"""From the folder of shows to the page's root."""


def read_saved(folders: Folders, name: str) -> SavedShow:
    """Read a saved show, names in place of paths below the page's root; other paths stay as they are.

    Raises
    ------
    UsageError, ProfileError
        There is none of that name, or its file is wrong.
    """
    path = folders.show(name)
    if not path.is_file():
        raise UsageError(f"{name}: no saved show of that name; save it first")
    show, _ = load_show(str(path))
    return show.model_copy(
        update={
            "session": _name(show.session, _UP),
            "profile": (_name(show.profile, f"{_UP}{PROFILES}/") or "").removesuffix(".toml") or None,
            "sources": tuple(str(_name(word, f"{_UP}{UPLOADS}/")) for word in show.sources),
        }
    )


def save_show(folders: Folders, name: str, asked: JsonObject) -> SavedShow:
    """Save a show by the page's names. Paths that a person wrote into its file may stay; no other path is taken.

    Parameters
    ----------
    folders
        Of the page.
    name
        The show's.
    asked
        Fields of :class:`rig.shows.saved.SavedShow`.

    Raises
    ------
    UsageError, ProfileError, SessionError
        It could not begin, or the disk refuses it.
    """
    path = folders.show(name)
    wanted = check_model(SavedShow, asked, path, [])
    before = read_saved(folders, name) if path.is_file() else None
    known = (
        frozenset() if before is None else frozenset((before.session, before.profile, before.record, *before.sources))
    )
    stored = {
        "session": _session_path(wanted.session, known, folders),
        "profile": _profile_path(wanted.profile, known, folders),
        "sources": tuple(_source_path(word, known, folders) for word in wanted.sources),
    }
    if wanted.record is not None and wanted.record not in known:
        checked_name(wanted.record, "folder")
    write_show(wanted.model_copy(update=stored), path)
    return wanted


Known = frozenset[str | None]
"""What a show's file says already: a path among it, which the page has no name for, may stay."""


def _words_of(show: SavedShow) -> Known:
    return frozenset((show.session, show.profile, show.record, *show.sources))


def _session_path(name: str | None, known: Known, folders: Folders) -> str | None:
    if name is None or _stays(name, known):
        return name
    folder = folders.session(name)
    if not is_session(folder):
        raise UsageError(f"{name}: there is no session of that name; run one first")
    return f"{_UP}{name}"


def _profile_path(name: str | None, known: Known, folders: Folders) -> str | None:
    if name is None or _stays(name, known):
        return name
    folders.profile(name)
    return f"{_UP}{PROFILES}/{name}.toml" if folders.own_profile(name).is_file() else name


def _source_path(word: str, known: Known, folders: Folders) -> str:
    if _stays(word, known) or source_of(word, folders) == word:
        return word
    return f"{_UP}{UPLOADS}/{word}"


def _stays(word: str, known: Known) -> bool:
    return "/" in word and word in known


def _name(path: str | None, folder: str) -> str | None:
    """The page's name of a path in its folder."""
    if path is None or not path.startswith(folder) or "/" in path.removeprefix(folder):
        return path
    return path.removeprefix(folder)
