"""A session's folder: what is in it before any step, what is refused, and with which versions it was made."""

from __future__ import annotations

import hashlib
import platform
import shlex
import socket
import sys
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio  # noqa: N813 - the library's own documentation calls it so
import scipy

from rig.errors import SessionCorrupt, SessionError
from rig.files.atomic import PART_SUFFIX, session_error, write_bytes
from rig.files.journal import JOURNAL_NAME
from rig.profile.schema import Profile
from rig.session.header import SCHEMA, ProfileStamp, SessionHeader, read_header
from rig.version import __version__

CHANGEABLE = {
    "scales": "[[scale]]",
    "surface": "[surface]",
    "patterns": "[patterns]",
    "transport": "[transport]",
    "target": "[target]",
    "brightness": "[brightness]",
    "limits": "[limits]",
    "description": "description",
}
"""Fields of a profile that may change within a session, as the file calls them; of all others photographs depend."""
NEXT_PROFILE = "profile.next.toml"
"""A changed profile before it takes its place."""
_MOST_NAMED = 3
"""Sessions that a message names: more are found by listing the folder."""
_OWN_NAMES = {"lock", "profile.toml", "session.json", JOURNAL_NAME}


def is_session(folder: Path) -> bool:
    """Tell whether a folder holds a session."""
    return (folder / "session.json").is_file()


def typed(path: Path) -> str:
    """Return a path as a shell takes it: in quotes where it has blanks."""
    return shlex.quote(str(path))


def no_session_at(folder: Path) -> str:
    """Return words for a place that is no session: where it was looked for, and the sessions near it.

    Raises
    ------
    SessionError
        It lies in a session, which then is meant.
    """
    whole = folder.absolute()
    around = next((parent for parent in whole.resolve().parents if is_session(parent)), None)
    if around is not None:
        raise SessionError(f"{folder}: is a part of the session {around}; name that folder")
    place = "" if folder.is_absolute() else f" in {whole.parent}"
    near = [found for base in (whole, whole.parent) for found in _sessions_in(base)]
    named = ", ".join(str(path) for path in near[:_MOST_NAMED])
    return f"{folder}: there is no session here{place}{f' (near it: {named})' * bool(near)}"


def _sessions_in(folder: Path) -> list[Path]:
    """Sessions directly in a folder, in the order of their names; none where it may not be read."""
    try:
        return sorted(path.parent for path in folder.glob("*/session.json"))
    except OSError:
        return []


def check_folder(folder: Path, *, may_create: bool) -> None:
    """Make the folder of a new session; refuse what is neither a session nor empty."""
    if folder.exists() and not folder.is_dir():
        no_session_at(folder)
        raise SessionError(f"{folder}: is a file; a session is a folder, give another name")
    if is_session(folder):
        return
    if not may_create:
        raise SessionError(f"{no_session_at(folder)}; make one with `rig run {typed(folder)} -p PROFILE`")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        foreign = sorted(p.name for p in folder.iterdir() if p.name.removesuffix(PART_SUFFIX) not in _OWN_NAMES)
    except OSError as error:
        raise session_error(error, folder) from error
    if foreign:
        raise SessionError(f"{folder}: has other files ({foreign[0]}, ...); give a new or an empty folder")


def read_or_create(folder: Path, profile: Profile | None, seed: int) -> tuple[SessionHeader, Profile]:
    """Return the header and the profile of a session; a new one's profile is copied.

    Raises what :func:`read_folder` raises, and SessionError when the disk refuses.
    """
    if is_session(folder) or profile is None:
        return read_folder(folder, profile)
    write_bytes(folder / "profile.toml", profile.raw)
    created = datetime.now(UTC).isoformat(timespec="seconds")
    header = SessionHeader(
        schema=SCHEMA,
        seed=seed,
        versions=own_versions(),
        profile=ProfileStamp(name=profile.name, sha256=profile.sha256, source=str(profile.path)),
        volatile={"created": created, "host": socket.gethostname()},
    )
    return header, profile


def read_folder(folder: Path, profile: Profile | None) -> tuple[SessionHeader, Profile]:
    """Return the header and the profile of a session: the one that is handed in, if it may stand for it, else the copy.

    One that differs only in what calibration reads after the photographs (:data:`CHANGEABLE`) may: steps that depend
    on it are done again.

    Raises SessionError for another profile or a layout that this version does not read, SessionCorrupt.
    """
    header = read_header(folder / "session.json")
    made_with = header.profile
    own = Profile.parse(_read_copy(folder, made_with.sha256), Path(made_with.source))
    if profile is None or profile.sha256 == made_with.sha256:
        return header, profile or own
    if changed := changed_devices(own, profile):
        raise SessionError(
            f"{folder}: was made with profile {made_with.name!r} ({made_with.sha256[:12]}), not {profile.name!r} "
            f"({profile.sha256[:12]}): they differ in {', '.join(changed)}; leave the profile out, or give a new "
            f"folder (only {', '.join(CHANGEABLE.values())} may change within a session)"
        )
    return header, profile


def changed_devices(own: Profile, other: Profile) -> list[str]:
    """Return tables in which two profiles differ, of those that have to stay as they were photographed with."""
    before, after = (profile.model_dump(mode="json", exclude=set(CHANGEABLE)) for profile in (own, other))
    names = {"cameras": "camera", "projectors": "projector"}
    return [names.get(key, key) for key in before if before[key] != after[key]]


def finish_profile_change(folder: Path, sha256: str) -> None:
    """Put the profile of a change that was cut short in its place. Raises SessionError when the disk refuses."""
    following = folder / NEXT_PROFILE
    if following.is_file() and hashlib.sha256(following.read_bytes()).hexdigest() == sha256:
        write_bytes(folder / "profile.toml", following.read_bytes())
        following.unlink()


def _read_copy(folder: Path, sha256: str) -> bytes:
    """Return the exact bytes of the session's profile; its paths are relative to where the original lies."""
    try:
        raw = (folder / "profile.toml").read_bytes()
        following = folder / NEXT_PROFILE
        if hashlib.sha256(raw).hexdigest() != sha256 and following.is_file():
            raw = following.read_bytes()
    except OSError as error:
        raise SessionCorrupt(f"{folder / 'profile.toml'}: cannot be read: {error.strerror}; restore it") from error
    if hashlib.sha256(raw).hexdigest() != sha256:
        raise SessionCorrupt(
            f"{folder / 'profile.toml'}: is not the one that {folder / 'session.json'} names; one of them was changed: "
            "restore it, or start a new session"
        )
    return raw


def own_versions() -> dict[str, str]:
    """Return the versions of procam-rig and of the libraries on which a session's numbers depend."""
    modules = {"numpy": np, "scipy": scipy, "opencv": cv2, "OpenImageIO": oiio}
    own = {"procam-rig": __version__, "python": platform.python_version()}
    return own | {name: str(module.__version__) for name, module in modules.items()}


def own_command() -> str:
    """Return the command line of this process, as typed; empty when it is not the program `rig`."""
    program, *words = sys.orig_argv[1:] if len(sys.orig_argv) > 1 else [""]
    if program == "-m" and words[:1] == ["rig"]:
        return shlex.join(words)
    return shlex.join(["rig", *words]) if Path(program).name == "rig" else ""
