"""Profiles: every mistake is reported at once, in words that lead to the fix."""

import re
from pathlib import Path

import pytest

from rig.errors import ProfileError
from rig.profile.check import check_profiles
from rig.profile.schema import Profile, load_profile

ROOT = Path(__file__).parents[3]
TINY = (ROOT / "hw_profiles" / "ci-tiny.toml").read_text()


def problems(text: str) -> list[str]:
    with pytest.raises(ProfileError) as caught:
        Profile.parse(text.encode(), Path("lab.toml"))
    return str(caught.value).splitlines()


def changed(old: str, new: str) -> str:
    assert old in TINY
    return TINY.replace(old, new, 1)


def test_a_profile_keeps_its_bytes_and_their_hash() -> None:
    profile = load_profile(ROOT / "hw_profiles" / "ci-tiny.toml")
    assert profile.raw == TINY.encode()
    assert profile.camera.shape == (240, 320, 1)
    assert profile.camera.full_scale_dn == 4095
    assert profile.sha256 != Profile.parse(TINY.encode() + b"\n", Path("lab.toml")).sha256


def test_a_bare_name_is_found_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert load_profile("ci-tiny").name == "ci-tiny"
    with pytest.raises(ProfileError, match=r"lab-z: no such profile; give a file or one of .*ci-tiny"):
        load_profile("lab-z")


@pytest.mark.parametrize("path", sorted((ROOT / "hw_profiles").glob("*.toml")), ids=lambda p: p.stem)
def test_the_profiles_that_come_along_are_valid(path: Path) -> None:
    assert [check.problems for check in check_profiles([str(path)])] == [()]


def test_all_mistakes_are_reported_at_once() -> None:
    text = TINY.replace("exposure_s = 0.0166667", "exposure_ms = 16").replace("retries = 8", "retries = 2.5")
    text = text.replace("closed = true", 'closed = "yes"').replace("compression = 0.08", "compresion = 0.08")
    assert problems(text) == [
        "lab.toml: camera.exposure_s: missing",
        "lab.toml: camera.exposure_ms: unknown key; did you mean exposure_s (seconds)?",
        "lab.toml: timing.retries: is 2.5, should be a valid integer",
        "lab.toml: surface.closed: is 'yes', should be a valid boolean",
        "lab.toml: simulation.camera.compresion: unknown key; did you mean compression?",
    ]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[limits]", "[limit]", "limit: unknown key; did you mean limits?"),
        (
            "frame_rate_hz = 30.0",
            'frame_rate_hz = "30"',
            "camera.frame_rate_hz: is '30', should be a valid number",
        ),
        ("bit_depth = 12", "bit_depth = 17", "camera.bit_depth: is 17, should be less than or equal to 16"),
        ("width_px = 320", "width_px = true", "camera.width_px: is True, should be a valid integer"),
        ("hfov_deg = 100.0", "hfov_deg = nan", "camera.hfov_deg: is nan, should be a finite number"),
        (
            "exposure_s = 0.0166667",
            "exposure_s = 3.0",
            "camera: exposure_s 3 is outside exposure_range_s 0.0001 … 2",
        ),
        (
            "exposure_range_s = [1.0e-4, 2.0]",
            "exposure_range_s = [2.0, 1.0e-4]",
            "camera.exposure_range_s: 2 … 0.0001 is no range; give the smaller number first",
        ),
        (
            "distance_m = 4.876",
            "",
            "scale: spots_px and distance_m belong together; give both",
        ),
        (
            "distance_m = 4.876",
            "distance_m = 4.876\nbaseline_m = 0.6",
            "scale: needs either baseline_m, or spots_px and distance_m; measure one by tape",
        ),
        ("distance_m = 4.876", "distance_m = 4.876\ndistance_mm = 4876", "did you mean distance_m (metres)?"),
        ("schema = 2", "", "schema: missing"),
        ("right_angles = true", "askew_deg = 3.0", "surface.askew_deg: is 3.0, should be less than or equal to 2"),
        (
            "right_angles = true",
            "right_angles = false\naskew_deg = 0.3",
            "surface: askew_deg = 0.3 says how far right angles are off, right_angles = false that there are none",
        ),
    ],
)
def test_a_mistake_is_named(old: str, new: str, said: str) -> None:
    (line,) = problems(changed(old, new))
    assert line.startswith("lab.toml: ")
    assert said in line


