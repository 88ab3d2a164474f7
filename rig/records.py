"""Results as frozen records: how they become JSON, how JSON becomes them again, and the one verdict of all.

A result is a frozen dataclass that inherits :class:`Record`; fields are numbers, words, tuples, mappings and other
records. Only the places that read or write JSON see it as anything else.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from html import escape
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, cast

if TYPE_CHECKING:
    from pydantic import TypeAdapter

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"
"""What JSON knows."""
JsonObject: TypeAlias = "dict[str, Json]"
"""One JSON object, as it is read or written."""
RecordType = TypeVar("RecordType")


class Record:
    """A frozen dataclass that can be written as JSON; :func:`read_record` is the way back."""

    def as_json(self) -> JsonObject:
        """The record as one JSON object: its fields by name, those that are None left out."""
        return _object_of(self)

    def _repr_html_(self) -> str:
        """The record as a notebook shows it: a row a field, records within it below each other."""
        return f"<strong>{escape(type(self).__name__)}</strong>{_html_of(self.as_json())}"


_SHOWN_IN_HTML = 12
"""Of a long list; the rest is counted."""


def _html_of(value: Json) -> str:
    if isinstance(value, dict):
        cells = (
            f"<tr><th style='text-align:left'>{escape(key)}</th><td>{_html_of(one)}</td></tr>"
            for key, one in value.items()
        )
        return f"<table>{''.join(cells)}</table>"
    if isinstance(value, list):
        more = f" … {len(value) - _SHOWN_IN_HTML} more" if len(value) > _SHOWN_IN_HTML else ""
        between = "" if any(isinstance(one, dict) for one in value) else ", "
        return between.join(_html_of(one) for one in value[:_SHOWN_IN_HTML]) + more
    if isinstance(value, float):
        return f"{value:.5g}"
    return "" if value is None else escape(str(value))


def _object_of(record: object) -> JsonObject:
    values = ((item.name, getattr(record, item.name)) for item in fields(record))  # type: ignore[arg-type]
    return {name: json_of(value) for name, value in values if value is not None}


def json_of(value: object) -> Json:
    """Return a value as JSON: records, mappings, sequences, paths, numpy numbers and arrays.

    Raises
    ------
    TypeError
        The value, or something in it, has no form in JSON.
    """
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Record):
        return value.as_json()
    if isinstance(value, Mapping):
        return {str(key): json_of(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [json_of(item) for item in value]
    if isinstance(value, PurePath):
        return str(value)
    if is_dataclass(value) and not isinstance(value, type):
        return _object_of(value)
    if hasattr(value, "tolist"):  # numpy's numbers and arrays, without importing numpy for records that have none
        listed: Json = value.tolist()
        return listed
    raise TypeError(f"{type(value).__name__} has no form in JSON; make it a number, a word, a record or a sequence")


def read_record(kind: type[RecordType], value: object) -> RecordType:
    """Return the record of a kind from what was read as JSON, each field checked.

    Raises
    ------
    ValueError
        A field is missing, unknown in type, or of another kind; the message names it.
    """
    from pydantic import ValidationError  # here, so that `rig --help` does not wait for it

    reader: TypeAdapter[RecordType] = _reader(cast("Hashable", kind))
    try:
        return reader.validate_python(value)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        place = ".".join(str(part) for part in first["loc"]) or "the whole"
        raise ValueError(f"{place}: {first['msg']}") from error


@cache
def _reader(kind: Any) -> TypeAdapter[Any]:
    from pydantic import TypeAdapter  # here, so that `rig --help` does not wait for it

    return TypeAdapter(kind)


@dataclass(frozen=True, kw_only=True)
class Verdict(Record):
    """A number against its limit, as sessions, the self-check and benchmarks judge it."""

    what: str
    value: float | None
    """None: it could not be measured, and the advice says why."""
    limit: float | None = None
    """None: a number to know, not judged."""
    unit: str = ""
    at_least: bool = False
    """True: the value must not be below the limit; else not above."""
    advice: str = ""
    """What to try when the limit is not kept."""

    @property
    def met(self) -> bool:
        """Whether the limit is kept, or there is none; never for a value that is not a number."""
        if self.value is None or self.limit is None:
            return True
        return self.value >= self.limit if self.at_least else self.value <= self.limit

    @property
    def status(self) -> str:
        """One word for a table: ok, OUTSIDE, info (no limit) or not measured."""
        if self.value is None:
            return "not measured"
        if self.limit is None:
            return "info"
        return "ok" if self.met else "OUTSIDE"

    def as_json(self) -> JsonObject:
        """All fields, ``value`` and ``limit`` also when there are none, with ``met`` and ``status``."""
        own: JsonObject = {"what": self.what, "value": self.value, "limit": self.limit, "unit": self.unit}
        judged: JsonObject = {"at_least": self.at_least, "met": self.met, "status": self.status, "advice": self.advice}
        return own | judged


def all_met(verdicts: tuple[Verdict, ...]) -> bool:
    """Whether no limit is broken."""
    return all(verdict.met for verdict in verdicts)
