"""A person's whole day on the page, in a browser, from an empty folder: profile, session, fault, stop, report, show."""

from pathlib import Path
from typing import Any

import pytest

from tests.rig.page.conftest import PATIENCE_S, Served, serving

ROOT = Path(__file__).parents[3]
UNPLUGGED = '[[simulation.camera]]\nname = "camera"\nunplugged_s = [[3.0, 4.5]]'


class Operator:
    """Somebody at the page."""

    def __init__(self, page: Any, served: Served) -> None:
        self.page, self.served = page, served
        self.errors: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", self.hear)

    def hear(self, said: Any) -> None:
        """Note what a script or the content policy complains of; that something is not there yet is an answer."""
        if said.type == "error" and not said.text.startswith("Failed to load resource"):
            self.errors.append(said.text)

    def go(self, part: str) -> None:
        self.page.goto(f"{self.served.address}#{part}")

    def until(self, expression: str) -> None:
        for _ in range(int(PATIENCE_S * 5)):
            if self.page.evaluate(expression):
                return
            self.page.wait_for_timeout(200)
        raise TimeoutError(f"{expression}: {self.page.inner_text('body')[:1500]}")

    def reads(self, text: str) -> None:
        self.page.get_by_text(text).filter(visible=True).first.wait_for(timeout=1000 * PATIENCE_S)


@pytest.fixture
def operator(chromium: Any, tmp_path: Path) -> Any:
    with serving(tmp_path / "runs") as served:
        page = chromium.new_page(viewport={"width": 1280, "height": 900})
        yield Operator(page, served)
        page.close()


@pytest.mark.slow
def test_a_day_at_the_page(operator: Operator) -> None:
    save_a_profile(operator)
    run_with_a_fault_and_a_stop(operator)
    look_at_what_came_out(operator)
    look_through_the_camera(operator)
    show_before_and_after(operator)
    assert operator.errors == []


def save_a_profile(operator: Operator) -> None:
    page = operator.page
    operator.go("setup")
    operator.reads("Reads well.")
    text = (ROOT / "hw_profiles" / "ci-tiny.toml").read_text(encoding="utf-8")
    page.fill("#profile-text", text.replace("width_px = 320", "width_px = -1"))
    operator.reads("width_px")  # what is wrong, before anything is saved
    page.fill("#profile-text", text.replace('[[simulation.camera]]\nname = "camera"', UNPLUGGED))
    page.fill("#profile-name", "lab")
    page.click("#profile-save")
    operator.reads("lab is saved")
    assert "unplugged_s" in (operator.served.root / "profiles" / "lab.toml").read_text(encoding="utf-8")


def run_with_a_fault_and_a_stop(operator: Operator) -> None:
    page, served = operator.page, operator.served
    operator.go("runs")
    page.fill("#session-name", "evening")
    page.locator("#session-profile option[value=lab]").wait_for(state="attached")
    page.select_option("#session-profile", "lab")
    page.click("#start")
    served.until(lambda job: "gray" in str(job.get("label")) or job["phase"] == "failed")
    page.click("#stop")
    stopped = served.until(lambda job: job["phase"] not in ("running", "stopping"))
    assert stopped["phase"] == "stopped"
    operator.reads("stopped; start it again to go on")
    page.click("#resume")
    done = served.until(lambda job: job["number"] == 2 and job["phase"] not in ("running", "stopping"))
    assert done["phase"] == "done", done["error"]
    assert done["result"]["measured"]["compensated"]["mean"] < 0.5 * done["result"]["measured"]["uncompensated"]["mean"]
    operator.reads("All steps are done.")
    operator.reads("unplugged")
    assert page.locator(".steps li.done").count() == 10


def look_at_what_came_out(operator: Operator) -> None:
    page, served = operator.page, operator.served
    operator.go("runs/evening/pictures")
    operator.until("document.querySelector('#under')?.children.length > 0")
    said = float(page.inner_text("#under dd >> nth=0"))
    told = served.get("/api/sessions/evening").json()["listed"]["measured_mean"]
    assert said == pytest.approx(told, rel=0.02)  # the browser's own sum is the session's
    page.click("[data-mode=error]")
    operator.go("runs/evening/report")
    page.frame_locator("iframe").get_by_text("Session evening").first.wait_for(timeout=1000 * PATIENCE_S)
    operator.go("scene/evening")
    operator.until("document.querySelector('#scene')?.width > 300")
    page.locator("#scene").click(position={"x": 420, "y": 300})
    operator.reads("Confidence")


def look_through_the_camera(operator: Operator) -> None:
    page = operator.page
    operator.go("look")
    page.locator("#look-profile option[value=ci-tiny]").wait_for(state="attached")
    page.select_option("#look-profile", "ci-tiny")
    page.click("#look")
    operator.until("Number(document.querySelector('.view canvas').dataset.frames ?? 0) > 3")
    page.keyboard.press("]")
    operator.served.until(lambda job: job["state"].get("exposure_s", 0) > 0.02)
    page.click("[data-pattern=white]")
    operator.served.until(lambda job: job["state"].get("picture") == "white")
    operator.reads("Sharpness")
    page.click("#look")
    operator.served.until(lambda job: job["phase"] == "done")


def show_before_and_after(operator: Operator) -> None:
    page, served = operator.page, operator.served
    operator.go("show")
    page.locator("#show-session option").first.wait_for(state="attached")
    page.select_option("#show-session", "session:evening")
    page.click("#show-begin")
    operator.until("Number(document.querySelector('#on-screen').dataset.frames ?? 0) > 2")
    page.keyboard.press("c")
    served.until(lambda job: job["state"].get("compensating") is False)
    page.keyboard.press("c")
    served.until(lambda job: job["state"].get("compensating") is True)
    page.keyboard.press("b")
    served.until(lambda job: job["state"].get("black") is True)
    page.click("#show-begin")
    over = served.until(lambda job: job["phase"] not in ("running", "stopping"))
    assert over["result"]["frames"] > 0
    assert over["result"]["ended_by"] == "quit"


@pytest.mark.slow
def test_strategies_are_compared_from_the_page(chromium: Any, served: Served) -> None:
    page = chromium.new_page(viewport={"width": 400, "height": 800})
    operator = Operator(page, served)
    operator.go("runs/first")
    page.get_by_role("button", name="Compare strategies").click(timeout=1000 * PATIENCE_S)
    done = served.until(lambda job: job.get("kind") == "strategies" and job["phase"] not in ("running", "stopping"))
    assert done["phase"] == "done", done["error"]
    operator.go("runs/first/strategies")
    operator.reads("clipped")
    width = page.evaluate("document.documentElement.scrollWidth")
    assert width <= 400  # nothing sticks out of a phone's width
    page.close()
