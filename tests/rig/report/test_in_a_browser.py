"""A report in a browser, as a file: nothing of it is too wide for a phone, pictures are saved, tables copied."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.rig.conftest import Finished

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
playwright = pytest.importorskip("playwright.sync_api")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    with playwright.sync_playwright() as player:
        found = player.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield found
        found.close()


def opened(browser, finished: Finished, *, width: int = 1200, scheme: str = "light"):
    context = browser.new_context(viewport={"width": width, "height": 800}, color_scheme=scheme, accept_downloads=True)
    page = context.new_page()
    page.goto((finished.folder / "report.html").as_uri())
    return page


def colour_of(page, selector: str, what: str) -> list[int]:
    text = page.evaluate("([s, w]) => getComputedStyle(document.querySelector(s))[w]", [selector, what])
    return [int(part) for part in text[text.index("(") + 1 : -1].split(",")[:3]]


@pytest.mark.parametrize("width", [400, 1200])
def test_nothing_is_wider_than_the_window(browser, finished: Finished, width: int) -> None:
    page = opened(browser, finished, width=width)
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_it_is_dark_where_the_reader_wants_that_and_light_on_paper(browser, finished: Finished) -> None:
    page = opened(browser, finished, scheme="dark")
    assert max(colour_of(page, "body", "backgroundColor")) < 40
    assert min(colour_of(page, "body", "color")) > 200
    page.emulate_media(media="print")
    assert colour_of(page, "body", "backgroundColor") == [255, 255, 255]
    assert max(colour_of(page, "body", "color")) < 60
    assert not page.locator("button.copy").first.is_visible()


def test_a_picture_is_saved_as_the_file_that_it_is(browser, finished: Finished, tmp_path: Path) -> None:
    page = opened(browser, finished)
    page.locator("main img:not(.scale)").first.click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Save picture").click()
    download.value.save_as(tmp_path / "picture")
    assert download.value.suggested_filename == "target-as-the-camera-should-see-it.png"
    assert (tmp_path / "picture").read_bytes().startswith(b"\x89PNG")
    page.keyboard.press("Escape")
    assert page.locator(".shown").count() == 0


def test_a_table_is_copied_as_csv_with_each_of_its_rows(browser, finished: Finished) -> None:
    page = opened(browser, finished)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.locator("button.copy").first.click()
    page.get_by_text("Copied").wait_for()
    rows = page.evaluate("navigator.clipboard.readText()").strip().split("\n")
    strategies = json.loads((finished.folder / "metrics.json").read_text())["strategies"]
    assert [row.split(",")[0] for row in rows] == ["strategy", *strategies]
    assert '"clipped, %"' in rows[0]
