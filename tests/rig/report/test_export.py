"""A session handed out as pictures: every frame and map, by names and with a table that says what each shows."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from rig.cli.app import run_command
from rig.files.exr import read_exr
from rig.files.pictures import read_codes
from rig.report.export import export_session
from rig.session import Session

if TYPE_CHECKING:
    from tests.rig.conftest import Finished

Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def exported(finished: Finished, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("exported") / "pictures"
    export_session(finished.folder, folder)
    return folder


def rows_of(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "contents.csv").read_text("utf-8").splitlines()))


def test_every_frame_and_every_picture_is_there_and_in_the_table(exported: Path, finished: Finished) -> None:
    rows = rows_of(exported)
    there = {path.relative_to(exported).as_posix() for path in exported.rglob("*.png")}
    assert {row["file"] for row in rows} == there
    frames = len(list((finished.folder / "frames").rglob("*.exr")))
    assert sum(row["shows"].startswith("photograph while") for row in rows) == frames
    assert all(row["scale"] for row in rows)
    with Session.read(finished.folder) as session:
        assert {step for step, _ in session.files()} == {row["step"] for row in rows}


def test_names_say_what_a_file_shows(exported: Path) -> None:
    for name in (
        "1-exposure/white-16.67ms.png",
        "4-correspondence/correspondence-camera-projector-column.png",
        "5-separation/separation-global.png",
        "7-compensation/projector-bounded.png",
        "7-compensation/target.png",
        "8-photographs-of-strategies/shown-bounded-23.35ms.png",
        "9-comparison/measured-bounded.png",
    ):
        assert (exported / name).is_file(), name


def test_codes_are_exact_so_that_they_can_be_shown_again(exported: Path, finished: Finished) -> None:
    codes = read_codes(exported / "7-compensation" / "projector-bounded.png")[..., 0]
    stored = read_exr(finished.folder / "images" / "projector-bounded-001.exr")["codes"]
    assert np.array_equal(codes, stored)


def test_numbers_are_exact_as_exr(finished: Finished, tmp_path: Path, capsys: Capture) -> None:
    words = ["export", str(finished.folder), "-o", str(tmp_path / "numbers"), "--format", "exr", "--json"]
    assert run_command(words) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["files"] == len(list((tmp_path / "numbers").rglob("*.exr")))
    copy = tmp_path / "numbers" / "5-separation" / "separation.exr"
    assert copy.read_bytes() == (finished.folder / "maps" / "separation-001.exr").read_bytes()


def test_an_export_replaces_nothing_and_changes_no_session(exported: Path, finished: Finished, capsys: Capture) -> None:
    before = (finished.folder / "journal.jsonl").read_bytes()
    assert run_command(["export", str(finished.folder), "-o", str(exported)]) == 2
    assert "has files already" in capsys.readouterr().err
    assert run_command(["export", str(exported)]) == 4
    assert (finished.folder / "journal.jsonl").read_bytes() == before
