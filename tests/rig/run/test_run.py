"""Small parts of the workflows: targets, frames and their log, devices, tables."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibration.structured_light.patterns import flat
from rig.capture.rig import Rig, open_rig
from rig.errors import CalibrationFailed, UsageError
from rig.files.exr import write_exr
from rig.files.pictures import write_png
from rig.profile.schema import Profile, load_profile
from rig.run import script as verbs
from rig.run.plan import plan_session
from rig.run.request import SessionRequest
from rig.run.session import opened_session
from rig.session import Session, Step
from rig.stages.photograph import ExposureBracket, frame_name, photograph
from rig.stages.target import check_strategies, load_target
from rig.terminal import TerminalProgress, print_table
from sim.compensation import STRATEGIES

# Photographs of another picture than the one that was on


@pytest.mark.parametrize("frames", [1, 2])
def test_a_camera_that_is_later_than_its_profile_says_is_refused_with_that_cause(tmp_path: Path, frames: int) -> None:
    text = Path("hw_profiles/ci-tiny.toml").read_text("utf-8").replace("cell_size_m = 0.2", "cell_size_m = 0.6")
    late = tmp_path / "late.toml"
    late.write_text(text.replace("stale_frame_rate = 0.02", f"pipeline_frames = {frames}"), "utf-8")
    with open_rig(load_profile(late)) as rig, Session.open(tmp_path / "session", rig.profile) as session:
        with pytest.raises(CalibrationFailed, match=r"the picture before.*Raise projector\.latency_s \(`rig check`"):
            verbs.calibrate(rig, session)


def test_frames_lost_before_black_do_not_hide_that_a_camera_is_late(tmp_path: Path) -> None:
    """With this seed those are lost that show white for black, but not those that show black for white."""
    text = Path("hw_profiles/ci-tiny.toml").read_text("utf-8").replace("cell_size_m = 0.2", "cell_size_m = 0.6")
    text = re.sub(r"(?m)^seed = \d+", "seed = 6", text)
    late = tmp_path / "late.toml"
    late.write_text(text.replace("stale_frame_rate = 0.02", "pipeline_frames = 1\ndropped_frame_rate = 0.3"), "utf-8")
    with open_rig(load_profile(late)) as rig, Session.open(tmp_path / "session", rig.profile) as session:
        with pytest.raises(CalibrationFailed, match=r"white after black is still 98 % that of black.*Raise projector"):
            verbs.calibrate(rig, session)


# Targets


def test_the_default_target_has_the_mean_and_spread_of_the_papers_experiment() -> None:
    grey = load_target(None, (192, 256)).grey
    assert grey.shape == (192, 256)
    assert grey.mean() == pytest.approx(123, abs=0.1)
    assert grey.std() == pytest.approx(46, abs=0.1)
    assert grey.min() >= 0
    assert grey.max() <= 255


def test_colours_become_grey_by_their_luminance(tmp_path: Path) -> None:
    rgb = np.zeros((2, 3, 3), np.uint8)
    rgb[0], rgb[1, :, 1] = (200, 200, 200), 100
    write_png(tmp_path / "a.png", rgb)
    grey = load_target(tmp_path / "a.png", (2, 3), is_linear=True).grey
    assert grey[0] == pytest.approx(200, abs=1e-3)
    assert grey[1] == pytest.approx(71.52, abs=1e-3)


def test_a_target_says_how_it_was_read_and_what_is_lost(tmp_path: Path) -> None:
    rgb = np.full((6, 8, 3), (200, 100, 50), np.uint8)
    write_png(tmp_path / "colour.png", rgb)
    write_png(tmp_path / "grey.png", rgb[..., 0])
    write_exr(tmp_path / "light.exr", {"Y": np.full((6, 8), 0.5)})
    colour, grey = (load_target(tmp_path / name, (6, 8)) for name in ("colour.png", "grey.png"))
    assert (colour.light, colour.lost_colours) == ("sRGB", True)
    assert (grey.light, grey.lost_colours) == ("sRGB", False)
    assert not load_target(tmp_path / "colour.png", (6, 8), channels=3).lost_colours
    assert load_target(tmp_path / "grey.png", (6, 8), is_linear=True).light == "linear light"
    assert load_target(tmp_path / "light.exr", (6, 8)).light == "linear light"
    assert load_target(tmp_path / "light.exr", (6, 8)).grey == pytest.approx(127.5)


def test_fit_scales_to_cover_and_crops_the_middle(tmp_path: Path) -> None:
    """A picture twice as wide as the projector's: the outer quarters go, nothing is squeezed."""
    wide = np.zeros((40, 160), np.uint8)
    wide[:, 40:120] = 200
    write_png(tmp_path / "wide.png", wide)
    grey = load_target(tmp_path / "wide.png", (20, 40), fit=True, is_linear=True).grey
    assert grey.shape == (20, 40)
    assert grey == pytest.approx(200, abs=1e-3)


