"""The command line: help that teaches, JSON that is nothing else, exit statuses that scripts can trust."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from rig.cli.app import run_command

if TYPE_CHECKING:
    from tests.rig.conftest import Finished

Capture = pytest.CaptureFixture[str]

VERBS = (
    ["run"],
    ["calibrate"],
    ["separate"],
    ["model"],
    ["compensate"],
    ["compare"],
    ["report"],
    ["check"],
    ["devices"],
    ["profile", "check"],
    ["paper"],
    ["simulate"],
    ["scan"],
    ["lenses"],
)


def rig(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "rig", *words], capture_output=True, text=True, check=False)


def printed_json(capsys: Capture, *words: object) -> dict[str, Any]:
    """What one command prints: JSON, and nothing before or after it."""
    assert run_command([str(word) for word in words]) in (0, 1)
    value: dict[str, Any] = json.loads(capsys.readouterr().out)
    return value


# Help and usage


@pytest.mark.parametrize("verb", VERBS, ids=" ".join)
def test_help_of_every_verb_has_an_example(capsys: Capture, verb: list[str]) -> None:
    assert run_command([*verb, "--help"]) == 0
    captured = capsys.readouterr()
    assert f"Example: rig {' '.join(verb)}" in captured.out
    assert "--json" in captured.out
    assert captured.err == ""


@pytest.mark.parametrize("verb", VERBS, ids=" ".join)
def test_help_tells_defaults_in_words_and_none_of_switches_that_are_off(capsys: Capture, verb: list[str]) -> None:
    assert run_command([*verb, "--help"]) == 0
    told = re.findall(r"\[default: ([^\]]*)", " ".join(re.sub("[│╭╮╰╯─]", " ", capsys.readouterr().out).split()))
    assert not [default for default in told if re.search(r"False|True|None|['\"(]|\d\.0$", default)]


def test_without_arguments_it_says_what_there_is_and_where_to_start(capsys: Capture) -> None:
    assert run_command([]) == 0
    out = capsys.readouterr().out
    assert all(verb[0] in out for verb in VERBS)
    assert "Start with: rig run" in out


@pytest.mark.parametrize(
    ("words", "message", "advice"),
    [
        (["frobnicate"], "frobnicate", "rig --help"),
        (["profile", "chek"], 'Did you mean "check"', "rig profile --help"),
        (["run"], "SESSION is missing: folder of the session", "rig run --help"),
        (["plan"], "ROOM is missing: room file", "rig plan --help"),
        (["show"], "--profile is missing", "rig show --help"),
        (["run", "folder", "--target"], "--target needs a value: picture to show (PNG", "rig run --help"),
        (["run", "my", "room"], "nothing is done with `room`; put names that have blanks", "rig run --help"),
        (["run", "folder", "--colour", "red"], "--colour", "rig run --help"),
        (["check"], "--profile", "rig check --help"),
        (["simulate", "corner", "--tolerance", "fine"], "fine", "rig simulate --help"),
    ],
)
def test_wrong_usage_is_two_lines_and_status_2(capsys: Capture, words: list[str], message: str, advice: str) -> None:
    assert run_command(words) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    first, second = captured.err.splitlines()
    assert first.startswith("rig: ")
    assert message in first
    assert second == f"try: {advice}"


def test_a_check_of_no_profile_is_wrong_usage(capsys: Capture) -> None:
    assert run_command(["profile", "check"]) == 2
    assert "needs at least one file" in capsys.readouterr().err


def test_an_unknown_scene_is_wrong_usage(capsys: Capture) -> None:
    assert run_command(["simulate", "ballroom"]) == 2
    captured = capsys.readouterr()
    assert "ballroom" in captured.err
    assert "corner" in captured.err


def test_figures_need_a_folder(capsys: Capture, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert run_command(["paper", "--figures", str(tmp_path / "file")]) == 2
    captured = capsys.readouterr()
    assert "no folder for figures" in captured.err
    assert captured.out == ""


def test_it_runs_as_a_module_too() -> None:
    said = rig("--version")
    assert said.returncode == 0
    assert said.stdout[0].isdigit()
    assert said.stderr == ""


def test_help_needs_no_numbers() -> None:
    """Nothing heavy is imported before it is needed."""
    code = (
        "import sys; from rig.cli.app import run_command; run_command(['run', '--help']); "
        "print([m for m in ('numpy', 'cv2', 'scipy', 'matplotlib') if m in sys.modules])"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.splitlines()[-1] == "[]"


def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "rig", "devices", "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as run:
        assert run.stdout is not None
        assert run.stderr is not None
        run.stdout.close()
        said = run.stderr.read()
    assert run.returncode == 0
    assert said == b""


def test_a_result_that_cannot_be_printed_is_one_line_on_stderr() -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "rig", "devices", "--json"]
        said = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert said.returncode == 4
    assert said.stderr == "rig: [Errno 28] No space left on device; check the disk, then run the same command again\n"


def test_ctrl_c_while_it_starts_is_quiet() -> None:
    code = (
        "import os, signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "class Interrupt:\n"
        "    def find_spec(self, name, path, target=None):\n"
        "        if name == 'cyclopts':\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupt())\n"
        "from rig.__main__ import main\n"
        "main()\n"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert said.returncode == 130
    assert said.stderr == "rig: interrupted; nothing is lost, run the same command again to go on\n"
    assert said.stdout == ""


# JSON


def test_json_of_a_run_has_the_promised_keys(finished: Finished) -> None:
    result = json.loads(finished.out)
    assert {"rms_px", "camera_rms_px", "projector_rms_px", "valid_share"} <= result["geometry"].keys()
    assert "global_share_mean" in result["separation"]
    assert {"patches", "reflectance_mean"} <= result["model"].keys()
    assert {"strategy", "clipped_share"} <= result["compensation"].keys()
    for name in ("uncompensated", "compensated"):
        assert {"mean", "sd", "rms"} <= result["measured"][name].keys()
    assert {"rmse", "bias", "within_3_sigma"} <= result["comparison"].keys()
    assert {
        "camera_position_mm",
        "camera_rotation_deg",
        "focal_percent",
        "surface_median_mm",
        "reflectance_rmse",
        "direct_bias_percent",
        "global_bias_percent",
    } <= result["truth"].keys()
    assert Path(result["report"]).is_file()
    assert finished.err, "progress goes to stderr"


@pytest.mark.parametrize("verb", ["calibrate", "separate", "model", "compensate", "compare", "run", "report"])
def test_json_of_the_verbs_of_a_session(capsys: Capture, finished: Finished, tmp_path: Path, verb: str) -> None:
    folder = shutil.copytree(finished.folder, tmp_path / "session [/x]")
    result = printed_json(capsys, verb, folder, "--json")
    assert "report" in result if verb in ("run", "report", "compare") else "geometry" in result
    assert run_command([verb, str(folder)]) in (0, 1)
    table = capsys.readouterr().out.replace(str(folder), "")
    assert table
    assert not re.search(r"[a-z0-9]_[a-z0-9]", table), "keys are for machines, people read words"


def test_json_of_a_plan_and_that_it_touches_nothing(capsys: Capture, tmp_path: Path) -> None:
    plan = printed_json(capsys, "run", tmp_path / "new", "-p", "ci-tiny", "--dry-run", "--json")
    assert plan["exists"] is False
    assert [step["step"] for step in plan["steps"]][:2] == ["exposure", "response"]
    assert not any(step["done"] for step in plan["steps"])
    assert run_command(["run", str(tmp_path / "new"), "-p", "ci-tiny", "--dry-run"]) == 0
    assert list(tmp_path.iterdir()) == []


def test_the_plan_counts_the_frames_that_a_run_takes(capsys: Capture, finished: Finished) -> None:
    plan = printed_json(capsys, "run", finished.folder, "--dry-run", "--json")
    promised = {step["step"]: step["frames"] for step in plan["steps"] if step["frames"]}
    taken = {folder.name: len(list(folder.iterdir())) for folder in (finished.folder / "frames").iterdir()}
    assert promised.keys() == taken.keys()
    for step, count in promised.items():
        assert taken[step] == count or step == "exposure", step


def test_json_of_verbs_without_a_session(capsys: Capture) -> None:
    kinds = {"cameras", "bus_cameras", "outputs", "monitors", "controllers", "plug_ins", "problems"}
    assert set(printed_json(capsys, "devices", "--json")) == kinds
    files = printed_json(capsys, "profile", "check", "hw_profiles/ci-tiny.toml", "--json")["files"]
    assert [(file["ok"], file["problems"]) for file in files] == [(True, [])]
    simulated = printed_json(capsys, "simulate", "corner", "--tolerance", "5", "--json")
    assert {"plan", "estimated", "actual"} <= simulated.keys()


def test_an_error_prints_no_json(capsys: Capture, tmp_path: Path) -> None:
    assert run_command(["report", str(tmp_path / "none"), "--json"]) == 4
    assert capsys.readouterr().out == ""


# Self-test


def test_check_passes_on_a_good_rig_and_prints_json(capsys: Capture) -> None:
    result = printed_json(capsys, "check", "-p", "ci-tiny", "--json")
    assert result["within_limits"]
    assert all(row["met"] and row["status"] != "OUTSIDE" for row in result["checks"])
    assert result["suggested"]["projector.latency_s"] >= result["latency_s"]["max"]


def test_ctrl_c_at_the_very_end_comes_too_late() -> None:
    """A late Ctrl-C, when the result is printed, does not turn success into failure."""
    code = (
        "import os, signal, sys, atexit\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "atexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))\n"
        "sys.argv = ['rig', 'devices', '--json']\n"
        "from rig.__main__ import main\n"
        "main()\n"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (said.returncode, said.stderr) == (0, "")
