"""What `rig plan` prints and writes."""

import json
from pathlib import Path

import pytest

import rig
from rig.cli.app import run_command
from rig.plan.run import ROOMS, run_plan
from tests.rig.plan.rooms import room


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_page_needs_no_other_file_and_shows_room_pictures_and_tables(here: Path) -> None:
    request = room(
        viewer=[{"name": "the guest", "eye_m": [2, 2, 1.6], "stands": True}],
        search={
            "free": [{"key": "projector.throw_ratio", "low": 0.3, "high": 0.6}],
            "goal": [{"measure": "brightness"}, {"measure": "coverage"}],
            "evaluations": 12,
            "width_px": 32,
        },
    )
    run_plan(request, here / "plan.html")
    page = (here / "plan.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 7  # two figures of the room, the front, and four pictures
    assert "http" not in page.replace("http://www.w3.org", "")
    heads = ("The room", "Surfaces, white shown", "Contrast", "the guest", "What this plan says", "best designs")
    assert [words for words in heads if words not in page] == []


def test_json_has_what_the_record_has_and_the_page_takes_the_rooms_name(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command(["plan", "paper-room", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer == rig.plan_room(rig.load_room(ROOMS / "paper-room.toml")).as_json()
    assert (here / "paper-room.html").is_file()


def test_the_terminal_shows_tables_and_sentences(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["plan", "lecture-room", "--no-search", "--report", "lecture.html"]) == 0
    shown = capsys.readouterr().out
    assert "Surfaces, white shown" in shown
    assert "speaker stands in the picture" in shown
    assert "page: lecture.html" in shown


def test_every_room_that_comes_along_can_be_read() -> None:
    rooms = sorted(ROOMS.glob("*.toml"))
    assert len(rooms) >= 3
    assert [rig.load_room(path).name for path in rooms]


def test_a_picture_file_is_found_from_the_room_files_folder(here: Path) -> None:
    import numpy as np

    from rig.files.pictures import write_png

    (here / "files").mkdir()
    write_png(here / "files" / "half.png", np.full((60, 80), 188, dtype=np.uint8))  # sRGB 188 is half of white's light
    text = (ROOMS / "paper-room.toml").read_text().replace('["outdoor", "indoor", "grey"]', '["half.png"]')
    (here / "files" / "own.toml").write_text(text)
    result = rig.plan_room(rig.load_room(here / "files" / "own.toml"))
    assert result.pictures[0].name == "half.png"
    assert result.pictures[0].wanted_mean_cdm2 == pytest.approx(10.0, rel=0.01)
