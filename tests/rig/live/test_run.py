"""A live show as a person runs it: on the command line, with signals, keys, a recording, a session."""

import json
import os
import pty
import signal
import subprocess
import sys
import termios
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from rig.cli.app import run_command
from rig.devices.protocols import Codes, Shown
from rig.devices.simulated.display import ClockedDisplay
from rig.errors import SessionError, UsageError
from rig.files.journal import read_events
from rig.live import pipeline, record
from rig.live.latency import with_light_latency
from rig.live.plan import LiveRequest, plan_live
from rig.live.results import ShowResult
from rig.live.run import run_live
from rig.profile.schema import load_profile
from rig.terminal import silent
from tests.rig.conftest import Finished


def show(request: LiveRequest) -> ShowResult:
    plan = with_light_latency(plan_live(request, silent), silent)
    return run_live(plan, lambda _: None)


class Witness(ClockedDisplay):
    """Remembers what was on screen, and in which order."""

    last: "Witness"

    def __init__(self, *settings: object) -> None:
        super().__init__(*settings)  # type: ignore[arg-type]
        self.brightest: list[int] = []
        self.on_show: Callable[[], None] = lambda: None
        Witness.last = self

    def show(self, codes: Codes, *, name: str) -> Shown:
        self.brightest.append(int(codes.max()))
        shown = super().show(codes, name=name)
        Witness.on_show_of_all()
        return shown

    def close(self) -> None:
        super().close()
        self.brightest.append(0)

    on_show_of_all: Callable[[], None] = staticmethod(lambda: None)


@pytest.fixture
def witness(monkeypatch: pytest.MonkeyPatch) -> type[Witness]:
    monkeypatch.setattr(pipeline, "ClockedDisplay", Witness)
    monkeypatch.setattr(Witness, "on_show_of_all", staticmethod(lambda: None))
    return Witness


def request(*sources: str, **settings: object) -> LiveRequest:
    return LiveRequest(profile="ci-tiny", sources=sources or ("pattern",), **{"seconds": 1.0, **settings})  # type: ignore[arg-type]


def test_a_show_tells_what_it_did_and_leaves_black(witness: type[Witness]) -> None:
    result = show(request(strategy="exact"))
    assert result.figures.frames > 0
    assert result.ended_by == "time"
    assert result.strategy == "exact"
    assert result.figures.out_of_order == 0
    assert any("guessed" in note for note in result.notes)
    assert max(witness.last.brightest) > 200
    assert witness.last.brightest[-1] == 0
    assert not witness.last.is_open
    json.dumps(result.as_json(), allow_nan=False)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_show_in_order_and_black_comes_last(witness: type[Witness], number: int) -> None:
    before = signal.getsignal(number)
    frames = iter(range(1000))

    def interrupt() -> None:
        if next(frames) == 5:
            os.kill(os.getpid(), number)

    witness.on_show_of_all = staticmethod(interrupt)
    result = show(request(seconds=30.0))
    assert result.ended_by == "signal"
    assert result.signal == signal.Signals(number).name
    assert witness.last.brightest[-1] == 0
    assert signal.getsignal(number) == before


def test_an_error_in_the_middle_leaves_black_and_the_signals_as_they_were(witness: type[Witness]) -> None:
    before = signal.getsignal(signal.SIGTERM)

    def fail() -> None:
        raise RuntimeError("a fault of our own")

    witness.on_show_of_all = staticmethod(fail)
    with pytest.raises(RuntimeError):
        show(request())
    assert witness.last.brightest[-1] == 0
    assert signal.getsignal(signal.SIGTERM) == before


def test_sources_that_break_are_told_and_the_show_ends_with_the_last(tmp_path: Path, witness: type[Witness]) -> None:
    bad = tmp_path / "bad.mp4"
    bad.write_bytes(b"no video")
    folder = tmp_path / "pictures"
    folder.mkdir()
    cv2.imwrite(str(folder / "a.png"), np.full((50, 60, 3), 90, np.uint8))
    result = show(request(str(bad), str(folder), seconds=20.0, rate_hz=5.0))
    assert result.ended_by == "source"
    assert result.figures.frames == 1
    assert 0.15 < result.seconds < 10
    assert any("bad.mp4" in note for note in result.notes)


def test_a_recording_has_every_file_its_journal_names_and_how_it_ended(tmp_path: Path) -> None:
    folder = tmp_path / "record"
    result = show(request(record=folder, seconds=1.5, strategy="exact"))
    events = read_events(folder / "journal.jsonl")
    shown = [event for event in events if event["event"] == "shown"]
    assert [event["event"] for event in (events[0], events[-1])] == ["begin", "end"]
    assert len(shown) == result.recorded.frames > 1
    assert [event["number"] for event in shown] == sorted({event["number"] for event in shown})
    shape = load_profile("ci-tiny").projector.shape
    for event in shown:
        assert cv2.imread(str(folder / event["file"])).shape == (*shape, 3)
    photographs = [event for event in events if event["event"] == "photograph"]
    assert len(photographs) == result.recorded.photographs > 0
    assert all((folder / event["file"]).is_file() and event["exposure_s"] > 0 for event in photographs)
    assert not list(folder.glob("*.part"))


