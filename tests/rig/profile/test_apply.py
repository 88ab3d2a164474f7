"""Measured values go into a profile line by line; what is a guess is listed, what cannot be meant is refused."""

import json
from pathlib import Path

import pytest

from rig.cli.app import run_command
from rig.errors import ProfileError
from rig.profile.apply import apply_values, guessed_keys, own_file
from rig.profile.schema import Profile, load_profile


@pytest.fixture
def own(tmp_path: Path, tiny_profile: Profile) -> Path:
    path = tmp_path / "own.toml"
    text = tiny_profile.raw.decode()
    assert text.count("latency_s = 0.06 ") == 1
    path.write_text(text.replace("latency_s = 0.06 ", "latency_s = 0.06 # MEASURE: `rig check` suggests it\nunused_s"))
    lines = [line for line in path.read_text().splitlines(keepends=True) if not line.startswith("unused_s")]
    path.write_text("".join(lines))
    return path


def test_values_take_the_place_of_guesses_and_the_old_file_stays(own: Path) -> None:
    before = own.read_text()
    assert guessed_keys(before) == ("projector.latency_s",)
    written = apply_values(own, {"projector.latency_s": 0.0721})
    assert load_profile(own).projector.latency_s == 0.0721
    assert guessed_keys(own.read_text()) == ()
    assert Path(written.backup).read_text() == before
    assert "-latency_s = 0.06 # MEASURE" in written.diff
    assert "+latency_s = 0.0721  # by rig check" in written.diff
    changed = [new for old, new in zip(before.splitlines(), own.read_text().splitlines(), strict=True) if old != new]
    assert len(changed) == 1, "every other line is as it was"


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"lamp.colour": 1.0}, "no table of its own for lamp.colour"),
        ({"projector.latency_s": 60.0}, "plausible"),
    ],
)
def test_values_that_cannot_be_written_leave_the_file_alone(own: Path, values: dict[str, float], words: str) -> None:
    before = own.read_bytes()
    with pytest.raises(ProfileError, match=words):
        apply_values(own, values)
    assert own.read_bytes() == before
    assert [path.name for path in own.parent.iterdir()] == ["own.toml"]


def test_a_value_that_had_no_line_comes_below_its_table(own: Path) -> None:
    lines = [line for line in own.read_text().splitlines(keepends=True) if not line.startswith("full_well_e")]
    own.write_text("".join(lines))
    apply_values(own, {"camera.full_well_e": 12345.0})
    assert load_profile(own).camera.full_well_e == 12345.0
    written = own.read_text().splitlines()
    assert written[written.index("[[camera]]") + 1].startswith("full_well_e = 12345")


def test_a_profile_that_ships_is_not_written_into(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ProfileError, match="is a profile of this program; copy"):
        own_file("ci-tiny")


def test_check_applies_what_it_measured_and_tells_it(own: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["check", "-p", str(own), "--only", "exposure", "--apply", "--json"]) in (0, 1)
    told = json.loads(capsys.readouterr().out)
    assert load_profile(own).camera.exposure_s == told["suggested"]["camera.exposure_s"]
    assert told["applied"]["path"] == str(own)
    assert "exposure_s" in told["applied"]["diff"]


def test_guesses_are_listed_by_profile_check(own: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["profile", "check", str(own)]) == 0
    said = capsys.readouterr().out
    assert "still a guess (MEASURE): projector.latency_s" in said
    assert "where you measured one, take the word out of its line" in said


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("latency_s = 0.06 ", "latency_s = 50.0 ", "seconds, not milliseconds?"),
        ("hfov_deg", "hfov_deg = 1.05 #", "degrees, not radians?"),
        ("distance_m = 4.876", "distance_m = 487.6", "metres, not centimetres"),
        ("frame_rate_hz = 30.0", "frame_rate_hz = 0.033", "hertz, not seconds a frame"),
        ("width_px", "width_px = 3000000 #", "no frame of it fits in memory"),
        ("exposure_s = 0.0166667", "exposure_s = 16666.7", "seconds, not milliseconds or microseconds?"),
        ("exposure_range_s = [", "exposure_range_s = [0.1, 33000.0] # [", "seconds, not milliseconds or microseconds?"),
        ("timeout_s", "timeout_s = 5000.0 #", "seconds, not milliseconds?"),
        ("patch_size_m", "patch_size_m = 30.0 #", "metres, not centimetres"),
        ("exposure_s = 0.0166667", "full_well_e = 3e8\nexposure_s = 0.0166667", "electrons, not digital numbers?"),
        ("exposures", "exposures = [1.0, 8000.0] #", "times camera.exposure_s, not seconds?"),
        ("spots_px = [[", "spots_px = [[38, 77], [2180, 77]] # [[", "is outside the projector's 256 x 192 px"),
        ("checker_size_px", "checker_size_px = 800 #", "fewer than two checks fit"),
    ],
)
def test_numbers_in_another_unit_or_beyond_memory_are_refused_before_anything_is_tried(
    tmp_path: Path, tiny_profile: Profile, capsys: pytest.CaptureFixture[str], old: str, new: str, words: str
) -> None:
    text = tiny_profile.raw.decode()
    path = tmp_path / "odd.toml"
    path.write_text(text.replace(old, new, 1))
    assert run_command(["run", str(tmp_path / "new"), "-p", str(path)]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
