"""What one meets every day, by the real command line: a plan's title, plain signs, pages, exports, a recommendation."""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from rig.cli.app import run_command
from rig.profile.schema import load_profile
from rig.report import page
from rig.session import Session
from rig.stages.photograph import frame_notes
from tests.rig.conftest import CHROMIUM
from tests.rig.terminal.test_terminal import on_terminal

if TYPE_CHECKING:
    from tests.rig.conftest import Finished

Capture = pytest.CaptureFixture[str]


@pytest.mark.parametrize("columns", [80, 60])
def test_the_title_of_a_plan_is_whole_and_tells_the_time_left(tmp_path: Path, columns: int) -> None:
    folder = tmp_path / "a-session-whose-name-is-about-as-long-as-names-get"
    command = [sys.executable, "-m", "rig", "run", str(folder), "-p", "ci-tiny", "--dry-run"]
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", on_terminal(command, columns)).replace("\r", "")
    title = " ".join(plain[: plain.index("│")].split("┌")[0].split())
    assert re.search(r"with ci-tiny: 0 of 10 steps done, \d+ frames and less than a minute to go", title), plain
    lines = [line for line in plain.splitlines() if str(folder) not in line]
    assert max(map(len, lines)) <= columns


def test_a_terminal_without_utf_8_shows_a_plan_and_a_refusal_in_plain_signs(tmp_path: Path) -> None:
    own = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii", "PYTHONCOERCECLOCALE": "0"}
    for words, status in (
        (["run", str(tmp_path / "new"), "-p", "ci-tiny", "--dry-run"], 0),
        (["run", "--help"], 0),
        (["simulate", "corner", "--tolerance", "0"], 2),
    ):
        said = subprocess.run([sys.executable, "-m", "rig", *words], capture_output=True, env=own, check=False)
        assert said.returncode == status, said.stderr
        assert (said.stdout + said.stderr).isascii()
        assert b"Traceback" not in said.stderr
        assert b"\\u" not in said.stdout + said.stderr


def test_an_export_is_png_unless_said_otherwise(capsys: Capture, finished: Finished, tmp_path: Path) -> None:
    assert run_command(["export", str(finished.folder), "-o", str(tmp_path / "pictures"), "--json"]) == 0
    count = json.loads(capsys.readouterr().out)["files"]
    there = list((tmp_path / "pictures").rglob("*.png"))
    assert len(there) == count > 100
    assert not list((tmp_path / "pictures").rglob("*.exr"))
    assert all(path.read_bytes().startswith(b"\x89PNG\r\n") for path in there[:10])


def test_a_report_is_written_elsewhere_while_another_process_works_on_the_session(
    capsys: Capture, finished: Finished, tmp_path: Path
) -> None:
    folder = shutil.copytree(finished.folder, tmp_path / "session")
    with Session.open(folder):
        before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
        assert run_command(["report", str(folder)]) == 4
        assert run_command(["report", str(folder), "-o", str(tmp_path / "elsewhere.html")]) == 0
        assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
    assert "What each strategy shows" in (tmp_path / "elsewhere.html").read_text("utf-8")
    assert run_command(["report", str(folder), "-o", str(tmp_path / "none" / "elsewhere.html")]) == 2
    assert "there is no folder" in capsys.readouterr().err


@pytest.mark.parametrize(("number", "words"), [(0, "0 events"), (1, "1 event"), (2, "2 events")])
def test_a_report_tells_one_event_and_two_events(
    monkeypatch: pytest.MonkeyPatch, finished: Finished, tmp_path: Path, number: int, words: str
) -> None:
    notes = frame_notes(Session.read(finished.folder))
    assert len(notes) >= number
    monkeypatch.setattr(page, "frame_notes", lambda _: notes[:number])
    assert run_command(["report", str(finished.folder), "-o", str(tmp_path / "report.html")]) == 0
    assert re.search(rf"\d+ frames, {words} \(stale or lost", (tmp_path / "report.html").read_text("utf-8"))


@pytest.fixture
def read_only(finished: Finished, tmp_path: Path) -> Iterator[Path]:
    """A session on a disk that cannot be written; only root can make one."""
    folder = tmp_path / "archive"
    folder.mkdir()
    if subprocess.run(["mount", "--bind", finished.folder, folder], capture_output=True, check=False).returncode:
        pytest.skip("needs the right to mount a file system")
    subprocess.run(["mount", "-o", "remount,bind,ro", folder], check=True)
    yield folder
    subprocess.run(["umount", folder], check=True)