def test_a_newer_schema_is_refused_before_anything_else() -> None:
    assert problems(changed("schema = 2", "schema = 3\nnovelty = 3")) == [
        "lab.toml: schema: 3 is newer than 2, the newest that this version reads; update procam-rig"
    ]


def test_camera_and_projector_have_to_be_of_one_kind() -> None:
    lines = problems(changed('driver = "simulated"', 'driver = "replay"'))
    assert "lab.toml: projector.driver: 'simulated', but the camera's is 'replay'; it has to be 'replay'" in lines
    assert "lab.toml: replay: missing; driver = 'replay' needs a [replay] table" in lines


def test_a_real_camera_needs_its_name_and_format_and_a_real_display() -> None:
    lines = problems(changed('driver = "simulated"', 'driver = "v4l2"'))
    assert "lab.toml: camera.device_id: missing; `rig devices` prints it" in lines
    assert "lab.toml: camera.pixel_format: missing; `rig devices` prints it" in lines
    assert any(line.endswith("the camera's is 'v4l2'; it has to be 'kms' or 'window' or 'virtual'") for line in lines)


def test_a_simulated_camera_has_no_device_name() -> None:
    lines = problems(changed('driver = "simulated"', 'driver = "simulated"\ndevice_id = "usb-1209:0001-A"'))
    assert lines == ["lab.toml: camera.device_id: only for driver = 'v4l2' or 'genicam' or 'gphoto2'; remove it"]


def test_a_simulated_rig_needs_a_simulation() -> None:
    assert problems(TINY[: TINY.index("[simulation]")]) == [
        "lab.toml: simulation: missing; driver = 'simulated' needs a [simulation] table"
    ]


def test_a_recording_is_looked_for_beside_the_profile(tmp_path: Path) -> None:
    text = (
        TINY[: TINY.index("[simulation]")].replace('"simulated"', '"replay"') + '[replay]\nmanifest = "photos/r.toml"\n'
    )
    profile = Profile.parse(text.encode(), tmp_path / "lab.toml")
    assert profile.recording == tmp_path / "photos" / "r.toml"
    assert problems(text + 'session = "x"') == [
        "lab.toml: replay: needs exactly one of session (a folder) and manifest (a TOML file)"
    ]


def test_text_that_is_no_toml_says_where() -> None:
    assert "line 2" in problems("schema = 1\nname = x\n")[0]
    with pytest.raises(ProfileError, match=r"lab\.toml: line 2: byte 7 is not UTF-8"):
        Profile.parse(b"a = 1\nb\xff", Path("lab.toml"))
    with pytest.raises(ProfileError, match=r"lab\.toml: is UTF-16; save the file as UTF-8"):
        Profile.parse("schema = 2".encode("utf-16"), Path("lab.toml"))


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("name = “tiny”", "write straight quotes"),
        ("name = ci-tiny", "a text stands between quotes"),
        ("name: 'tiny'", "write key = value"),
        ("exposure_s = 0,02", "write a decimal point, not a comma"),
        ("exposure_s =", "a value is missing"),
        ("right_angles = True", "write true or false"),
        ('lens = "C:\\Users\\me.toml"', "write / in paths"),
        ("\u00a0exposure_s = 0.02", "invisible signs"),
    ],
)
def test_a_slip_of_a_writer_is_shown_with_its_line_and_what_to_write(line: str, said: str) -> None:
    with pytest.raises(ProfileError, match=re.escape(said)) as refused:
        Profile.parse(f"schema = 2\n{line}\n".encode(), Path("lab.toml"))
    assert "line 2" in str(refused.value)


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_a_profile_of_another_editor_is_the_same_profile(mark: bytes, end: bytes, tiny_profile: Profile) -> None:
    again = Profile.parse(mark + tiny_profile.raw.replace(b"\n", end), Path("lab.toml"))
    assert again.model_dump() == tiny_profile.model_dump()
    assert again.text.startswith(tiny_profile.text[:10])


def test_one_broken_profile_does_not_hide_the_others(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text("schema = 2")
    bad, missing, good = check_profiles([str(tmp_path / "bad.toml"), "nowhere.toml", "ci-tiny"])
    assert not bad.ok
    assert len(bad.problems) > 3
    assert not missing.ok
    assert good.ok
    assert "320 x 240" in good.summary
