"""The pages hang together: contents, links and anchors; and the check of a built site finds what is wrong with one."""

import re
import sys
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs" / "site"))

import check  # noqa: E402
import contents  # noqa: E402

BLOCK = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")


def text_of(page: str) -> str:
    return BLOCK.sub("", (ROOT / page).read_text(encoding="utf-8"))


def anchors(page: str) -> set[str]:
    """Anchors that code hosts give a page's headings."""
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in HEADING.findall(text_of(page))}


def test_the_contents_lead_to_every_page_once() -> None:
    assert Counter(contents.reached()) == Counter(contents.pages())


def test_the_readme_leads_to_the_start_page() -> None:
    assert f"]({contents.START})" in text_of("README.md")


@pytest.mark.parametrize("page", contents.pages())
def test_anchors_of_links_are_headings(page: str) -> None:
    targets = [target.partition("#") for target in LINK.findall(text_of(page)) if "://" not in target]
    missing = []
    for file, _, anchor in targets:
        there = ((ROOT / page).parent / file).resolve().relative_to(ROOT).as_posix() if file else page
        if anchor and anchor not in anchors(there):
            missing.append(f"{file}#{anchor}")
    assert missing == []


def test_an_index_page_becomes_its_toctrees() -> None:
    page = "# Start\n- [One](a.md): first\n\n## More\nA word on [that](other.md).\n\n| 7 | [Two](b/c.md) | x |\n"
    added = contents.with_toctrees(page).removeprefix(page)
    assert added.split() == [
        *("```{toctree}", ":hidden:", "One", "<a.md>", "```"),
        *("```{toctree}", ":hidden:", ":caption:", "More", "7.", "Two", "<b/c.md>", "```"),
    ]


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """A site of all pages, each of which names every public name and leads to the start page."""
    names = [
        f"{package}.{name}" for package in contents.FRONT_DOORS.values() for name in contents.public_names(package)
    ]
    places = "".join(f'<p id="{name}">' for name in names)
    for page in contents.pages():
        file = (tmp_path / page).with_suffix(".html")
        file.parent.mkdir(parents=True, exist_ok=True)
        up = "../" * page.count("/")
        file.write_text(f'<a href="{up}docs/index.html#top">start</a><p id="top">{places}', encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize(
    ("planted", "complaint"),
    [
        ('<a href="gone.html">', "gone.html leads nowhere"),
        ('<a href="index.html#gone">', "index.html#gone leads nowhere"),
        ('<img src="gone.png">', "gone.png leads nowhere"),
        ('<script src="https://example.org/a.js"></script>', "loads https://example.org/a.js"),
        ('<link rel="stylesheet" href="//example.org/a.css">', "loads //example.org/a.css"),
    ],
)
def test_what_is_wrong_with_a_page_is_found(site: Path, planted: str, complaint: str) -> None:
    start = site / "docs" / "index.html"
    start.write_text(start.read_text(encoding="utf-8") + planted, encoding="utf-8")
    assert f"docs/index.html: {complaint}" in check.complaints(site)


def test_a_style_sheet_that_takes_a_font_from_the_network_is_found(site: Path) -> None:
    (site / "a.css").write_text("@font-face { src: url('https://example.org/a.woff2') }", encoding="utf-8")
    assert check.complaints(site) == ["a.css: loads https://example.org/a.woff2"]


def test_links_to_other_places_and_within_a_page_are_no_complaint(site: Path) -> None:
    start = site / "docs" / "index.html"
    links = '<a href="https://example.org">there</a><a href="#top">up</a><a href="../README.html">what it is</a>'
    start.write_text(start.read_text(encoding="utf-8") + links, encoding="utf-8")
    assert [line for line in check.complaints(site) if "index.html" in line] == []


def test_a_missing_page_is_found(site: Path) -> None:
    (site / "CHANGELOG.html").unlink()
    assert "CHANGELOG.md: not on the site" in check.complaints(site)


def test_a_missing_public_name_is_found(site: Path) -> None:
    page = site / "docs" / "reference" / "api-rig.html"
    page.write_text(page.read_text(encoding="utf-8").replace('id="rig.open_rig"', ""), encoding="utf-8")
    assert "docs/reference/api-rig.html: rig.open_rig is missing" in check.complaints(site)
