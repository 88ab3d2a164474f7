"""The pictures of the operator's page in docs/how-to/operators-page.md.

After `rig run runs/first -p ci-tiny` and `rig serve runs`:
python docs/images/make_page_pictures.py http://127.0.0.1:8080/ first docs/images
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

SIZE = {"width": 1180, "height": 780}
OPTIONS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def main(address: str, session: str, folder: Path) -> None:
    """Make them all."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=OPTIONS)
        page = browser.new_page(viewport=SIZE)

        def until(expression: str) -> None:
            for _ in range(300):
                if page.evaluate(expression):
                    return
                page.wait_for_timeout(200)
            raise TimeoutError(expression)

        page.goto(f"{address}#look")
        page.locator("#look-profile option[value=ci-tiny]").wait_for(state="attached")
        page.select_option("#look-profile", "ci-tiny")
        page.click("#look")
        until("document.querySelectorAll('.thirds span').length === 9")
        page.wait_for_timeout(8000)
        keep(page, folder / "page-look.jpg")
        page.click("#look")
        page.goto(f"{address}#runs/{session}/pictures")
        until("document.querySelector('#under')?.children.length > 0")
        keep(page, folder / "page-pictures.jpg")
        page.goto(f"{address}#scene/{session}")
        until("document.querySelector('#scene')?.width > 300")
        page.wait_for_timeout(1000)
        page.locator("#scene").click(position={"x": 420, "y": 280})
        keep(page, folder / "page-scene.jpg")
        page.goto(f"{address}#show")
        page.locator(f"#show-session option[value='session:{session}']").wait_for(state="attached")
        page.select_option("#show-session", f"session:{session}")
        page.click("#show-begin")
        until("Number(document.querySelector('#on-screen').dataset.frames ?? 0) > 2")
        page.wait_for_timeout(8000)
        keep(page, folder / "page-show.jpg")
        page.click("#show-begin")
        browser.close()


def keep(page: Any, path: Path) -> None:
    """Write what is seen as a small file."""
    page.screenshot(path=path, type="jpeg", quality=62)
    print(path, path.stat().st_size)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], Path(sys.argv[3]))
