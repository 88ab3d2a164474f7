"""`rig compare-strategies`: on the smallest rig, on the paper's room, and what knowing the simulated world gives."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rig.cli.app import run_command
from rig.devices.simulated.rigs import simulated_world_of
from rig.errors import SessionError
from rig.profile.schema import Profile
from rig.session import Session
from rig.stages.model import load_model
from rig.stages.scene_model import SceneModel
from rig.strategies.comparison import ratios, refuse_unknown_world, warnings_of
from rig.strategies.pictures import two_walls
from rig.strategies.records import ClosedLoop, ComparedPicture, JudgedErrors, StrategyRow
from rig.truth.transport import ground_truth_transport

NAMES = ("none", "direct", "bounded", "tikhonov")


@pytest.fixture(scope="module")
def compared(finished: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], str]:
    """The folder, the answer, and the page, of one comparison with everything."""
    folder = Path(shutil.copytree(finished.folder, tmp_path_factory.mktemp("compared") / "session"))
    command = ["compare-strategies", str(folder), "--strategies", ",".join(NAMES), "--captures", "3", "--oracle"]
    with pytest.MonkeyPatch.context() as patched:
        lines: list[str] = []
        patched.setattr("builtins.print", lambda *parts, **_: lines.append(" ".join(map(str, parts))))
        assert run_command([*command, "--json"]) == 0
    return folder, json.loads("\n".join(lines)), (folder / "strategies.html").read_text("utf-8")


def row(answer: dict[str, Any], picture: str, strategy: str) -> dict[str, Any]:
    rows = next(each["rows"] for each in answer["pictures"] if each["name"] == picture)
    return next(each for each in rows if each["strategy"] == strategy)


def test_every_strategy_is_measured_on_every_picture(compared: Any) -> None:
    answer = compared[1]
    assert [picture["name"] for picture in answer["pictures"]] == ["target", "two-walls", "dark", "bright"]
    for picture in answer["pictures"]:
        assert [each["strategy"] for each in picture["rows"]] == list(NAMES)
        for each in picture["rows"]:
            for errors in (each["measured"], each["predicted"]):
                assert {"mean", "sd", "max", "rms", "delta_e_2000", "ssim", "mean_at_best_gain"} <= set(errors)
                assert 0 < errors["mean"] <= errors["rms"] <= errors["max"]
            assert {"clipped_share", "gain", "seconds", "iterations", "captures", "frames"} <= set(each)


def test_each_picture_says_how_its_file_was_read(compared: Any) -> None:
    answer, page = compared[1:]
    assert {picture["target"]["light"] for picture in answer["pictures"]} == {"linear light"}
    assert "taken as linear light" in page


def test_the_optimum_shows_a_fraction_of_the_uncompensated_error(compared: Any) -> None:
    answer = compared[1]
    assert answer["ratios"]["bounded / none"] <= 0.3
    assert row(answer, "target", "bounded")["measured"]["mean"] < row(answer, "target", "direct")["measured"]["mean"]


def test_the_rig_comes_near_what_knowing_the_simulated_world_gives(compared: Any) -> None:
    answer = compared[1]
    assert answer["ratios"]["bounded / oracle"] <= 1.2
    assert answer["ratios"]["bounded, closed loop / oracle"] <= 1.05
    assert row(answer, "target", "bounded")["predicted"]["mean"] < answer["oracle"][0]["measured"]["mean"]


def test_the_best_so_far_is_told_after_one_two_and_all_captures(compared: Any) -> None:
    (loop,) = compared[1]["loops"]
    after = {int(number): errors["mean"] for number, errors in loop["after"].items()}
    assert min(after) == 1
    assert list(after.values()) == sorted(after.values(), reverse=True)
    assert after[max(after)] == loop["captures"][loop["best"] - 1]["mean"]


def test_the_contrast_between_two_walls_is_the_rooms_and_far_below_the_projectors(compared: Any) -> None:
    """The white wall lights the black one: at a reflectance of 0.7 no picture can undo that."""
    answer = compared[1]
    for name in NAMES:
        measured, predicted = (row(answer, "two-walls", name)[kind]["contrast"] for kind in ("measured", "predicted"))
        assert 2 < measured < 10
        assert measured == pytest.approx(predicted, rel=0.1)
    assert row(answer, "dark", "none")["measured"].get("contrast") is None


def test_a_strategy_that_is_worse_than_direct_light_alone_is_named(compared: Any) -> None:
    answer = compared[1]
    for picture in answer["pictures"]:
        for each in picture["rows"]:
            worse = each["measured"]["mean"] > row(answer, picture["name"], "direct")["measured"]["mean"]
            named = any(text.startswith(f"{picture['name']}: '{each['strategy']}'") for text in answer["warnings"])
            assert worse == named


def test_the_page_needs_no_other_file_and_shows_all_five_pictures_of_each_strategy(compared: Any) -> None:
    page = compared[2]
    assert page.count('<img src="data:image/png') == 5 * len(NAMES) * 4
    assert "http://www.w3.org" not in page.split("data:image/svg")[0]
    for text in ("bounded, closed loop", "bounded, world known", "Speed against error"):
        assert text in page


def test_a_comparison_that_is_done_takes_no_frame_again(compared: Any, capsys: pytest.CaptureFixture[str]) -> None:
    folder = compared[0]
    before = (folder / "journal.jsonl").read_text("utf-8").count('"event":"frame"')
    command = ["compare-strategies", str(folder), "--strategies", ",".join(NAMES), "--captures", "3", "--oracle"]
    assert run_command(command) == 0
    assert (folder / "journal.jsonl").read_text("utf-8").count('"event":"frame"') == before
    printed = capsys.readouterr().out
    assert "bounded, closed loop" in printed
    assert "two-walls: one wall white, the other black" in printed


# The truth of the simulated world


def test_the_true_transport_predicts_what_the_simulated_world_shows(finished: Any, tiny_profile: Profile) -> None:
    """White on every steered pixel: the simulated world's own photograph, free of noise, against T times white."""
    with Session.read(finished.folder) as session:
        model = load_model(session)
    world = simulated_world_of(tiny_profile)
    transport = ground_truth_transport((world,), model).bands[0]
    white = np.asarray(transport @ np.ones(transport.shape[1]))
    modelled = model.white[model.lit].mean()
    assert white.mean() == pytest.approx(modelled, rel=0.1)
    rng = np.random.default_rng(0)
    p, c = rng.uniform(size=transport.shape[1]), rng.uniform(size=transport.shape[0])
    assert c @ transport.interreflection.apply(p) == pytest.approx(p @ transport.interreflection.adjoint(c), rel=1e-9)
    assert c @ (transport @ p) == pytest.approx(p @ transport.rmatvec(c), rel=1e-4)


