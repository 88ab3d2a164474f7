"""From the profiles of before, schema 1, to today's: one camera, one projector, one box become the first of their kind.

The text is rewritten line by line, so that comments stay where they are. The result is believed only when it says what
the old data say, moved to their new places.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from rig.errors import ProfileError
from rig.files.atomic import write_bytes
from rig.files.toml import decoded, parse_toml, toml_value
from rig.profile.schema import SCHEMA, Profile, is_of_a_session
from rig.records import Record

BACKUP_SUFFIX = ".schema1"
CAMERA, PROJECTOR = "camera", "projector"
"""Names that the only camera and the only projector get."""

_HEADER = re.compile(r"^\s*(\[\[?)\s*([A-Za-z0-9_.\- ]+?)\s*(\]\]?)")
_SCHEMA_LINE = re.compile(r"^(\s*schema\s*=\s*)1\b")
_MOVED = {"pjlink": "projector.pjlink", "lightcrafter": "projector.lightcrafter", "room": "surface"}
_LISTED = {"camera", "projector", "scale", "simulation.camera", "simulation.projector"}
"""Tables of which there may be any number now."""


@dataclass(frozen=True)
class UpgradedProfile(Record):
    """What `rig profile upgrade` did."""

    path: str
    backup: str
    diff: str
    """Unified, old against new."""


def upgrade_profile(path: Path) -> UpgradedProfile:
    """Rewrite a profile of schema 1 as one of schema 2; the old file stays beside it, with the suffix ``.schema1``.

    Raises
    ------
    ProfileError
        It cannot be read, is of another schema, belongs to a session, or is wrong already.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ProfileError(f"{path}: cannot be read: {error.strerror}; check the name and its permissions") from error
    _refuse_what_is_not_ours(raw, path)
    text = decoded(raw, path)
    new = upgraded_text(text, path)
    Profile.parse(new.encode(), path)
    backup = path.with_name(path.name + BACKUP_SUFFIX)
    if backup.exists() and backup.read_bytes() != raw:
        raise ProfileError(f"{backup} is there already; move it away, it would be overwritten")
    write_bytes(backup, raw)
    write_bytes(path, new.encode())
    lines = difflib.unified_diff(text.splitlines(), new.splitlines(), str(backup), str(path), lineterm="", n=1)
    return UpgradedProfile(str(path), str(backup), "\n".join(lines))


def _refuse_what_is_not_ours(raw: bytes, path: Path) -> None:
    schema = parse_toml(raw, path).get("schema")
    if schema == SCHEMA:
        raise ProfileError(f"{path}: schema: is {SCHEMA} already; there is nothing to upgrade")
    if schema != 1:
        raise ProfileError(f"{path}: schema: is {schema!r}; only profiles of schema 1 can be upgraded")
    if is_of_a_session(path):
        raise ProfileError(
            f"{path}: is a session's own copy, and what the session has measured goes with it; go on with the version "
            "that made the session, or begin a new one"
        )


def upgraded_text(text: str, path: Path) -> str:
    """Return the text of a profile of schema 1 as schema 2.

    Raises ProfileError when it writes tables in a way that cannot be rewritten line by line.
    """
    new = "".join(_new_lines(part) for part in _in_order(_parts(text if text.endswith("\n") else f"{text}\n")))
    wanted = _upgraded(tomllib.loads(text))
    try:
        same = tomllib.loads(new) == wanted
    except tomllib.TOMLDecodeError:
        same = False
    if not same:
        raise ProfileError(
            f"{path}: cannot be upgraded line by line; write its tables as [camera], [projector] ... with a key a "
            "line (not camera.key = … or camera = {…}), then run this again"
        )
    return new


class _Part(NamedTuple):
    """A table's lines, with the comments just above them."""

    table: str
    """Empty for what comes before the first table."""
    above: list[str]
    header: str
    lines: list[str]


def _parts(text: str) -> list[_Part]:
    parts = [_Part("", [], "", [])]
    for line in text.splitlines(keepends=True):
        found = _HEADER.match(line)
        if found is None or len(found[1]) != len(found[3]):
            parts[-1].lines.append(line)
            continue
        parts.append(_Part(found[2].replace(" ", ""), _comments_at_the_end(parts[-1].lines), line, []))
    return parts


def _comments_at_the_end(lines: list[str]) -> list[str]:
    """Take the comments off that stand directly above the next table."""
    first = len(lines)
    while first and lines[first - 1].lstrip().startswith("#"):
        first -= 1
    taken = lines[first:]
    del lines[first:]
    return taken


def _in_order(parts: list[_Part]) -> Iterable[_Part]:
    """Tables that are part of another one now come directly after it; all others stay where they are."""
    owners = {"pjlink": "projector", "lightcrafter": "projector", "camera.controls": "camera"}
    for part in parts:
        if part.table not in owners:
            yield part
            yield from (moved for moved in parts if owners.get(moved.table) == part.table)


def _new_lines(part: _Part) -> str:
    """The same lines, under today's header, with the keys that are new."""
    name = _MOVED.get(part.table, part.table)
    header = part.header
    if header:
        start = header.index("[")
        end = header.rindex("]", 0, header.find("#") if "#" in header else None) + 1
        was_listed = header.startswith("[[", start)
        words = f"[[{name}]]" if name in _LISTED or was_listed else f"[{name}]"
        header = header[:start] + words + header[end:]
        header = header if header.endswith("\n") else f"{header}\n"
    lines = part.lines if part.table else [_SCHEMA_LINE.sub(rf"\g<1>{SCHEMA}", line) for line in part.lines]
    added = [f"{key} = {toml_value(value)}\n" for key, value in _added(name, "".join(lines)).items()]
    return "".join([*part.above, header, *added, *lines])


def _added(table: str, lines: str) -> Mapping[str, object]:
    """Keys that a table has now, first of all."""
    if table in (CAMERA, PROJECTOR, "simulation.camera", "simulation.projector"):
        return {"name": table.rpartition(".")[2]}
    if table == "scale":
        return _joined(tomllib.loads(lines))
    return {"kind": "box"} if table == "surface" else {}


def _joined(scale: Mapping[str, Any]) -> Mapping[str, object]:
    """What a length joins: only a baseline goes from lens to lens."""
    return {"between": [CAMERA, PROJECTOR]} if "baseline_m" in scale else {"projector": PROJECTOR}


def _upgraded(old: Mapping[str, Any]) -> dict[str, Any]:
    """The data of schema 1 in the places of schema 2."""
    new = {key: value for key, value in old.items() if key not in ("pjlink", "lightcrafter", "room", "scale")}
    parts = {key: old[key] for key in ("pjlink", "lightcrafter") if key in old}
    new["schema"] = SCHEMA
    if CAMERA in old:
        new[CAMERA] = [{"name": CAMERA, **old[CAMERA]}]
    if PROJECTOR in old:
        new[PROJECTOR] = [{"name": PROJECTOR, **old[PROJECTOR], **parts}]
    if "scale" in old:
        new["scale"] = [{**_joined(old["scale"]), **old["scale"]}]
    if "room" in old:
        new["surface"] = {"kind": "box", **old["room"]}
    if isinstance(truth := old.get("simulation"), dict):
        named = {kind: [{"name": kind, **truth[kind]}] for kind in (CAMERA, PROJECTOR) if kind in truth}
        new["simulation"] = {**truth, **named}
    return new