def test_fit_enlarges_without_leaving_the_range(tmp_path: Path) -> None:
    edge = np.zeros((6, 8), np.uint8)
    edge[:, 4:] = 255
    write_png(tmp_path / "edge.png", edge)
    grey = load_target(tmp_path / "edge.png", (60, 80), fit=True).grey
    assert grey.shape == (60, 80)
    assert grey.min() == 0
    assert grey.max() == 255


def test_a_target_of_the_right_size_is_not_touched_by_fit(tmp_path: Path) -> None:
    levels = np.arange(48, dtype=np.uint8).reshape(6, 8)
    write_png(tmp_path / "a.png", levels)
    plain, fitted = (load_target(tmp_path / "a.png", (6, 8), fit, is_linear=True) for fit in (False, True))
    assert np.array_equal(plain.grey, levels)
    assert plain.sha256 == fitted.sha256
    write_png(tmp_path / "b.png", levels + np.uint8(1))
    assert load_target(tmp_path / "b.png", (6, 8)).sha256 != plain.sha256


def test_light_above_white_is_refused(tmp_path: Path) -> None:
    write_exr(tmp_path / "sun.exr", {"Y": np.full((6, 8), 3.0)})
    with pytest.raises(UsageError, match=r"grey levels up to 765, the limit is 255 \(1.0 in an EXR\)"):
        load_target(tmp_path / "sun.exr", (6, 8))


def test_strategies_come_once_and_after_none() -> None:
    assert check_strategies(("bounded", "paper", "none", "bounded")) == ("none", "bounded", "paper")
    assert check_strategies(()) == ("none",)
    assert check_strategies(("bounded", "all")) == tuple(STRATEGIES)
    with pytest.raises(UsageError, match="unknown strategy magic, best; there are"):
        check_strategies(("magic", "best"))


# Frames


def restless(profile: Profile) -> Profile:
    """Half of the frames come from before the picture was there."""
    text = profile.raw.decode().replace("stale_frame_rate = 0.02", "stale_frame_rate = 0.5")
    return Profile.parse(text.encode(), profile.path)


def photograph_levels(folder: Path, profile: Profile, count: int) -> list[str]:
    """Photograph levels into a session of its own or one that goes on; returns the names of its frames."""
    patterns = [flat(profile.projector.shape, 10 * k, f"level-{10 * k:03d}") for k in range(count)]
    shot = ExposureBracket((0.01, 0.02), repeats=2)
    with Session.open(folder, profile) as session, open_rig(profile, resume_at_s=session.last_clock_s) as rig:
        step = session.step("levels")
        photograph(rig, session, step, patterns, bracket=shot, n_patterns=count)
        return step.frame_names


def test_every_pattern_is_photographed_at_every_exposure_as_often_as_asked(
    tmp_path: Path, tiny_profile: Profile
) -> None:
    names = photograph_levels(tmp_path / "s", tiny_profile, 2)
    assert sorted(names) == [frame_name(f"level-{k:03d}", e, r) for k in (0, 10) for e in (0, 1) for r in (0, 1)]
    assert ExposureBracket((0.01, 0.02), repeats=2).frames_per_pattern == 4


