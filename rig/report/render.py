"""Templates to pages that need no other file."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader


def rendered(template: str, context: Mapping[str, Any]) -> str:
    """A page from a template, named by the room and the file it lies in: ``report/session.html``."""
    environment = Environment(autoescape=True, loader=FunctionLoader(_text_of))
    return environment.get_template(template).render(context)


def headline_of(value: float, unit: str, text: str) -> dict[str, str]:
    """A number at the top of a page, and what it is."""
    return {"value": f"{value:.2f}", "unit": unit, "text": text}


def _text_of(name: str) -> str:
    return files("rig").joinpath(name).read_text(encoding="utf-8")
