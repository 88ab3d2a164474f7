"""What people see on a terminal: tables and sentences that fold, bars that only grow, signs that it knows."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from rich.cells import cell_len

from rig.stages.photograph import OneCount
from rig.terminal import TerminalProgress, part_of, print_table
from rig.terminal.line import counted
from rig.terminal.sentences import folded

if TYPE_CHECKING:
    from tests.rig.conftest import Finished

WIDE = (
    "strategy", "measured mean", "sd", "rms", "SSIM", "predicted mean", "clipped %", "gain", "time s", "iterations"
)  # fmt: skip
ROWS = [(f"a-strategy-called-{k}", 41.3, 32.06, 52.28, 0.65, 41.35, 12.5, 0.7, 1.25, k) for k in range(3)]
Capture = pytest.CaptureFixture[str]


@pytest.mark.parametrize("columns", [80, 60, 40])
def test_a_table_is_never_wider_than_the_terminal_and_breaks_no_number(
    columns: int, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    print_table("Errors against the target, grey levels of 255", WIDE, ROWS)
    out = capsys.readouterr().out
    assert max(cell_len(line) for line in out.splitlines() if line[:1] in "┌│└├") <= columns
    for word in ("41.30", "32.06", "52.28", "0.65", "41.35", "12.50", "1.25", "iterations", "strategy"):
        assert word in out
    # each row is named in each of the tables into which the columns are split
    assert out.count("a-strategy-called-1") == out.count("┌")


def test_a_row_keeps_both_its_names_where_the_first_alone_does_not_tell_rows_apart(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setenv("COLUMNS", "48")
    rows = [("latency", "display", 0.0531, "≤ 0.06", "s", "ok"), ("", "jitter", 0.4243, "≤ 1", "refreshes", "OUTSIDE")]
    print_table("self-test", ("part", "what", "value", "limit", "unit", "status"), rows)
    out = capsys.readouterr().out
    assert out.count("┌") == 2
    assert re.search(r"jitter\W+refreshes\W+OUTSIDE", out)


def test_a_table_of_words_folds_at_words(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    text = "look at the report's error pictures: what is not a wall of the room is not in the model"
    print_table("Advice", ("what", "value", "what to do"), [("measured", 0.5, text), ("other", None, "")])
    out = capsys.readouterr().out
    words = re.sub(r"[│\s]+", " ", out)
    assert text.split()[-1] in words
    assert all(word in words.split() for word in text.split())
    assert max(map(len, out.splitlines())) <= 60


def test_sentences_fold_at_words_and_keep_paths_whole() -> None:
    path = "/a/long/path/that/is/longer/than/the/width/of/the/terminal.toml"
    text = f"rig: {path}: camera.exposure_s: is 5, plausible are 0 ... 1: seconds, not milliseconds?\nrig: second"
    lines = folded(text, 40).splitlines()
    assert path + ":" in [line.strip() for line in lines]
    assert all(len(line) <= 40 or path in line for line in lines)
    assert lines[-1] == "rig: second"
    assert all(line.startswith("  ") for line in lines[1:-1])
    assert folded(text, None) == text


@pytest.mark.parametrize(("number", "words"), [(0, "0 events"), (1, "1 event"), (2, "2 events")])
def test_one_event_two_events(number: int, words: str) -> None:
    assert counted(number, "event") == words


def test_parts_of_a_step_count_as_one() -> None:
    told: list[tuple[str, int, int]] = []
    part_of(lambda *step: told.append(step), 4, 10)("photograph", 2, 6)
    assert told == [("photograph", 6, 10)]


PROGRESS = """
from rig.stages.photograph import OneCount
from rig.terminal import TerminalProgress
long = "photograph: response with a long name"
with TerminalProgress() as progress:
    for label, steps in ((long, ((1, 4), (4, 4), (1, 20), (20, 20))), ("fit", ((1, 2), (2, 2)))):
        for done, total in steps:
            progress(label, done, total)
            progress._progress.refresh()
