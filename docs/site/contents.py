"""What the site has to hold: its pages, in the order of the lists of links that people read, and the public names.

An index page lists its pages as ``- [Title](page.md): what it is``, or in a table whose rows begin with a number and
such a link. Code hosts show these lists; for the site each section's list becomes a hidden toctree with the section's
heading as its caption.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
START = "docs/index.md"
INDEXES = (START, "docs/decisions/index.md", "docs/reference/api.md")
"""Pages whose lists are contents."""
OUTSIDE = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "tests/README.md")
"""Pages of the site that do not lie in docs/."""
FRONT_DOORS = {f"docs/reference/api-{package}": package for package in ("rig", "sim", "calibration")}
"""Package whose reference stands on a page."""
ENTRY = re.compile(r"^(?:- |\| (?P<number>\d+) \| )\[(?P<title>[^\]]+)\]\((?P<address>[^)\s#]+\.md)\)", re.MULTILINE)
SECTION = re.compile(r"^## ", re.MULTILINE)


@dataclass(frozen=True)
class Chapter:
    """A section of an index page that lists pages."""

    heading: str
    entries: tuple[tuple[str, str], ...]
    """Each page's title and address."""


def chapters(text: str) -> Iterator[Chapter]:
    """Yield an index page's sections that list pages."""
    for part in SECTION.split("\n" + text):
        heading = "" if part.startswith("\n") else part.partition("\n")[0].strip()
        if entries := tuple((_title(entry), entry["address"]) for entry in ENTRY.finditer(part)):
            yield Chapter(heading, entries)


def _title(entry: re.Match[str]) -> str:
    return f"{entry['number']}. {entry['title']}" if entry["number"] else entry["title"]


def with_toctrees(text: str) -> str:
    """Return an index page with a hidden toctree for each of its lists."""
    return "\n".join([text, *map(_toctree, chapters(text))])


def _toctree(chapter: Chapter) -> str:
    lines = ["", "```{toctree}", ":hidden:", *([f":caption: {chapter.heading}"] if chapter.heading else []), ""]
    return "\n".join([*lines, *(f"{title} <{address}>" for title, address in chapter.entries), "```", ""])


def pages() -> list[str]:
    """Return the names of all pages of the site, as paths from the root."""
    return [*OUTSIDE, *sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md"))]


def reached(start: str = START) -> Iterator[str]:
    """Yield each page that the contents lead to, as often as they do, the start page first."""
    yield start
    if start in INDEXES:
        folder = (ROOT / start).parent
        for chapter in chapters((ROOT / start).read_text(encoding="utf-8")):
            for _, address in chapter.entries:
                yield from reached((folder / address).resolve().relative_to(ROOT).as_posix())


def public_names(package: str) -> list[str]:
    """Return the names that a package declares public."""
    return sorted(getattr(import_module(package), "__all__", ()))
