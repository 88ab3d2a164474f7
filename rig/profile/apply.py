"""Measured values written into a profile: line by line, so that comments stay; the old file stays beside it."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rig.errors import ProfileError
from rig.files.atomic import write_bytes
from rig.files.toml import decoded, toml_value
from rig.profile.schema import Profile, is_of_a_session, load_profile

BACKUP_SUFFIX = ".before"
GUESS = "MEASURE"
"""Word of a comment that calls a value a guess (``rig profile new`` writes it)."""
_HEADER = re.compile(r"\s*\[\[?\s*([^\[\]]+?)\s*\]\]?\s*(#.*)?$")
_LINE = re.compile(r"(\s*)([A-Za-z0-9_]+)(\s*=\s*)([^#]*?)(\s*)(#.*)?$")


@dataclass(frozen=True, kw_only=True)
class AppliedValues:
    """What was written into a profile."""

    path: str
    backup: str
    """The file as it was; empty when nothing changed."""
    diff: str
    """Unified, old against new."""


def guessed_keys(text: str) -> tuple[str, ...]:
    """Return ``table.key`` of each value of a profile whose comment calls it a guess."""
    found, table = [], ""
    for line in text.splitlines():
        if header := _HEADER.match(line):
            table = header[1]
        elif (value := _LINE.match(line)) and value[6] and value[6].removeprefix("#").strip().startswith(GUESS):
            found.append(f"{table}.{value[2]}" if table else value[2])
    return tuple(found)


def _keys_in(text: str) -> set[str]:
    """Return ``table.key`` of all values that have a line of their own."""
    keys, table = set(), ""
    for line in text.splitlines():
        if header := _HEADER.match(line):
            table = header[1]
        elif value := _LINE.match(line):
            keys.add(f"{table}.{value[2]}")
    return keys


def own_file(path_or_name: str) -> Path:
    """Return the file to write into. Raises ProfileError for the name of a profile that ships, or a session's copy."""
    path = Path(path_or_name)
    if not path.is_file():
        shipped = load_profile(path_or_name).path
        raise ProfileError(f"{path_or_name}: is a profile of this program; copy {shipped}, and name the copy's file")
    if is_of_a_session(path):
        raise ProfileError(f"{path}: is a session's own copy; name the file that the session was made from")
    return path


def apply_values(path: Path, values: Mapping[str, float]) -> AppliedValues:
    """Write values into a profile, each in the place of the old one, or below its table's header.

    Parameters
    ----------
    path
        Of the profile.
    values
        By ``table.key``, e.g. ``camera.exposure_s``.

    Returns
    -------
    AppliedValues

    Raises
    ------
    ProfileError
        A key's table has no header of its own in the file, or the profile would not hold with the new values; nothing
        is written.
    SessionError
        The disk refuses.
    """
    raw = path.read_bytes()
    text = decoded(raw, path)
    new = _with_values(text, values, path)
    if new == text:
        return AppliedValues(path=str(path), backup="", diff="")
    Profile.parse(new.encode(), path)
    backup = path.with_name(path.name + BACKUP_SUFFIX)
    write_bytes(backup, raw)
    write_bytes(path, new.encode())
    lines = difflib.unified_diff(text.splitlines(), new.splitlines(), str(backup), str(path), lineterm="", n=0)
    return AppliedValues(path=str(path), backup=str(backup), diff="\n".join(lines))


def _with_values(text: str, values: Mapping[str, float], path: Path) -> str:
    left, table, lines = dict(values), "", []
    own = _keys_in(text)
    for line in text.splitlines(keepends=True):
        body = line.rstrip("\r\n")
        if header := _HEADER.match(body):
            table = header[1]
            new = [key for key in left if key not in own and key.rpartition(".")[0] == table]
            end = line[len(body) :] or "\n"
            line = body + end
            line += "".join(
                f"{key.rpartition('.')[2]} = {toml_value(left.pop(key))}  # by rig check{end}" for key in new
            )
        elif (found := _LINE.match(body)) and (value := left.pop(f"{table}.{found[2]}", None)) is not None:
            comment = "" if found[6] is None or GUESS in found[6] else f"{found[5]}{found[6]}"
            comment = comment or "  # by rig check"
            line = f"{found[1]}{found[2]}{found[3]}{toml_value(value)}{comment}{line[len(body) :]}"
        lines.append(line)
    if left:
        raise ProfileError(
            f"{path}: has no table of its own for {', '.join(sorted(left))}; write it as [[camera]] or [[projector]] "
            "with a key a line, then run this again"
        )
    return "".join(lines)