print("result")
"""


def on_terminal(command: list[str], columns: int, **environment: str) -> str:
    """What a program writes on a terminal of a width, controls included."""
    master, slave = pty.openpty()
    own = {**os.environ, "COLUMNS": str(columns), "TERM": "xterm", **environment}
    run = subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, env=own, start_new_session=True)
    os.close(slave)
    seen = b""
    while True:
        try:
            part = os.read(master, 65536)
        except OSError:  # the program has ended
            break
        seen += part
    os.close(master)
    run.wait(timeout=60)
    return seen.decode()


@pytest.mark.parametrize("columns", [80, 60])
def test_a_bar_only_grows_and_is_one_line_that_leaves_one_line_behind(columns: int) -> None:
    seen = on_terminal([sys.executable, "-c", PROGRESS], columns)
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", seen)
    counts = [int(done) / int(total) for done, total in re.findall(r" (\d+)/(\d+) ", plain)]
    assert counts
    falls = sum(later < earlier for earlier, later in pairwise(counts))
    assert falls <= 1, counts  # where the second step begins
    assert "photograph: response with a long name: 20 of 20 done" in plain
    assert "fit: 2 of 2 done" in plain
    assert plain.rstrip().endswith("result")
    assert "\x1b[2A" not in seen  # never more than one line is drawn again


ROOM = """
[room]
size_m = [4.8, 4.8, 2.4]
patch_m = 0.8
[projector]
throw_ratio = 0.4
lumens = 3000
contrast = 1000
width_px = 320
height_px = 240
position_m = [1.2, 1.2, 1.2]
look_at_m = [2.2, 2.2, 1.1]
[show]
white_cdm2 = 20
pictures = ["grey", "checker"]
strategies = ["direct"]
width_px = 64
"""


@pytest.mark.parametrize("words", [["plan", "room.toml"], ["simulate", "corner", "--tolerance", "10"]])
def test_each_bar_of_a_command_only_grows_and_each_step_ends_with_all_its_parts(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "room.toml").write_text(ROOM, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", on_terminal([sys.executable, "-m", "rig", *words], 60))
    drawn: dict[str, list[float]] = {}
    for label, done, total in re.findall(r"[\u2800-\u28ff] ([^\r\n]*?) +(\d+)/(\d+)", plain):
        drawn.setdefault(label, []).append(int(done) / int(total))
    assert all(shares == sorted(shares) for shares in drawn.values()), drawn
    ended = re.findall(r"([^\r\n]+): (\d+) of (\d+) done", plain)
    assert ended
    assert all(done == total for _, done, total in ended), ended
    assert max(map(cell_len, plain.replace("\r", "\n").splitlines())) <= 60


def test_each_step_of_a_session_ends_with_all_its_parts(finished: Finished) -> None:
    ended = re.findall(r"^([^:\n][^\n]*): (\d+) of (\d+) done$", finished.err, re.MULTILINE)
    assert len(ended) >= 10
    assert all(done == total for _, done, total in ended), ended


def test_a_terminal_without_utf_8_gets_plain_signs() -> None:
    code = (
        "import sys; from rig.terminal.plain import write_plainly; write_plainly(); "
        "print('5 ± 1 × 2 … “a” → ρ \\u65e5 \\udcff'); print('≤', file=sys.stderr)"
    )
    own = {**os.environ, "PYTHONIOENCODING": "latin-1", "PYTHONUTF8": "0"}
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, env=own, check=True)
    assert said.stdout.decode("latin-1") == '5 ± 1 × 2 ... "a" -> rho \\u65e5 \\udcff\n'
    assert said.stderr == b"<=\n"


def test_progress_of_a_step_that_learns_how_much_it_has_to_do_never_shows_less(capsys: Capture) -> None:
    with TerminalProgress() as progress:
        for done, total in ((9, 10), (1, 20), (19, 20)):
            progress("plan", done, total)
    assert capsys.readouterr().err == "starting\nplan: 19 of 20 done\n"


def test_photographs_taken_in_several_goes_count_as_one() -> None:
    told: list[tuple[int, int]] = []
    count = OneCount(lambda _, done, total: told.append((done, total)))
    for frames in (2, 3, 2):
        count.take(lambda on_step, n=frames: [on_step("photograph: gray", k + 1, 5) for k in range(n)])
    assert told == [(1, 5), (2, 5), (3, 5), (4, 5), (5, 5), (6, 6), (7, 7)]
