"""A profile of schema 1 becomes one of schema 2 that says the same, with its comments where they were."""

import tomllib
from pathlib import Path

import pytest

from rig.cli.app import run_command
from rig.errors import ProfileError
from rig.profile.schema import load_profile
from rig.profile.upgrade import upgrade_profile, upgraded_text

OLD = """\
# The wall in the lab.
schema = 1                        # the layout
name = "lab"

[pjlink]                          # before the projector, as nobody forbade
host = "10.0.0.7"

# What the sheet says.
[camera]
driver = "v4l2"                   # [room] is no table here
device_id = "usb-1209:0001-A"
pixel_format = "GREY"
width_px = 320
height_px = 240
bit_depth = 8
frame_rate_hz = 30.0
exposure_range_s = [0.001, 0.1]
exposure_s = 0.01
hfov_deg = 60.0

[timing]
timeout_s = 1.0

[camera.controls]                 # the least
gain = 0

[projector]
driver = "kms"
output = "HDMI-A-1"
width_px = 16
height_px = 12
refresh_rate_hz = 60.0
latency_s = 0.25
hfov_deg = 40.0

[scale]
# by tape
spots_px = [[1, 2], [10, 2]]
distance_m = 1.5

[room]
closed = true
"""


def test_every_table_comes_to_its_new_place_and_comments_stay(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    path.write_text(OLD, encoding="utf-8")
    upgraded = upgrade_profile(path)
    profile, text = load_profile(path), path.read_text(encoding="utf-8")
    assert profile.camera.name == "camera"
    assert profile.camera.controls == {"gain": 0}
    assert profile.projector.pjlink is not None
    assert profile.projector.pjlink.host == "10.0.0.7"
    assert profile.scale.projector == "projector"
    assert profile.room.closed
    comments = [line.partition("#")[2] for line in OLD.splitlines() if "#" in line]
    assert all(f"#{comment}" in text for comment in comments)
    assert text.index("# What the sheet says.") < text.index("[[camera]]") < text.index("[timing]")
    assert (tmp_path / "lab.toml.schema1").read_text(encoding="utf-8") == OLD
    assert '+between = ["camera"' not in upgraded.diff
    assert "+[[camera]]" in upgraded.diff


def test_the_verb_prints_what_it_changed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "lab.toml"
    path.write_text(OLD, encoding="utf-8")
    assert run_command(["profile", "check", str(path)]) == 2
    assert f"schema: 1 is older than 2, which this version reads; run: rig profile upgrade {path}" in (
        capsys.readouterr().out
    )
    assert run_command(["profile", "upgrade", str(path)]) == 0
    said = capsys.readouterr().out
    assert "-[room]\n+[surface]\n+kind" in said
    assert said.endswith(f"{path}: upgraded; the old file is {path}.schema1\n")
    assert run_command(["profile", "upgrade", str(path)]) == 2
    assert "schema: is 2 already; there is nothing to upgrade" in capsys.readouterr().err


def test_a_length_between_lenses_names_both() -> None:
    text = OLD.replace("spots_px = [[1, 2], [10, 2]]\ndistance_m = 1.5", "baseline_m = 0.5")
    assert tomllib.loads(upgraded_text(text, Path("lab.toml")))["scale"] == [
        {"between": ["camera", "projector"], "baseline_m": 0.5}
    ]


def test_tables_that_are_written_in_another_way_are_refused_unchanged(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    path.write_text(OLD.replace("[room]\nclosed = true\n", "").replace('"lab"\n', '"lab"\nroom.closed = true\n'))
    before = path.read_bytes()
    with pytest.raises(ProfileError, match="cannot be upgraded line by line; write its tables as"):
        upgrade_profile(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_one_that_is_wrong_already_is_refused_unchanged(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    path.write_text(OLD.replace("bit_depth = 8", "bit_depth = 7"))
    with pytest.raises(ProfileError, match=r"camera\.bit_depth: is 7, should be greater than or equal to 8"):
        upgrade_profile(path)
    assert list(tmp_path.iterdir()) == [path]


def test_a_sessions_copy_belongs_to_what_it_measured(tmp_path: Path) -> None:
    path = tmp_path / "profile.toml"
    path.write_text(OLD)
    (tmp_path / "session.json").write_text("{}")
    with pytest.raises(ProfileError, match="is a session's own copy"):
        upgrade_profile(path)
    with pytest.raises(ProfileError, match="the session was made with an older version of procam-rig"):
        load_profile(path)


def test_what_lies_in_the_way_of_the_backup_is_kept(tmp_path: Path) -> None:
    path, backup = tmp_path / "lab.toml", tmp_path / "lab.toml.schema1"
    path.write_text(OLD)
    backup.write_text("precious")
    with pytest.raises(ProfileError, match="is there already; move it away"):
        upgrade_profile(path)
    assert (path.read_text(), backup.read_text()) == (OLD, "precious")
