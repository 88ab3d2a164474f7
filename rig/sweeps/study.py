"""A study's file: which subject is asked, and over which parameters; every mistake in it is named at once."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from rig.errors import ProfileError
from rig.files.toml import Table, read_model

MOST_POINTS = 1_000_000
"""Of a study: their names fit into memory, and a table of them can still be read."""
_STEPS = {"from", "to", "count"}


class Steps(Table):
    """Equal steps from one number to another, both included."""

    from_: Annotated[float, Field(alias="from")]
    to: float
    count: Annotated[int, Field(ge=1, le=MOST_POINTS)]


class LatinHypercube(Table):
    """Samples that fill ranges evenly."""

    points: Annotated[int, Field(ge=1, le=MOST_POINTS)]
    seed: Annotated[int, Field(ge=0)] = 1
    ranges: dict[str, object]


class StudyPage(Table):
    """What the page draws; left out: the first figures against all parameters that vary."""

    figures: tuple[str, ...] = ()
    against: tuple[str, ...] = ()


class StudyTable(Table):
    """A study."""

    schema_: Annotated[Literal[1], Field(alias="schema")]
    title: str = ""
    subject: str
    base: str | None = None
    """File or name that the parameters are settings of; None where the subject needs none."""
    arrays: bool = False
    tries: Annotated[int, Field(ge=1, le=100)] = 3
    fixed: dict[str, object] = Field(default_factory=dict)
    grid: dict[str, object] = Field(default_factory=dict)
    list_: Annotated[tuple[dict[str, object], ...], Field(alias="list")] = ()
    latin_hypercube: LatinHypercube | None = None
    page: StudyPage = StudyPage()


def read_study(path: Path) -> StudyTable:
    """Read a study.

    Raises
    ------
    ProfileError
        It cannot be read, or there is something wrong with it, a line each.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ProfileError(f"{path}: cannot be read: {error.strerror}; give the file of a study") from error
    return read_model(StudyTable, raw, path, _problems)


def flattened(table: Mapping[str, object], before: str = "") -> dict[str, object]:
    """Return a table's values by dotted name; steps (from, to, count) are a value."""
    values: dict[str, object] = {}
    for key, value in table.items():
        if isinstance(value, Mapping) and set(value) != _STEPS:
            values |= flattened(value, f"{before}{key}.")
        else:
            values[f"{before}{key}"] = value
    return values


def _problems(data: dict[str, Any]) -> list[str]:
    """Find what no single table shows: empty axes, ranges that are none, parameters that are set twice."""
    tables = {name: data[name] for name in ("fixed", "grid") if isinstance(data.get(name), dict)}
    found = [*_empty_axes(tables.get("grid", {})), *_bad_ranges(data.get("latin_hypercube"))]
    places: dict[str, str] = {}
    for place, name in _named(data, tables):
        if places.setdefault(name, place) != place:
            found.append(f"{place}.{name}: is set in [{places[name]}] already; leave one of the two out")
    return found


def _named(data: Mapping[str, Any], tables: Mapping[str, Mapping[str, object]]) -> Iterator[tuple[str, str]]:
    for place, table in tables.items():
        yield from ((place, name) for name in flattened(table))
    cube = data.get("latin_hypercube")
    ranges = cube.get("ranges") if isinstance(cube, dict) else None
    if isinstance(ranges, dict):
        yield from (("latin_hypercube.ranges", name) for name in flattened(ranges))
    rows = data.get("list")
    for row in rows if isinstance(rows, list) else []:
        if isinstance(row, dict):
            yield from (("list", name) for name in flattened(row))


def _empty_axes(grid: Mapping[str, object]) -> Iterator[str]:
    for name, values in flattened(grid).items():
        if isinstance(values, Mapping):
            yield from _bad_steps(f"grid.{name}", values)
        elif not isinstance(values, list):
            yield f"grid.{name}: is {values!r}, should be a list or {{from, to, count}}; one value belongs to [fixed]"
        elif not values:
            yield f"grid.{name}: is empty, so the study has no point; give values, or leave the parameter out"


def _bad_steps(place: str, steps: Mapping[str, object]) -> Iterator[str]:
    count = steps["count"]
    if type(count) is not int or not 1 <= count <= MOST_POINTS:
        yield f"{place}: count is {count!r}, should be 1 ... {MOST_POINTS}"
    for key in ("from", "to"):
        if not _is_number(steps[key]):
            yield f"{place}: {key} is {steps[key]!r}, should be a number"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _bad_ranges(cube: object) -> Iterator[str]:
    ranges = cube.get("ranges") if isinstance(cube, dict) else None
    if not isinstance(ranges, dict):
        return
    if not ranges:
        yield "latin_hypercube.ranges: is empty; give parameter = [low, high]"
    for name, ends in flattened(ranges).items():
        numbers = isinstance(ends, list) and len(ends) == 2 and all(map(_is_number, ends))
        if not numbers or not ends[0] < ends[1]:  # type: ignore[index]
            yield f"latin_hypercube.ranges.{name}: is {ends!r}, should be [low, high] with low below high"
