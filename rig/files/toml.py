"""From what the validator finds in a TOML file to lines that a person can act on."""

from __future__ import annotations

import difflib
import json
import tomllib
import types
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from rig.errors import ProfileError

Model = TypeVar("Model", bound=BaseModel)

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
    try:
        return tomllib.loads(raw.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise ProfileError(f"{path}: byte {error.start} is not UTF-8; save the file as UTF-8 text") from error
    except tomllib.TOMLDecodeError as error:
        raise ProfileError(f"{path}: is not TOML: {error}") from error


def validate(
    model: type[Model],
    data: dict[str, Any],
    path: Path,
    cross_checks: Callable[[dict[str, Any]], list[str]] = lambda _: [],
) -> Model:
    """Build the model from the TOML's data, without any conversion between text, numbers and truth values.

    ``cross_checks`` adds problems ("table.key: what") that no single table shows. Raises ProfileError with
    one line ``FILE: table.key: what`` for each problem.
    """
    problems = cross_checks(data)
    try:
        checked = model.model_validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as error:
        problems += [_line(model, details) for details in error.errors()]
        raise ProfileError(_joined(path, problems)) from error
    if problems:
        raise ProfileError(_joined(path, problems))
    return checked


def _joined(path: Path, problems: list[str]) -> str:
    return "\n".join(f"{path}: {problem}" for problem in dict.fromkeys(problems))


def _line(model: type[BaseModel], error: ErrorDetails) -> str:
    place = ".".join(str(part) for part in error["loc"])
    what = _what(model, error)
    return f"{place}: {what}" if place else what


def _what(model: type[BaseModel], error: ErrorDetails) -> str:
    if error["type"] == "extra_forbidden":
        return f"unknown key{_suggestion(str(error['loc'][-1]), _keys_at(model, error['loc'][:-1]))}"
    if error["type"] == "missing":
        return "missing"
    if error["type"] == "value_error":
        return error["msg"].removeprefix("Value error, ")
    message = error["msg"].removeprefix("Input should be ").replace("Field required", "missing")
    given = error["input"]
    shown = "a table" if isinstance(given, dict) else repr(given)
    return f"is {shown}, should be {message}" if message != error["msg"] else f"{message} (is {shown})"


def _keys_at(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """Keys that the table at a location may have."""
    for part in location:
        if isinstance(part, str):
            field = next((f for k, f in model.model_fields.items() if part in (k, f.alias)), None)
            found = None if field is None else _model_in(field.annotation)
            if found is None:
                return []
            model = found
    return [field.alias or key for key, field in model.model_fields.items()]


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """Find the table's model inside ``X | None`` or ``tuple[X, ...]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    if get_origin(annotation) in (Union, types.UnionType, tuple):
        return next(filter(None, map(_model_in, get_args(annotation))), None)
    return None


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
