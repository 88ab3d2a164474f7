"""A session's target: sRGB unless said otherwise, remembered, and never photographed twice."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from rig.cli.app import run_command
from rig.files.pictures import write_png
from rig.session import Session

if TYPE_CHECKING:
    from tests.rig.conftest import Finished

Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("picture") / "colour.png"
    ramp = np.linspace(40, 220, 256 * 192).reshape(192, 256)
    write_png(path, np.stack([ramp, ramp[::-1], ramp[:, ::-1]], axis=-1).astype(np.uint8))
    return path


@pytest.fixture(scope="module")
def session(finished: Finished, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return shutil.copytree(finished.folder, tmp_path_factory.mktemp("copy") / "session")


def ran(capsys: Capture, session: Path, *words: object) -> dict[str, Any]:
    assert run_command(["run", str(session), "--strategies", "bounded", *map(str, words), "--json"]) in (0, 1)
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def n_photographs(session: Path) -> int:
    return len(list((session / "frames" / "project").iterdir()))


def test_a_target_is_said_remembered_and_never_photographed_again(
    session: Path, picture: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    per_picture = 2  # exposures
    before = n_photographs(session)
    first = ran(capsys, session, "--target", picture)
    # two strategies; the held-out pictures were photographed for the first target already
    assert n_photographs(session) == before + 2 * per_picture
    assert first["compensation"]["target"] == {
        "name": "colour.png",
        "light": "sRGB",
        "lost_colours": True,
        "placed": "",
    }
    report = (session / "report.html").read_text("utf-8")
    assert "colour.png, taken as sRGB; it becomes grey: the camera is grey" in report

    again = ran(capsys, session)
    assert again["compensation"]["target"]["name"] == "colour.png"
    assert again["measured"] == first["measured"]

    default = ran(capsys, session, "--target", "default")
    assert "astronaut" in default["compensation"]["target"]["name"]
    back = ran(capsys, session, "--target", picture)
    assert back["measured"] == first["measured"]
    assert n_photographs(session) == before + 2 * per_picture

    monkeypatch.setenv("COLUMNS", "200")
    assert run_command(["run", str(session), "--strategies", "bounded"]) in (0, 1)
    assert "target: colour.png, taken as sRGB; it becomes grey" in capsys.readouterr().out


def test_linear_light_is_another_target(session: Path, picture: Path, capsys: Capture) -> None:
    before = n_photographs(session)
    linear = ran(capsys, session, "--target", picture, "--linear")
    assert linear["compensation"]["target"]["light"] == "linear light"
    assert n_photographs(session) == before + 4
    with Session.read(session) as read:
        levels = read.finished("compensate").load_image("target")["grey"]
    assert levels.mean() == pytest.approx(130, abs=2)


def test_more_strategies_of_the_same_target_take_only_their_own_photographs(session: Path, capsys: Capture) -> None:
    before = n_photographs(session)
    words = ["run", str(session), "--target", "default", "--strategies", "exact,bounded,dual", "--json"]
    assert run_command(words) in (0, 1)
    capsys.readouterr()
    assert n_photographs(session) == before + 2  # dual alone: the first session has shown the others


def test_a_lost_target_is_asked_for_again(session: Path, picture: Path, capsys: Capture) -> None:
    ran(capsys, session, "--target", picture)
    for path in (session / "images").glob("target-*.exr"):
        path.write_bytes(b"")
    assert run_command(["run", str(session)]) == 4
    assert "name the picture again: --target FILE" in " ".join(capsys.readouterr().err.split())
    ran(capsys, session, "--target", picture)
