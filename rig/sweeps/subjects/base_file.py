"""Parameters as settings of a TOML file, and results as figures: dotted names, tables of a list by their names."""

from __future__ import annotations

import difflib
import hashlib
import tomllib
from collections.abc import Iterator, Mapping
from copy import deepcopy

from rig.errors import ProfileError
from rig.files.toml import toml_text
from rig.records import Json, JsonObject
from rig.sweeps.records import Figure

_Node = dict[str, object]
_NAMES = ("name", "strategy", "surface", "person")
"""What tells the records of a list apart, where they have it."""


def text_with(base: str, settings: Mapping[str, object]) -> bytes:
    """Return a TOML file's text with settings put in.

    Parameters
    ----------
    base
        The file's text.
    settings
        Values by dotted name: ``simulation.reflectance.floor``. In a list of tables the name of one stands between:
        ``camera.left.bit_depth``; where there is one table, it may be left out.

    Raises
    ------
    ProfileError
        There is no table for a setting; a line each.
    """
    data: _Node = deepcopy(tomllib.loads(base))
    problems = [problem for name, value in settings.items() if (problem := _put(data, name, value))]
    if problems:
        raise ProfileError("\n".join(problems))
    return toml_text(data).encode()


def digest_of(base: str) -> str:
    """Return what stands for a base file in a point's inputs: another file makes other points."""
    return hashlib.sha256(base.encode()).hexdigest()[:16]


def figures_of(result: JsonObject, left_out: tuple[str, ...] = (), before: str = "") -> Iterator[tuple[str, Figure]]:
    """Yield a result's numbers and truth values by dotted name, records of a list by what they are called.

    Parameters
    ----------
    result
        A record as JSON.
    left_out
        Names that are no figures.
    before
        What the names begin with.
    """
    for key, value in result.items():
        if f"{before}{key}" not in left_out:
            yield from _figures_in(value, f"{before}{key}")


def _figures_in(value: Json, name: str) -> Iterator[tuple[str, Figure]]:
    if isinstance(value, dict):
        yield from figures_of(value, before=f"{name}.")
    elif isinstance(value, list):
        for one in value:
            word = next((str(one[key]) for key in _NAMES if key in one), "") if isinstance(one, dict) else ""
            if word:
                yield from _figures_in(one, f"{name}.{word}")
    elif isinstance(value, bool | int | float):
        yield name, value


def _put(data: _Node, name: str, value: object) -> str:
    """Put one setting in; return what is wrong with its name, if anything is."""
    here: _Node = data
    words = name.split(".")
    k = 0
    while k < len(words) - 1:
        found = here.get(words[k])
        if isinstance(found, list):
            found, used = _one_of(found, words[k + 1])
            k += used
        if not isinstance(found, dict):
            return f"{name}: there is no table {'.'.join(words[: k + 1])}{_near(words[k], here)}"
        here = found
        k += 1
    if isinstance(here.get(words[-1]), dict | list) and not isinstance(value, dict | list):
        return f"{name}: is a table or a list, not one value"
    here[words[-1]] = value
    return ""


def _one_of(tables: list[object], word: str) -> tuple[object, int]:
    """Return the table of a name, and how many words named it."""
    for table in tables:
        if isinstance(table, dict) and table.get("name") == word:
            return table, 1
    return (tables[0], 0) if len(tables) == 1 else (None, 0)


def _near(word: str, table: _Node) -> str:
    tables = [key for key, value in table.items() if isinstance(value, dict | list)]
    near = difflib.get_close_matches(word, tables, n=1)
    return f"; did you mean {near[0]}?" if near else f"; there are {', '.join(tables)}"
