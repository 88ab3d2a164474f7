"""From what the validator finds in a TOML file to lines that a person can act on."""

from __future__ import annotations

import codecs
import difflib
import json
import re
import tomllib
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeGuard, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from rig.errors import ProfileError

Model = TypeVar("Model", bound=BaseModel)


class Table(BaseModel):
    """A TOML table: frozen, without unknown keys, without numbers that are none."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


_LARGEST_BYTES = 16 << 20
"""Of a TOML file: a lens file of a thousand views has one."""
_LINE_NUMBER = re.compile(r"\(at line (\d+),")
_LINE_SHOWN = 80
"""Signs of a line that a message repeats: as many as a terminal has columns."""
_SLIPS = {
    "[\u201c\u201d\u201e\u2018\u2019\u00ab\u00bb]": '; write straight quotes, "…" (an editor made them curly)',
    "[\u200b\u200c\u200d\u2060\ufeff\u00a0]": "; it has invisible signs, which came with a copied text: type it anew",
    r"^[\w.-]+\s*=\s*[+-]?\d+,\d+\s*(#.*)?$": "; write a decimal point, not a comma",
    r'=\s*"[^"]*\\[^"]*"': "; write / in paths, or put them between single quotes: '…'",
    r"^[\w.-]+\s*=\s*(True|False|yes|no|on|off)\b": "; write true or false",
    r"^[\w.-]+\s*=\s*[A-Za-z/~]": '; a text stands between quotes: "…"',
    r"^[\w.-]+\s*:": "; write key = value",
    r"^[\w.-]+\s*=\s*(#.*)?$": "; a value is missing",
}
"""What people write in the place of TOML, by the pattern of a line, and what to write instead."""
_UNITS = {
    "s": "seconds",
    "m": "metres",
    "m2": "square metres",
    "px": "pixels",
    "hz": "hertz",
    "deg": "degrees",
    "e": "electrons",
    "dn": "digital numbers",
}


def parse_toml(raw: bytes, path: Path) -> dict[str, Any]:
    """Read TOML; raises ProfileError that names file, line and column."""
    if len(raw) > _LARGEST_BYTES:
        raise ProfileError(f"{path}: has {len(raw)} bytes, the limit is {_LARGEST_BYTES}; give a TOML file")
    text = decoded(raw, path)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ProfileError(f"{path}: is not TOML: {error}{_why_no_toml(text, str(error))}") from error
    except ValueError as error:
        raise ProfileError(f"{path}: has a number with thousands of digits; write it shorter") from error
    except RecursionError as error:
        raise ProfileError(f"{path}: has tables or lists too deep in each other; write it flatter") from error
    _refuse_what_json_cannot_say(data, path, "")
    return data


def decoded(raw: bytes, path: Path) -> str:
    """Return a file's text, without the mark that some editors put before UTF-8; raises ProfileError for no UTF-8."""
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if raw[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
            raise ProfileError(f"{path}: is UTF-16; save the file as UTF-8 text") from error
        line = raw.count(b"\n", 0, error.start) + 1
        raise ProfileError(
            f"{path}: line {line}: byte {error.start} is not UTF-8; save the file as UTF-8 text"
        ) from error


def _why_no_toml(text: str, problem: str) -> str:
    """Return the line that a parser stumbled over, and what is the matter with it where that is plain to see."""
    found = _LINE_NUMBER.search(problem)
    lines = text.split("\n")
    if found is None or int(found[1]) > len(lines):
        return ""
    line = lines[int(found[1]) - 1].strip(" \t\r")  # a blank that is none stays
    reason = next((words for pattern, words in _SLIPS.items() if re.search(pattern, line)), "")
    return f": `{_visible(line)}`{reason}"


def _visible(line: str) -> str:
    shown = "".join(sign if sign.isprintable() else f"\\u{ord(sign):04x}" for sign in line)
    return shown if len(shown) <= _LINE_SHOWN else f"{shown[:_LINE_SHOWN]}…"


def _refuse_what_json_cannot_say(value: object, path: Path, place: str) -> None:
    """Raise ProfileError for whole numbers beyond the 64 bits that TOML knows."""
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise ProfileError(f"{path}: {place.removeprefix('.')}: a whole number beyond 64 bits; write it shorter")
    if isinstance(value, dict):
        for key, one in value.items():
            _refuse_what_json_cannot_say(one, path, f"{place}.{key}")
    if isinstance(value, list):
        for k, one in enumerate(value):
            _refuse_what_json_cannot_say(one, path, f"{place}.{k}")


def read_model(model: type[Model], raw: bytes, path: Path, checks: Callable[[dict[str, Any]], list[str]]) -> Model:
    """Read TOML and build the model of it.

    ``checks`` finds problems that no single table shows ("table.key: what") in the TOML's data; it may raise. Raises
    ProfileError with one line ``FILE: table.key: what`` for each problem.
    """
    data = parse_toml(raw, path)
    return check_model(model, data, path, checks(data))


def check_model(model: type[Model], data: Mapping[str, Any], path: Path, known_problems: Iterable[str] = ()) -> Model:
    """Build a model from a TOML's data, without any conversion between text, numbers and truth values.

    ``known_problems`` ("table.key: what") are those that no single table shows. Raises ProfileError with one line
    ``FILE: table.key: what`` for each problem.
    """
    problems = list(known_problems)
    try:
        checked = model.model_validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as error:
        lines = [_line(model, data, details) for details in error.errors()]
        # What is said with its remedy already is not said again without.
        problems += [line for line in lines if not any(known.startswith(f"{line};") for known in problems)]
        raise ProfileError(_joined(path, problems)) from error
    if problems:
        raise ProfileError(_joined(path, problems))
    return checked


def _joined(path: Path, problems: list[str]) -> str:
    return "\n".join(f"{path}: {problem}" for problem in dict.fromkeys(problems))


def entry_place(entries: Sequence[object], index: int) -> str:
    """Return how messages tell the tables of an array apart: by name, else by number; not at all when there is one."""
    entry = entries[index] if index < len(entries) else None
    if not isinstance(entry, dict):
        return f".{index}"
    if len(entries) == 1:
        return ""
    return f".{entry['name']}" if isinstance(entry.get("name"), str) else f".{index + 1}"


def toml_value(value: object, *, exact: bool = False) -> str:
    """Write a number, text, truth value or list of them as TOML, floats as people read them or with all digits.

    Raises TypeError for anything else.
    """
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # JSON allows it, TOML does not
    if isinstance(value, tuple | list):
        return "[" + ", ".join(toml_value(one, exact=exact) for one in value) + "]"
    if isinstance(value, float):
        return repr(value) if exact or value.is_integer() else f"{value:.9g}"
    if isinstance(value, int):
        return repr(value)
    raise TypeError(f"{type(value).__name__} is not written as TOML")


def toml_text(data: Mapping[str, object], place: str = "") -> str:
    """Write a file's tables as TOML: values first, then tables and lists of tables. Raises TypeError as above."""
    tables = {key: value for key, value in data.items() if isinstance(value, Mapping)}
    lists = {key: value for key, value in data.items() if _is_list_of_tables(value)}
    lines = [
        f"{_key(key)} = {toml_value(value, exact=True)}" for key, value in data.items() if key not in tables | lists
    ]
    text = "".join(f"{line}\n" for line in lines)
    for key, table in tables.items():
        text += f"\n[{place}{_key(key)}]\n{toml_text(table, f'{place}{_key(key)}.')}"
    for key, rows in lists.items():
        for row in rows:
            text += f"\n[[{place}{_key(key)}]]\n{toml_text(row, f'{place}{_key(key)}.')}"
    return text


def _is_list_of_tables(value: object) -> TypeGuard[list[dict[str, object]]]:
    return isinstance(value, list) and bool(value) and all(isinstance(one, dict) for one in value)


def _key(key: str) -> str:
    plain = key and all(letter.isascii() and (letter.isalnum() or letter in "_-") for letter in key)
    return key if plain else json.dumps(key, ensure_ascii=False)


def _line(model: type[BaseModel], data: Mapping[str, Any], error: ErrorDetails) -> str:
    location = error["loc"]
    place, _ = _walk(model, data, location)
    if error["type"] == "extra_forbidden":
        _, tables = _walk(model, data, location[:-1])
        known = [field.alias or key for table in tables for key, field in table.model_fields.items()]
        return f"{place}: unknown key{_suggestion(str(location[-1]), known)}"
    if error["type"].startswith("union_tag"):
        place = f"{place}.kind"
    return f"{place}: {_what(place, error)}" if place else _what(place, error)


def _what(place: str, error: ErrorDetails) -> str:
    kind, given = error["type"], error["input"]
    if kind in ("missing", "union_tag_not_found"):
        return "missing"
    if kind == "union_tag_invalid":
        return f"is {error['ctx']['tag']!r}, should be one of {error['ctx']['expected_tags']}"
    if kind == "value_error":
        return error["msg"].removeprefix("Value error, ")
    if kind == "tuple_type" and isinstance(given, dict):
        return f"is one table, should be any number of them: write [[{place}]]"
    message = error["msg"].removeprefix("Input should be ").replace("Field required", "missing")
    shown = "a table" if isinstance(given, dict) else repr(given)
    return f"is {shown}, should be {message}" if message != error["msg"] else f"{message} (is {shown})"


def _walk(
    model: type[BaseModel], data: object, location: tuple[int | str, ...]
) -> tuple[str, tuple[type[BaseModel], ...]]:
    """How messages call a place, and what tables there may be there; none where keys are free."""
    words, here = "", data
    tables: tuple[type[BaseModel], ...] = (model,)
    for part in location:
        if isinstance(part, int):
            words += entry_place(here, part) if isinstance(here, list) else f".{part}"
            here = here[part] if isinstance(here, list) and part < len(here) else None
        elif chosen := _of_kind(tables, part):
            tables = chosen
        else:
            words += f".{part}"
            here = here.get(part) if isinstance(here, dict) else None
            fields = [
                field for table in tables for key, field in table.model_fields.items() if part in (key, field.alias)
            ]
            tables = _tables_in(fields[0].annotation) if fields else ()
    return words.removeprefix("."), tables


def _of_kind(tables: tuple[type[BaseModel], ...], kind: str) -> tuple[type[BaseModel], ...]:
    """Of several tables that may stand in one place, the one that a key ``kind`` chooses."""
    if len(tables) < 2:
        return ()
    return tuple(
        table for table in tables if (field := table.model_fields.get("kind")) and kind in get_args(field.annotation)
    )


def _tables_in(annotation: object) -> tuple[type[BaseModel], ...]:
    """Find the tables' models inside ``X | None`` or ``tuple[X, ...]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return (annotation,)
    if get_origin(annotation) in (Union, types.UnionType, tuple):
        return tuple(table for one in get_args(annotation) for table in _tables_in(one))
    return ()


def _suggestion(key: str, known: list[str]) -> str:
    stem = key.rpartition("_")[0] or key
    same_stem = [k for k in known if k in (stem, f"{stem}s") or (k.rpartition("_")[0] in (stem, key))]
    near = same_stem or difflib.get_close_matches(key, known, n=1)
    if not near:
        return f"; known are {', '.join(known)}" if known else ""
    return f"; did you mean {near[0]}{_unit(near[0], _UNITS)}?"


def _unit(key: str, units: Mapping[str, str]) -> str:
    word = units.get(key.rpartition("_")[2]) if "_" in key else None
    return f" ({word})" if word else ""
