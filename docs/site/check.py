"""Hold a built site to account: ``python docs/site/check.py FOLDER`` after the build (``make docs``).

Every local link and anchor leads somewhere, no page takes anything from the network, and every public name of the
three front doors has its place. Ends by printing the path of the start page.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from contents import FRONT_DOORS, pages, public_names

START = "docs/index.html"
LOADS = {"img": "src", "script": "src", "link": "href", "iframe": "src", "source": "src"}
"""Attributes whose address a browser fetches without being asked."""
CSS_ADDRESS = re.compile(r"""url\(\s*['"]?([^'")]+)|@import\s+['"]([^'"]+)""")


@dataclass
class Page(HTMLParser):
    """What a page can be reached by, and what it refers to."""

    anchors: set[str] = field(default_factory=set)
    links: list[str] = field(default_factory=list)
    loads: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect an element's id and addresses."""
        values = {name: value for name, value in attrs if value}
        self.anchors |= {values[name] for name in ("id", "name") if name in values}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if LOADS.get(tag) in values and values.get("rel") != "canonical":
            self.loads.append(values[LOADS[tag]])


def read(file: Path) -> Page:
    """Parse one page."""
    page = Page()
    page.feed(file.read_text(encoding="utf-8"))
    return page


def dead_links(site: Path, parsed: dict[Path, Page]) -> Iterator[str]:
    """Yield each local address of a page that leads to no file, or to a place that its page lacks."""
    for file, page in parsed.items():
        for address in {*page.links, *page.loads}:
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            anchors = parsed[target].anchors if target in parsed else None
            missing_place = anchors is not None and parts.fragment and unquote(parts.fragment) not in anchors
            if not target.is_file() or missing_place:
                yield f"{file.relative_to(site)}: {address} leads nowhere"


def taken_from_the_network(site: Path, parsed: dict[Path, Page]) -> Iterator[str]:
    """Yield each address on another machine that a page or style sheet fetches while it is looked at."""
    for file, page in parsed.items():
        yield from (f"{file.relative_to(site)}: loads {load}" for load in page.loads if _is_remote(load))
    for file in site.rglob("*.css"):
        for match in CSS_ADDRESS.finditer(file.read_text(encoding="utf-8")):
            address = match[1] or match[2]
            if _is_remote(address):
                yield f"{file.relative_to(site)}: loads {address}"


def _is_remote(address: str) -> bool:
    return address.startswith("//") or urlsplit(address).scheme in {"http", "https"}


def missing_pages(site: Path) -> Iterator[str]:
    """Yield each page of the sources that the site lacks."""
    yield from (f"{name}: not on the site" for name in pages() if not (site / name).with_suffix(".html").is_file())


def missing_names(site: Path, parsed: dict[Path, Page]) -> Iterator[str]:
    """Yield each public name without a place on its front door's page, and each front door that shows nothing."""
    for name, package in FRONT_DOORS.items():
        anchors = parsed[site / f"{name}.html"].anchors
        if not public_names(package):
            yield f"{name}.html: {package} declares no public name (__all__)"
        for public in public_names(package):
            # A module's own anchor has a prefix.
            if not {f"{package}.{public}", f"module-{package}.{public}"} & anchors:
                yield f"{name}.html: {package}.{public} is missing"


def complaints(site: Path) -> list[str]:
    """Return everything that is wrong with a site, a line each."""
    parsed = {file: read(file) for file in sorted(site.rglob("*.html")) if "_static" not in file.parts}
    checks = (dead_links(site, parsed), taken_from_the_network(site, parsed), missing_pages(site))
    found = [line for check in checks for line in sorted(check)]
    return found or sorted(missing_names(site, parsed))


def main() -> int:
    """Check the site in the folder that the command line names."""
    site = Path(sys.argv[1]).resolve()
    found = complaints(site)
    print("\n".join(found) or f"{site / START}", file=sys.stderr if found else sys.stdout)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