def test_a_full_disk_ends_the_recording_and_not_the_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise SessionError("the disk is full")

    monkeypatch.setattr(record, "write_png", refuse)
    result = show(request(record=tmp_path / "record"))
    assert result.ended_by == "time"
    assert result.recorded.frames == 0
    assert "recording stopped: the disk is full" in result.notes


def test_a_recording_is_not_mixed_with_other_files(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(UsageError, match="has files already"):
        show(request(record=tmp_path))


def test_a_session_is_shown_with_what_it_measured(finished: Finished, witness: type[Witness]) -> None:
    result = show(LiveRequest(folder=finished.folder, strategy="exact", seconds=1.0))
    assert result.model.startswith("session")
    assert result.figures.frames > 0
    assert any("monochrome" in note for note in result.notes)
    assert max(witness.last.brightest) > 200


def test_flashes_measure_from_memory_to_light() -> None:
    result = show(request(flashes=True, strategy="exact", seconds=0.1))
    world = load_profile("ci-tiny").simulation
    assert world is not None
    projector = world.projector
    shortest_ms = 1000 * projector.latency_s
    longest_ms = shortest_ms + 1000 * projector.jitter_s + 2 * 1000 / 60
    assert shortest_ms - 2 < result.light_latency_ms.p50 < longest_ms
    assert result.light_latency_ms.max < longest_ms + 2
    assert result.light_latency_ms.flashes > 4


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["live"], "needs a session, or a profile"),
        (["live", "-p", "ci-tiny", "--strategy", "magic"], "there are exact, bounded and none"),
        (["live", "-p", "ci-tiny", "--seconds", "0"], "more than 0"),
        (["live", "-p", "ci-tiny", "--gain", "9"], "between 0 and 4"),
        (["live", "-p", "ci-tiny", "--source", "nowhere.mp4"], "no such source"),
        (["live", "-p", "ci-tiny", "--size", "large"], "WIDTHxHEIGHT"),
        (["live", "nowhere"], "no session"),
    ],
)
def test_wrong_arguments_are_refused_with_what_to_give(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    status = run_command(arguments)
    assert status in (2, 4)
    assert message in capsys.readouterr().err


def test_json_has_the_numbers_of_the_show(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["live", "-p", "ci-tiny", "--strategy", "exact", "--seconds", "0.3", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert {"frames", "fps_median", "latency_ms", "late_frames", "strategy", "error_mean", "dropped", "repeated",
            "out_of_order", "on_time_share", "memory_growth_mb"} <= set(result)  # fmt: skip
    assert set(result["latency_ms"]) == {"p50", "p99"}


def test_the_table_for_people_has_the_notes_on_the_other_stream(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["live", "-p", "ci-tiny", "--strategy", "none", "--seconds", "0.3"]) == 0
    out, err = capsys.readouterr()
    assert "on time" in out
    assert "guessed" in err


def test_keys_of_a_terminal_are_obeyed_and_the_terminal_is_left_as_it_was() -> None:
    master, slave = pty.openpty()
    before = termios.tcgetattr(slave)
    command = [sys.executable, "-m", "rig", "live", "-p", "ci-tiny", "--strategy", "exact", "--seconds", "60", "--json"]
    show = subprocess.Popen(
        command, stdin=slave, stdout=subprocess.PIPE, stderr=slave, text=True, start_new_session=True,
        preexec_fn=lambda: os.close(os.open(os.ttyname(slave), os.O_RDWR)),
    )  # fmt: skip
    seen = b""
    while b"fps" not in seen:
        seen += os.read(master, 4096)
    assert not termios.tcgetattr(slave)[3] & termios.ICANON
    os.write(master, b"sbq")
    os.set_blocking(master, False)
    out, _ = show.communicate(timeout=60)
    result = json.loads(out)
    assert show.returncode == 0
    assert result["ended_by"] == "quit"
    assert result["strategy"] == "bounded"
    assert termios.tcgetattr(slave) == before
    os.close(master)
    os.close(slave)


def test_a_pipe_on_standard_input_is_shown_to_its_end() -> None:
    picture = b"P6\n64 48\n255\n" + bytes(range(256)) * 36
    command = [sys.executable, "-m", "rig", "live", "-p", "ci-tiny", "--source", "-", "--strategy", "exact", "--json"]
    show = subprocess.run(command, input=picture * 20, capture_output=True, check=False, timeout=120)
    result = json.loads(show.stdout)
    assert result["ended_by"] == "source"
    assert 1 <= result["frames"] <= 20
    assert result["frames"] + result["dropped"] == 20
