"""The page can be read by everybody: names for every control, contrast of every text, a phone's width and a 4K wall."""

from typing import Any

import pytest

from tests.rig.page.conftest import Served

VIEWS = ("look", "setup", "runs", "runs/first/watch", "runs/first/pictures", "scene/first", "show")
LEAST_CONTRAST, LEAST_LARGE = 4.5, 3.0
"""WCAG 2.2, level AA: of texts, and of those from 24 px on, or bold from 18.7 px on."""

NAMELESS = """() => [...document.querySelectorAll('button, a[href], input, select, textarea, canvas[role=img], img')]
  .filter((one) => one.checkVisibility())
  .filter((one) => !(one.getAttribute('aria-label') || one.getAttribute('alt') || one.labels?.length
    || one.textContent.trim() || one.querySelector('img[alt]:not([alt=""])') || one.getAttribute('title')))
  .map((one) => one.outerHTML.slice(0, 120))"""
OUT_OF_REACH = """() => [...document.querySelectorAll('[onclick], [tabindex="-1"]')]
  .filter((one) => one.id !== 'main').map((one) => one.outerHTML.slice(0, 120))"""
FAINT = """([least, large]) => {
  const rgba = (text) => { const found = text.match(/[\\d.]+/g).map(Number);
    const of = text.startsWith('color(') ? found.map((one, k) => (k < 3 ? 255 * one : one)) : found;
    return [of[0], of[1], of[2], of[3] ?? 1]; };
  const over = (top, below) => top.slice(0, 3).map((one, k) => one * top[3] + below[k] * (1 - top[3]));
  const ground = (element) => {
    const layers = [];
    for (let one = element; one; one = one.parentElement) layers.push(rgba(getComputedStyle(one).backgroundColor));
    return layers.reverse().reduce((below, top) => over(top, below), [255, 255, 255]);
  };
  const linear = (one) => (one <= 0.04045 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4);
  const light = (colour) => colour.map((one) => linear(one / 255))
    .reduce((sum, one, k) => sum + one * [0.2126, 0.7152, 0.0722][k], 0);
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const element = node.parentElement;
    if (!node.data.trim() || !element.checkVisibility()) continue;
    if (element.closest('noscript, .skip, :disabled, option, .stage')) continue;
    const style = getComputedStyle(element);
    const below = ground(element);
    const lights = [light(over(rgba(style.color), below)), light(below)].sort((a, b) => b - a);
    const ratio = (lights[0] + 0.05) / (lights[1] + 0.05);
    const size = parseFloat(style.fontSize);
    const isLarge = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    if (ratio < (isLarge ? large : least)) found.push(`${node.data.trim().slice(0, 40)}: ${ratio.toFixed(2)}`);
  }
  return found;
}"""


def visit(page: Any, served: Served, view: str) -> None:
    page.goto(f"{served.address}#{view}")
    page.locator("main h1").first.wait_for()
    page.wait_for_timeout(400)


@pytest.mark.parametrize("light", ["dark", "light"])
def test_every_control_has_a_name_and_every_text_its_contrast(chromium: Any, served: Served, light: str) -> None:
    page = chromium.new_page(viewport={"width": 1280, "height": 900})
    page.add_init_script(f"localStorage.setItem('rig-light', '{light}')")
    for view in VIEWS:
        visit(page, served, view)
        assert page.evaluate("document.documentElement.dataset.light") == light
        assert page.evaluate(NAMELESS) == [], view
        assert page.evaluate(OUT_OF_REACH) == [], view
        assert page.evaluate(FAINT, [LEAST_CONTRAST, LEAST_LARGE]) == [], view
    page.close()


@pytest.mark.parametrize(("width", "height", "least_px"), [(400, 800, 12), (3840, 2160, 18)])
def test_a_phone_and_a_wall_show_all_of_it(
    chromium: Any, served: Served, width: int, height: int, least_px: float
) -> None:
    page = chromium.new_page(viewport={"width": width, "height": height})
    served.post("/api/lease", {"do": "take"})  # the longest words are those of who watches another
    visit(page, served, "look")
    page.get_by_text("you watch").wait_for()
    for view in VIEWS:
        visit(page, served, view)
        assert page.evaluate("document.documentElement.scrollWidth") <= width, view
        size = page.evaluate("parseFloat(getComputedStyle(document.body).fontSize)")
        assert size >= least_px
    served.post("/api/lease", {"do": "release"})
    page.close()


def test_a_table_becomes_comma_separated_values(chromium: Any, served: Served) -> None:
    page = chromium.new_page(viewport={"width": 1280, "height": 900})
    visit(page, served, "runs/first/watch")
    page.get_by_role("button", name="Copy as CSV").first.wait_for()
    said = page.evaluate("import('/static/js/dom.js').then((dom) => dom.csvOf(document.querySelector('table.checks')))")
    told = served.get("/api/sessions/first").json()["limits"]
    assert said.splitlines()[0] == ",what,value,limit"
    assert len(said.splitlines()) == 1 + len(told)
    assert said.splitlines()[1].split(",")[:2] == [told[0]["status"], told[0]["what"]]
    page.close()


def test_keys_alone_reach_every_part_and_open_their_own_list(chromium: Any, served: Served) -> None:
    page = chromium.new_page(viewport={"width": 1280, "height": 900})
    visit(page, served, "look")
    for key, part in (("2", "setup"), ("3", "runs"), ("4", "scene"), ("5", "show"), ("1", "look")):
        page.keyboard.press(key)
        page.wait_for_function(f"location.hash === '#{part}'")
    page.keyboard.press("?")
    page.locator("#help[open]").wait_for()
    page.keyboard.press("Escape")
    page.keyboard.press("Tab")
    assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") != "none"  # where one is, is seen
    page.close()
