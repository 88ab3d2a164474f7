"""A session survives being killed at any moment, and a finished one needs no device."""

from __future__ import annotations

import importlib.util
import json
import random
import shutil
import signal
import sys
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import pytest

from rig.cli.app import run_command

if TYPE_CHECKING:
    from tests.rig.conftest import Finished

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def script() -> ModuleType:
    path = ROOT / "benchmarks" / "kill_and_resume.py"
    spec = importlib.util.spec_from_file_location("kill_and_resume", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def copy(tmp_path: Path, finished: Finished) -> Path:
    return Path(shutil.copytree(finished.folder, tmp_path / "session"))


@pytest.mark.slow
def test_a_run_that_was_ended_five_times_gives_the_same_bytes(
    script: ModuleType, finished: Finished, tmp_path: Path
) -> None:
    folder = tmp_path / script.NAME
    signals = [signal.SIGKILL, signal.SIGINT, signal.SIGKILL, signal.SIGINT, signal.SIGKILL]
    kills = script.disturbed(folder, "ci-tiny", signals, 12.0, random.Random(20))
    assert kills, "no run was ended before its end"
    expected, found = script.results(finished.folder), script.results(folder)
    assert len(expected) > 150
    assert script.differences(expected, found) == []
    assert not list(folder.rglob("*.part"))
    for kill in kills:
        assert kill.exit_status in (-signal.SIGKILL, 130)
        if kill.exit_status == 130:
            last = kill.said.splitlines()[-1]
            assert last == "rig: interrupted; nothing is lost, run the same command again to go on"


def test_metrics_hold_no_time_and_no_place(finished: Finished) -> None:
    text = (finished.folder / "metrics.json").read_text()
    metrics, printed = json.loads(text), json.loads(finished.out)
    assert metrics["report"] == "report.html"
    assert "elapsed_s" not in text
    assert str(finished.folder.parent) not in text
    assert printed.pop("elapsed_s") > 0
    assert printed.pop("report") == str(finished.folder / "report.html")
    del metrics["report"]
    assert printed == metrics


def test_a_finished_session_runs_again_without_devices(
    copy: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a device was opened")

    monkeypatch.setattr("rig.run.session.open_rig", refuse)
    before = (copy / "metrics.json").read_bytes()
    assert run_command(["run", str(copy), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["within_limits"]
    assert (copy / "metrics.json").read_bytes() == before
    assert run_command(["separate", str(copy), "--json"]) == 0
    assert (copy / "metrics.json").read_bytes() == before, "a part does not replace the whole"


def test_another_target_repeats_what_depends_on_it_and_keeps_the_old_files(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def steps(*words: str) -> dict[str, bool]:
        assert run_command(["run", str(copy), "--dry-run", "--json", *words]) == 0
        return {step["step"]: step["done"] for step in json.loads(capsys.readouterr().out)["steps"]}

    before = {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()}
    assert all(steps().values())
    missing = {name for name, done in steps("--strategies", "none").items() if not done}
    assert missing == {"compensate", "project", "compare"}
    assert {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()} == before, "dry runs only read"
    assert run_command(["run", str(copy), "--strategies", "none", "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)["strategies"]) == ["none"]
    kept = [path for path in before if path.parent.name in ("images", "calibration", "maps")]
    assert all(path.read_bytes() == before[path] for path in kept)


def test_a_lost_frame_is_photographed_again(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    metrics = json.loads((copy / "metrics.json").read_text())
    lost = sorted(copy.glob("frames/gray/*.exr"))[5]
    lost.unlink()
    assert run_command(["run", str(copy), "--json"]) == 0
    assert lost.exists()
    again = json.loads(capsys.readouterr().out)
    assert again["geometry"]["rms_px"] == pytest.approx(metrics["geometry"]["rms_px"], rel=0.05)
