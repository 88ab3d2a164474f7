"""A report in a browser, as a file: nothing of it is too wide for a phone, pictures are saved, tables copied."""

import json
from pathlib import Path

import pytest

from tests.rig.conftest import Finished


def opened(chromium, finished: Finished, *, width: int = 1200, scheme: str = "light"):
    context = chromium.new_context(viewport={"width": width, "height": 800}, color_scheme=scheme, accept_downloads=True)
    page = context.new_page()
    page.goto((finished.folder / "report.html").as_uri())
    return page


def colour_of(page, selector: str, what: str) -> list[int]:
    text = page.evaluate("([s, w]) => getComputedStyle(document.querySelector(s))[w]", [selector, what])
    return [int(part) for part in text[text.index("(") + 1 : -1].split(",")[:3]]


@pytest.mark.parametrize("width", [400, 1200])
def test_nothing_is_wider_than_the_window(chromium, finished: Finished, width: int) -> None:
    page = opened(chromium, finished, width=width)
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_it_is_dark_where_the_reader_wants_that_and_light_on_paper(chromium, finished: Finished) -> None:
    page = opened(chromium, finished, scheme="dark")
    assert max(colour_of(page, "body", "backgroundColor")) < 40
    assert min(colour_of(page, "body", "color")) > 200
    page.emulate_media(media="print")
    assert colour_of(page, "body", "backgroundColor") == [255, 255, 255]
    assert max(colour_of(page, "body", "color")) < 60
    assert not page.locator("button.copy").first.is_visible()


def test_a_picture_is_saved_as_the_file_that_it_is(chromium, finished: Finished, tmp_path: Path) -> None:
    page = opened(chromium, finished)
    page.locator("main img:not(.scale)").first.click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Save picture").click()
    download.value.save_as(tmp_path / "picture")
    assert download.value.suggested_filename == "target-as-the-camera-should-see-it.png"
    assert (tmp_path / "picture").read_bytes().startswith(b"\x89PNG")
    page.keyboard.press("Escape")
    assert page.locator(".shown").count() == 0


def test_a_table_is_copied_as_csv_with_each_of_its_rows(chromium, finished: Finished) -> None:
    page = opened(chromium, finished)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.locator("button.copy").first.click()
    page.get_by_text("Copied").wait_for()
    rows = page.evaluate("navigator.clipboard.readText()").strip().split("\n")
    strategies = json.loads((finished.folder / "metrics.json").read_text())["strategies"]
    assert [row.split(",")[0] for row in rows] == ["strategy", *strategies]
    assert '"clipped, %"' in rows[0]
