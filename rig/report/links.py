"""Pages of one folder that know of each other: the session's report, its strategies, the check of its rig."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from pathlib import Path

from rig.files.atomic import write_bytes

PAGES: Mapping[str, str] = {
    "report.html": "Session report",
    "strategies.html": "Strategies side by side",
    "check.html": "Check of the rig",
}
"""Titles by file, in the order in which they are linked."""
_BEGIN, _END = b"<!--pages-->", b"<!--/pages-->"


def link_pages(folder: Path) -> None:
    """Write into each page of a folder links to the others that are there. Raises SessionError."""
    there = [name for name in PAGES if (folder / name).is_file()]
    for name in there:
        page = (folder / name).read_bytes()
        before, begin, rest = page.partition(_BEGIN)
        _, end, after = rest.partition(_END)
        links = [f'<a href="{escape(other)}">{escape(PAGES[other])}</a>' for other in there if other != name]
        linked = before + begin + " · ".join(links).encode() + end + after
        if begin and end and linked != page:
            write_bytes(folder / name, linked)
