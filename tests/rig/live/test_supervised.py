"""What a supervisor learns from a show's exit status: each way to end has one of its own."""

import json
import os
import signal
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from rig.cli.app import run_command
from rig.devices.clock import SystemClock
from rig.devices.protocols import Codes, Shown
from rig.devices.simulated.display import ClockedDisplay
from rig.files.pictures import write_png
from rig.live import pipeline, run
from rig.live.sources import files, raw

CAMERA, FILM, PICTURE, GONE, STREAM = 20, 21, 22, 23, 24


class Watched(ClockedDisplay):
    """Tells somebody of each picture that it shows."""

    on_show: Callable[[int], None] = staticmethod(lambda _: None)

    def show(self, codes: Codes, *, name: str) -> Shown:
        shown = super().show(codes, name=name)
        Watched.on_show(int(codes.max()))
        return shown


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> type[Watched]:
    monkeypatch.setattr(pipeline, "ClockedDisplay", Watched)
    monkeypatch.setattr(Watched, "on_show", staticmethod(lambda _: None))
    return Watched


def write_film(path: Path, pictures: int = 5) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for k in range(pictures):
        writer.write(np.full((48, 64, 3), (40 * k + 20) % 250, np.uint8))
    writer.release()
    return path


def show(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, dict]:
    command = ["live", "-p", "ci-tiny", "--strategy", "none", "--json", *(str(word) for word in words)]
    status = run_command(command)
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return status, json.loads(captured.out)


def broken_film(folder: Path) -> str:
    (folder / "film.avi").write_bytes(b"RIFF no film")
    return str(folder / "film.avi")