def test_a_session_on_a_disk_that_cannot_be_written_is_read_by_each_verb_that_only_reads(
    capsys: Capture, read_only: Path, tmp_path: Path
) -> None:
    assert run_command(["report", str(read_only)]) == 4
    assert f"rig report {read_only} -o report.html" in " ".join(capsys.readouterr().err.split())
    assert run_command(["report", str(read_only), "-o", str(tmp_path / "report.html")]) == 0
    assert run_command(["export", str(read_only), "-o", str(tmp_path / "pictures")]) == 0
    assert run_command(["run", str(read_only), "--dry-run"]) == 0
    assert run_command(["live", str(read_only), "--source", "pattern", "--seconds", "0.3"]) == 0


def test_a_session_that_another_process_works_on_is_shown_live(finished: Finished, tmp_path: Path) -> None:
    folder = shutil.copytree(finished.folder, tmp_path / "session")
    with Session.open(folder):
        assert run_command(["live", str(folder), "--source", "pattern", "--seconds", "0.3"]) == 0


def test_the_page_of_strategies_opens_with_what_to_use_and_why(finished: Finished, tmp_path: Path) -> None:
    folder = shutil.copytree(finished.folder, tmp_path / "session")
    assert run_command(["compare-strategies", str(folder), "--strategies", "none,direct,bounded"]) == 0
    page = (folder / "strategies.html").read_text("utf-8")
    plain = " ".join(re.sub(r"<[^>]*>", " ", re.sub(r"<(script|style)>.*?</\1>", " ", page, flags=re.DOTALL)).split())
    assert re.search(
        r"Use bounded : photographed, it leaves a mean error of [\d.]+ grey levels", plain.replace(":", " :")
    )
    assert plain.index("photographed, it leaves a mean error") < plain.index("Speed against error")


def test_charts_of_a_check_have_the_lines_of_their_limits(tmp_path: Path) -> None:
    target = tmp_path / "check.html"
    assert run_command(["check", "-p", "ci-tiny", "--only", "latency,linearity", "--report", str(target)]) in (0, 1)
    charts = [
        base64.b64decode(data).decode("utf-8")
        for data in re.findall(r"data:image/svg\+xml;base64,([A-Za-z0-9+/=]+)", target.read_text("utf-8"))
    ]
    assert len(charts) == 2
    for chart in charts:
        assert "<!-- limit " in chart, "words are outlines, their text stands beside them"
        assert "stroke-dasharray" in chart


def test_the_verdict_counts_what_has_a_limit_and_not_what_only_informs(finished: Finished) -> None:
    rows = json.loads((finished.folder / "metrics.json").read_text())["limits"]
    held = sum(row["limit"] is not None for row in rows)
    assert held < len(rows)
    assert f" of {held} limits kept" in (finished.folder / "report.html").read_text("utf-8")


PAGES = {
    "report": "",
    "plan": "plan paper-room --no-search --report {page}",
    "check": "check -p ci-tiny --only latency,linearity --report {page}",
    "strategies": "compare-strategies {session} --strategies none,bounded --only-target --loop none",
    "stopped": "run {session} -p {strict} --json",
}
"""What writes each page that has pictures; the report is there."""


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
@pytest.mark.parametrize("kind", PAGES)
def test_a_picture_of_each_page_enlarges_until_a_click(chromium, finished: Finished, tmp_path: Path, kind: str) -> None:
    session, strict, target = tmp_path / "session", tmp_path / "strict.toml", tmp_path / "page.html"
    shutil.copytree(finished.folder, session)
    text = load_profile("ci-tiny").path.read_text("utf-8")
    strict.write_text(text.replace("distance_m = 4.876", "distance_m = 4.0"), "utf-8")
    if kind != "report":
        run_command(PAGES[kind].format(session=session, strict=strict, page=target).split())
    own = {"report": "report.html", "stopped": "report.html", "strategies": "strategies.html"}
    view = chromium.new_page(viewport={"width": 1200, "height": 800})
    view.goto((session / own[kind] if kind in own else target).as_uri())
    picture = view.locator("main img:not(.scale)").first
    before = picture.bounding_box()["width"]
    picture.click()
    large = view.locator(".shown img")
    assert large.bounding_box()["width"] >= max(before, 0.7 * 1200)
    large.click()
    assert view.locator(".shown").count() == 0
    view.close()