def test_nobody_knows_the_truth_of_a_real_rig() -> None:
    """Refused before anything of the session is touched."""
    real = cast("Profile", SimpleNamespace(simulation=None))
    with pytest.raises(SessionError, match="runs/lab: only a simulated rig knows its truth; leave --oracle out"):
        refuse_unknown_world(real, Path("runs/lab"))


def test_the_truth_of_a_world_that_is_no_box_is_refused_before_a_photograph_is_taken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    furnished = str(Path(__file__).parents[3] / "hw_profiles" / "sim-furnished.toml")
    assert run_command(["compare-strategies", str(tmp_path / "session"), "-p", furnished, "--oracle"]) != 0
    assert "there for boxes only; leave --oracle out" in capsys.readouterr().err
    assert not (tmp_path / "session").exists()


def test_the_two_walls_are_those_that_fill_the_picture_and_not_its_floor(finished: Any) -> None:
    with Session.read(finished.folder) as session:
        scene_model: SceneModel = load_model(session).scene_model
    grey = two_walls(scene_model).ravel()
    face = scene_model.projector_hits.hits.face
    whiteness = {
        each.name: (grey[face == k] == 255).mean()
        for k, each in enumerate(scene_model.scene.faces)
        if (face == k).any()
    }
    assert sorted(whiteness[name] for name in ("x1", "y1")) == [0, 1]
    assert 0.2 < whiteness["floor"] < 0.8


# Without a device


def test_on_the_papers_configurations_nothing_is_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.paper.comparison.SHAPE", (60, 80))
    page = tmp_path / "paper.html"
    command = ["compare-strategies", "--paper", "--strategies", "direct,paper,exact,bounded", "--report", str(page)]
    assert run_command([*command, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    means = {
        picture["name"]: {each["strategy"]: each["predicted"]["mean"] for each in picture["rows"]}
        for picture in answer["pictures"]
    }
    assert len(means) == 6
    assert means["reference"]["bounded"] <= 0.45 * means["reference"]["paper"]
    assert means["grey"]["bounded"] <= 0.1
    assert all("measured" not in each for picture in answer["pictures"] for each in picture["rows"])
    assert page.read_text("utf-8").count('<img src="data:image/png') == 4 * 5 * 6


@pytest.mark.parametrize("command", [[], ["runs/x", "--paper"]])
def test_a_session_or_the_paper_and_not_both(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["compare-strategies", *command]) == 2
    assert "name a session or give --paper" in capsys.readouterr().err


# Figures


def errors(mean: float) -> JudgedErrors:
    """Errors of which only the mean counts."""
    others = dict.fromkeys(("sd", "max", "rms", "bias", "ssim", "delta_e_2000", "best_gain", "mean_at_best_gain"), 0.0)
    return JudgedErrors(mean=mean, **others)


def test_ratios_are_measured_means_over_the_uncompensated_and_over_the_oracle() -> None:
    rows = [StrategyRow(strategy=name, measured=errors(mean)) for name, mean in (("none", 40.0), ("bounded", 6.0))]
    captures = (errors(6.0), errors(5.0))
    loop = ClosedLoop(strategy="bounded", rule="image", damping=1.0, captures=captures, best=2, stopped="")
    known = [StrategyRow(strategy="bounded", measured=errors(5.0))]
    assert ratios(rows, [loop], known) == {
        "bounded / none": 0.15,
        "bounded, closed loop / none": 0.125,
        "bounded / oracle": 1.2,
        "bounded, closed loop / oracle": 1.0,
    }


def test_without_direct_light_beside_it_nothing_can_be_worse() -> None:
    picture = ComparedPicture(name="target", title="", rows=(StrategyRow(strategy="none", measured=errors(40.0)),))
    assert warnings_of([picture]) == ()