def cut_film(folder: Path) -> str:
    film = write_film(folder / "film.avi", 40)
    film.write_bytes(film.read_bytes()[: film.stat().st_size // 3])
    return str(film)


def letter(folder: Path) -> str:
    (folder / "letter.png").write_text("Dear camera,")
    return str(folder / "letter.png")


def light(folder: Path) -> str:
    (folder / "light.exr").write_bytes(b"v/1\x01")
    return str(folder / "light.exr")


def folder_of_letters(folder: Path) -> str:
    letter(folder)
    return str(folder)


@pytest.mark.parametrize(
    ("make", "status", "kind"),
    [
        (lambda _: "camera:none", CAMERA, "CameraMissing"),
        (broken_film, FILM, "FilmBroken"),
        (cut_film, FILM, "FilmBroken"),
        (letter, PICTURE, "PictureBroken"),
        (light, PICTURE, "PictureBroken"),
        (folder_of_letters, PICTURE, "PictureBroken"),
        (lambda folder: f"pipe:{folder}", STREAM, "PipeBroken"),
        (lambda _: "shm:there-is-none", STREAM, "PipeBroken"),
    ],
)
def test_each_source_that_fails_has_a_status_of_its_own(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, make: Callable[[Path], str], status: int, kind: str
) -> None:
    ended, told = show(capsys, "--source", make(tmp_path), "--seconds", "20")
    assert ended == status
    assert told["ended_by"] == "source"
    assert told["failure"]["kind"] == kind
    assert told["failure"]["exit_status"] == status
    assert told["failure"]["message"] in told["notes"]


def test_a_show_in_which_nothing_was_seen_says_so_and_why_instead_of_a_table_without_numbers(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert run_command(["live", "-p", "ci-tiny", "--source", broken_film(tmp_path)]) == FILM
    captured = capsys.readouterr()
    assert "no picture was shown" in captured.out
    assert "latency" not in captured.out
    assert "no video that can be read" in captured.err


def test_a_pipe_that_nobody_writes_to_is_no_show_that_went_well(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "FIRST_PICTURE_S", 0.2)
    os.mkfifo(tmp_path / "silent")
    ended, told = show(capsys, "--source", tmp_path / "silent", "--seconds", "0.3")
    assert (ended, told["ended_by"], told["frames"]) == (STREAM, "time", 0)
    assert told["failure"]["message"].startswith("silent: no picture came in 0.5 s; ")


def test_a_source_so_slow_that_the_time_is_over_before_it_fails_is_told_all_the_same(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SystemClock()
    monkeypatch.setattr(run, "FIRST_PICTURE_S", 0.0)
    monkeypatch.setattr(raw.StreamSource, "open", lambda _: clock.wait_until_s(clock.now_s() + 0.4))
    ended, told = show(capsys, "--source", f"pipe:{tmp_path}", "--seconds", "0.1")
    assert (ended, told["ended_by"], told["frames"]) == (STREAM, "time", 0)


def test_the_time_of_a_show_begins_with_its_first_picture(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, opened = SystemClock(), files.PatternSource.open

    def open_late(source: files.PatternSource) -> None:
        clock.wait_until_s(clock.now_s() + 0.6)
        opened(source)

    monkeypatch.setattr(files.PatternSource, "open", open_late)
    ended, told = show(capsys, "--source", "pattern", "--seconds", "0.2")
    assert (ended, told["ended_by"], told["frames"] > 0) == (0, "time", True)
    assert told["seconds"] >= 0.8


def test_a_source_that_fails_is_told_also_when_the_next_one_is_shown(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    good = write_film(tmp_path / "good.avi")
    ended, told = show(capsys, "--source", letter(tmp_path), "--source", good)
    assert ended == PICTURE
    assert told["frames"] > 0


def test_a_film_that_is_deleted_while_it_loops(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, watched: type[Watched]
) -> None:
    film = write_film(tmp_path / "film.avi")
    shown = iter(range(1000))
    watched.on_show = staticmethod(lambda _: film.unlink(missing_ok=True) if next(shown) == 7 else None)
    ended, told = show(capsys, "--source", film, "--loop", "--seconds", "30")
    assert ended == GONE
    assert told["failure"]["kind"] == "SourceGone"
    assert told["frames"] >= 5, "its first round was shown"


def test_a_film_that_ends_and_a_picture_that_is_held_are_no_failures(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    ended, told = show(capsys, "--source", write_film(tmp_path / "film.avi"))
    assert (ended, told["ended_by"], told["failure"]) == (0, "source", None)
    cv2.imwrite(str(tmp_path / "still.png"), np.full((48, 64, 3), 90, np.uint8))
    ended, told = show(capsys, "--source", tmp_path / "still.png", "--seconds", "0.5")
    assert (ended, told["ended_by"], told["failure"]) == (0, "time", None), "held until the time is over"


def test_keep_going_shows_black_and_tries_again_until_the_source_is_back(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, watched: type[Watched]
) -> None:
    path, brightest = Path(letter(tmp_path)), []

    def mend(level: int) -> None:
        brightest.append(level)
        cv2.imwrite(str(path), np.full((192, 256, 3), 200, np.uint8))

    watched.on_show = staticmethod(mend)
    ended, told = show(capsys, "--source", path, "--keep-going", "--seconds", "2.5")
    assert (ended, told["ended_by"], told["failure"]) == (0, "time", None), "it came back"
    assert any("letter.png" in note for note in told["notes"]), "and it is told that it was away"
    assert (brightest[0], brightest[-1]) == (0, 200)


def test_keep_going_tells_a_source_that_stays_away_and_waits_longer_each_time(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    ended, told = show(capsys, "--source", letter(tmp_path), "--keep-going", "--seconds", "2.5")
    assert (ended, told["ended_by"]) == (PICTURE, "time")
    tries = [note for note in told["notes"] if "letter.png" in note]
    assert 2 <= len(tries) <= 3, "at 0, 0.5 and 1.5 s"


def test_pictures_of_a_folder_that_are_passed_over_are_told_once_each(
    capsys: pytest.CaptureFixture[str], watched: type[Watched], tmp_path: Path
) -> None:
    folder = tmp_path / "slides"
    folder.mkdir()
    write_png(folder / "1.png", np.full((48, 64, 3), 90, np.uint8))
    for name in ("0-first.png", "2-last.png"):
        (folder / name).write_bytes(b"\x89PNG and nothing more")
    ended, told = show(capsys, "--source", str(folder), "--loop", "--seconds", "2")
    assert ended == 0
    passed_over = [note for note in told["notes"] if note.startswith("passed over")]
    assert [name for name in ("0-first.png", "2-last.png") for note in passed_over if name in note] == [
        "0-first.png",
        "2-last.png",
    ]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_end_in_order_and_can_be_told_apart(
    capsys: pytest.CaptureFixture[str], watched: type[Watched], number: signal.Signals
) -> None:
    shown = iter(range(1000))
    watched.on_show = staticmethod(lambda _: os.kill(os.getpid(), number) if next(shown) == 3 else None)
    ended, told = show(capsys, "--seconds", "30")
    assert ended == 128 + number
    assert (told["ended_by"], told["signal"]) == ("signal", number.name)