def test_a_pattern_begins_with_the_exposure_that_the_one_before_ended_with(
    tmp_path: Path, tiny_profile: Profile
) -> None:
    names = photograph_levels(tmp_path / "s", tiny_profile, 3)
    exposures = [name.split(".")[1] for name in names]
    assert exposures == ["e0", "e0", "e1", "e1", "e1", "e1", "e0", "e0", "e0", "e0", "e1", "e1"]


def test_a_session_that_goes_on_takes_the_same_frames_and_notes_as_one_that_was_not_stopped(
    tmp_path: Path, tiny_profile: Profile
) -> None:
    profile = restless(tiny_profile)
    photograph_levels(tmp_path / "whole", profile, 4)
    for count in (1, 2, 4):
        photograph_levels(tmp_path / "parts", profile, count)
    for path in (tmp_path / "whole").glob("frames/*/*.exr"):
        assert (tmp_path / "parts" / path.relative_to(tmp_path / "whole")).read_bytes() == path.read_bytes()
    assert notes(tmp_path / "parts") == notes(tmp_path / "whole")
    assert len(notes(tmp_path / "whole")) > 3


def notes(folder: Path) -> list[dict[str, object]]:
    with Session.open(folder) as session:
        return [line["note"] for line in session.frame_log() if line["event"] == "note"]


def test_a_note_that_was_written_before_the_kill_is_not_written_again(
    tmp_path: Path, tiny_profile: Profile, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each run dies after one more frame, between the notes of the next and its frame."""
    profile = restless(tiny_profile)
    save = Step.save_frame
    saved = 0

    def save_one_then_die(*arguments: Any, **named: Any) -> None:
        nonlocal saved
        if saved:
            raise KeyboardInterrupt
        saved += 1
        save(*arguments, **named)

    with monkeypatch.context() as patched:
        patched.setattr(Step, "save_frame", save_one_then_die)
        for _ in range(10):
            saved = 0
            with pytest.raises(KeyboardInterrupt):
                photograph_levels(tmp_path / "s", profile, 4)
    photograph_levels(tmp_path / "s", profile, 4)
    photograph_levels(tmp_path / "undisturbed", profile, 4)
    assert len(notes(tmp_path / "undisturbed")) > 3
    assert notes(tmp_path / "s") == notes(tmp_path / "undisturbed")


def test_the_rig_of_a_session_that_goes_on_is_opened_once_and_when_it_is_needed(
    tmp_path: Path, tiny_profile: Profile, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[float] = []

    def counted(profile: Profile, *, resume_at_s: float) -> Rig:
        opened.append(resume_at_s)
        return open_rig(profile, resume_at_s=resume_at_s)

    photograph_levels(tmp_path / "s", tiny_profile, 1)
    monkeypatch.setattr("rig.run.session.open_rig", counted)
    with opened_session(plan_session(SessionRequest(folder=tmp_path / "s"))) as work:
        assert opened == []
        assert work.rig().clock.now_s() == opened[0] == work.session.last_clock_s > 0
        assert work.rig() is work.rig()
    assert len(opened) == 1


# Terminal


def test_tables_print_what_they_are_given(capsys: pytest.CaptureFixture[str]) -> None:
    print_table("runs [/x]", ["what [s]", "value"], [("[bold]", 0.0537), ("none", None), ("large", 12.345)])
    captured = capsys.readouterr()
    for text in ("runs [/x]", "what [s]", "[bold]", "0.0537", "12.35"):
        assert text in captured.out
    assert captured.err == ""


def test_progress_without_a_terminal_is_a_line_a_step_on_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    with TerminalProgress() as progress:
        for done, total in ((1, 2), (2, 2), (1, 5), (5, 5)):
            progress("photograph", done, total)
        progress("decode", 1, 2)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "starting\nphotograph: 5 of 5 done\ndecode: 1 of 2 done\n"
