"""Templates to pages that need no other file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from importlib.resources import files

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup, escape

from rig.records import Record
from rig.report.terms import explanation


@dataclass(frozen=True)
class Headline:
    """A number at the top of a page, and what it is."""

    value: str
    unit: str
    text: str


@dataclass(frozen=True)
class TextTable:
    """A table whose cells are words."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]


def rendered(template: str, page: object) -> str:
    """Return a page from a template and what it shows.

    Parameters
    ----------
    template
        The room and the file it lies in: ``report/session.html``.
    page
        A record whose fields are the template's names, or a mapping.
    """
    environment = Environment(autoescape=True, loader=FunctionLoader(_text_of), undefined=StrictUndefined)
    environment.globals["explain"] = _explained
    environment.filters["number"] = _number
    return environment.get_template(template).render(_names_of(page))


def _names_of(page: object) -> Mapping[str, object]:
    if isinstance(page, Mapping):
        return page
    if is_dataclass(page):
        return {field.name: getattr(page, field.name) for field in fields(page)}
    raise TypeError(f"a page is a record or a mapping, not {type(page).__name__}")


def _number(value: float | None, form: str) -> str:
    """A number as a format has it; a dash where there is none: not measured, or without a limit."""
    return "–" if value is None else form % value


def _explained(text: str) -> Markup:
    """A word, with what it means where a pointer rests on it."""
    meaning = explanation(text)
    return Markup('<abbr title="{}">{}</abbr>').format(meaning, text) if meaning else escape(text)


def embedded_json(record: Record) -> Markup:
    """Return a record as JSON that can stand in a page: no text in it ends the element that holds it."""
    text = json.dumps(record.as_json(), separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c"))  # what is left is data of a script element, not markup


def headline_of(value: float, unit: str, text: str) -> Headline:
    """Return a number at the top of a page, and what it is."""
    return Headline(f"{value:.2f}", unit, text)


def _text_of(name: str) -> str:
    return files("rig").joinpath(name).read_text(encoding="utf-8")
