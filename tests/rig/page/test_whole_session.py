"""A person's whole day on the page, in a browser, from an empty folder: profile, session, fault, stop, report, show."""

from pathlib import Path
from typing import Any

import pytest

from rig.shows.saved import load_show
from tests.rig.page.conftest import PATIENCE_S, Served, serving

ROOT = Path(__file__).parents[3]
CAMERA = '[[simulation.camera]]\nname = "camera"\n'
QUICK = {
    "Closed room at few pixels, for tests": "<img src=x onerror=document.title='taken'>",
    "checker_shifts = 25": "checker_shifts = 9",
    "exposures = [1.0, 8.0]": "exposures = [1.0]",
    "response_levels = 9": "response_levels = 5",
    "patch_size_m = 0.4": "patch_size_m = 0.8",
    "cell_size_m = 0.2": "cell_size_m = 0.4",
}
"""In `ci-tiny`: what makes a session quicker, and the page's work the same; and a text that must stay one."""


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
        page.set_default_timeout(1000 * PATIENCE_S)
        yield Operator(page, served)
        page.close()


@pytest.mark.slow
def test_a_day_at_the_page(operator: Operator) -> None:
    save_a_profile(operator)
    run_with_a_fault_and_a_stop(operator)
    look_at_what_came_out(operator)
    look_through_the_camera(operator)
    show_before_and_after(operator)
    keep_a_show(operator)
    compare_strategies_on_a_phone(operator)
    look_again_after_the_camera_was_turned(operator)
    assert operator.page.title() != "taken"
    assert operator.errors == []


def quick_profile(camera: str) -> str:
    text = (ROOT / "hw_profiles" / "ci-tiny.toml").read_text(encoding="utf-8")
    for slow, quick in {**QUICK, CAMERA: f"{CAMERA}{camera}\n"}.items():
        assert slow in text
        text = text.replace(slow, quick)
    return text


def save_a_profile(operator: Operator) -> None:
    page, text = operator.page, quick_profile("unplugged_s = [[3.0, 4.5]]")
    operator.go("setup")
    operator.reads("Reads well.")
    number = page.locator("[data-key='camera.width_px']")
    number.fill("-1")
    number.blur()
    assert "width_px = -1\n" in page.input_value("#profile-text")  # the form writes into the file's text
    page.locator("pre").filter(has_text="width_px").wait_for()  # what is wrong, before anything is saved
    save_as(operator, "lab", text)
    assert "unplugged_s" in (operator.served.root / "profiles" / "lab.toml").read_text(encoding="utf-8")
    save_as(operator, "turned", quick_profile("turned_deg = [0.0, 0.5, 0.0]"))


def save_as(operator: Operator, name: str, text: str) -> None:
    page = operator.page
    page.fill("#profile-text", text)
    page.fill("#profile-name", name)
    page.click("#profile-save")
    operator.reads(f"{name} is saved")


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


def keep_a_show(operator: Operator) -> None:
    page, served = operator.page, operator.served
    page.fill("#show-name", "evening")
    page.fill("#show-on", "9 to 5")
    page.click("#show-save")
    operator.reads("is no span of a day")
    page.fill("#show-on", "")
    page.click("#show-save")
    operator.reads("evening is saved")
    show, _ = load_show(str(served.root / "shows" / "evening.toml"))
    assert (show.session, show.sources) == ("../evening", ("pattern",))  # what `rig live --show` reads
    page.click("[data-keep=evening]")
    served.until(lambda job: job.get("kind") == "keep" and job["state"].get("frames", 0) > 0)
    operator.reads("evening: running")
    page.click("#show-begin")
    served.until(lambda job: job["kind"] == "keep" and job["phase"] == "done")


def compare_strategies_on_a_phone(operator: Operator) -> None:
    page, served = operator.page, operator.served
    page.set_viewport_size({"width": 400, "height": 800})
    operator.go("runs/evening")
    page.get_by_role("button", name="Compare strategies").click(timeout=1000 * PATIENCE_S)
    done = served.until(lambda job: job.get("kind") == "strategies" and job["phase"] not in ("running", "stopping"))
    assert done["phase"] == "done", done["error"]
    operator.go("runs/evening/strategies")
    operator.reads("clipped")
    assert page.evaluate("document.documentElement.scrollWidth") <= 400  # nothing sticks out of a phone's width


def look_again_after_the_camera_was_turned(operator: Operator) -> None:
    page, served = operator.page, operator.served
    operator.go("runs/evening/watch")
    page.locator("#recheck-profile option[value=turned]").wait_for(state="attached")
    page.select_option("#recheck-profile", "turned")
    page.click("#recheck")
    done = served.until(lambda job: job.get("kind") == "recheck" and job["phase"] not in ("running", "stopping"))
    assert done["phase"] == "done", done["error"]
    found = done["result"]
    assert found["moved"] == "camera"
    assert found["camera"]["turned_deg"] == pytest.approx(0.5, rel=0.1)
    operator.reads("The camera moved, the projector did not")
    moved_px = float(page.inner_text("#recheck-found dd >> nth=0").split()[0])
    assert moved_px == pytest.approx(found["camera"]["image_px"], rel=0.01)
    operator.reads("Maps of this look")
