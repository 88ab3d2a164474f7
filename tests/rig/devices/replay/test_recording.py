"""A recording is played back as it is: by name, by exposure, in its order, and nothing else."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from rig.capture.rig import Rig, open_rig
from rig.devices.clock import VirtualClock
from rig.devices.protocols import ExposureRange, RawFrame, signature_of
from rig.devices.replay.recording import RecordedFrame, Recording, ReplayProjector
from rig.errors import DeviceLost, NotRecorded, ProfileError, SessionCorrupt, SessionError, SettingRefused
from rig.profile.schema import Profile
from rig.session import Session

EXPOSURE_S = 0.01667


def frame(profile: Profile, level: int, exposure_s: float = EXPOSURE_S) -> RawFrame:
    return RawFrame(
        pixels=np.full(profile.camera.shape, level, np.uint16), exposure_s=exposure_s, started_s=1.0, sequence=1
    )


@pytest.fixture
def recorded(tmp_path: Path, tiny_profile: Profile) -> Path:
    """Three whites at one exposure, one at another; a black that was shot again with other settings."""
    with Session.open(tmp_path / "recorded", tiny_profile) as session:
        step = session.step("white")
        for k in range(3):
            step.save_frame(f"white.{k}", frame(tiny_profile, 100 + k), pattern="white")
        step.save_frame("white.long", frame(tiny_profile, 200, 0.1), pattern="white")
        step.finish()
        for level in (1, 2):
            dark = session.step("dark", settings={"attempt": level})
            dark.save_frame("black", frame(tiny_profile, level))
            dark.finish()
    return tmp_path / "recorded"


def replay_profile(profile: Profile, folder: Path, table: str, **changed: int) -> Profile:
    text = profile.raw.decode()
    text = text[: text.index("[simulation]")].replace('driver = "simulated"', 'driver = "replay"')
    for key, value in changed.items():
        old = next(line for line in text.splitlines() if line.startswith(f"{key} ="))
        text = text.replace(old, f"{key} = {value}", 1)
    path = folder / "lab.toml"
    path.write_text(f"{text}\n[replay]\n{table}\n")
    return Profile.parse(path.read_bytes(), path)


def level(rig: Rig, name: str) -> int:
    codes = np.zeros(rig.projector.shape, np.uint8)
    (value,) = np.unique(rig.shoot(codes, name=name).pixels)
    return int(value)


@pytest.fixture
def profile(recorded: Path, tiny_profile: Profile) -> Profile:
    return replay_profile(tiny_profile, recorded.parent, 'session = "recorded"')


def test_repeats_come_in_order_and_then_the_last_again(profile: Profile) -> None:
    with open_rig(profile) as rig:
        assert [level(rig, "white") for _ in range(5)] == [100, 101, 102, 102, 102]


def test_exposures_are_told_apart(profile: Profile) -> None:
    with open_rig(profile) as rig:
        assert rig.set_exposure(0.1) == 0.1
        assert level(rig, "white") == 200
        rig.set_exposure(EXPOSURE_S)
        assert level(rig, "white") == 100
        assert rig.set_exposure(0.0167) == EXPOSURE_S, "what the camera chose when it was recorded"


def test_an_exposure_that_was_not_recorded_is_refused(profile: Profile) -> None:
    with open_rig(profile) as rig:
        with pytest.raises(SettingRefused, match=r"nothing was recorded at 0\.05 s; the nearest is 0\.01667 s"):
            rig.set_exposure(0.05)
        rig.set_exposure(0.1)
        with pytest.raises(DeviceLost, match=r"has 'black' exposed 0\.01667 s, not 0\.1 s"):
            level(rig, "black")


def test_of_a_repeated_step_the_last_run_counts(profile: Profile) -> None:
    with open_rig(profile) as rig:
        assert level(rig, "black") == 2


def test_a_pattern_that_was_not_recorded_is_named_with_those_that_were(profile: Profile) -> None:
    with (
        open_rig(profile) as rig,
        pytest.raises(NotRecorded, match="has no frame 'gray-row-03'; it has black, white; record again"),
    ):
        level(rig, "gray-row-03")


def test_the_recorded_rig_and_the_profile_have_to_agree(recorded: Path, tiny_profile: Profile) -> None:
    other = replay_profile(tiny_profile, recorded.parent, 'session = "recorded"', width_px=321)
    with pytest.raises(ProfileError, match=r"camera's shape is \(240, 321, 1\), but \(240, 320, 1\)"):
        open_rig(other)


def test_a_folder_without_a_journal_is_refused(recorded: Path, profile: Profile) -> None:
    (recorded / "journal.jsonl").unlink()
    with pytest.raises(SessionError, match=r"journal\.jsonl: cannot be read"):
        open_rig(profile)


def test_a_damaged_frame_event_is_named_with_its_line(recorded: Path, profile: Profile) -> None:
    path = recorded / "journal.jsonl"
    path.write_text(path.read_text().replace('"pattern"', '"patern"', 1))
    with pytest.raises(SessionCorrupt, match=r"journal\.jsonl: line 3 is damaged"):
        open_rig(profile)


def test_a_session_can_be_replayed_while_it_grows(recorded: Path, profile: Profile) -> None:
    """A last line that is only half there, as after a crash, is not read."""
    with (recorded / "journal.jsonl").open("a") as file:
        file.write('{"event": "frame", "step": "dark", "na')
    with open_rig(profile) as rig:
        assert level(rig, "black") == 2


@pytest.fixture
def photographed(tmp_path: Path, tiny_profile: Profile) -> Profile:
    """Gray code and others; each photograph is flat and its level tells which it is."""
    camera, projector = tiny_profile.camera, tiny_profile.projector
    lists = {"columns": "c", "columns_inverse": "ci", "rows": "r", "rows_inverse": "ri"}
    files = {key: [f"{letter}{k}.png" for k in range(8)] for key, letter in lists.items()}
    for k, name in enumerate([*(file for listed in files.values() for file in listed), "white.png"]):
        cv2.imwrite(str(tmp_path / name), np.full(camera.shape[:2], 10 + k, np.uint16))
    cv2.imwrite(str(tmp_path / "colour.png"), np.full((*camera.shape[:2], 3), (30, 60, 90), np.uint8))
    (tmp_path / "replay.toml").write_text(
        f"schema = 1\n[camera]\nwidth_px = {camera.width_px}\nheight_px = {camera.height_px}\n"
        f"full_scale_dn = 4095\n"
        f"[projector]\nwidth_px = {projector.width_px}\nheight_px = {projector.height_px}\n"
        "[gray_code]\n" + "".join(f"{key} = {listed}\n" for key, listed in files.items()) + "[frames]\n"
        'white = "white.png"\n"level-128" = "colour.png"\n'
    )
    return replay_profile(tiny_profile, tmp_path, 'manifest = "replay.toml"')


def test_photographs_are_found_by_the_pattern_that_they_show(photographed: Profile) -> None:
    expected = {
        "gray-column-07": 10,
        "gray-column-00": 17,
        "gray-column-06-inverse": 19,
        "gray-row-07": 26,
        "gray-row-00-inverse": 41,
        "white": 42,
    }
    with open_rig(photographed) as rig:
        assert {name: level(rig, name) for name in expected} == expected
        rig.set_exposure(0.1)
        assert level(rig, "white") == 42, "photographs do not say their exposure"


def test_a_colour_photograph_is_grey_to_a_grey_camera(photographed: Profile) -> None:
    with open_rig(photographed) as rig:
        assert level(rig, "level-128") == round(0.299 * 90 + 0.587 * 60 + 0.114 * 30)


def test_every_missing_photograph_is_named(photographed: Profile) -> None:
    for name in ("c7.png", "white.png"):
        (photographed.path.parent / name).unlink()
    with pytest.raises(DeviceLost) as caught:
        open_rig(photographed)
    assert "2 of " in str(caught.value)
    assert "c7.png" in str(caught.value)
    assert "white.png" in str(caught.value)


def test_photographs_of_another_size_are_refused(photographed: Profile) -> None:
    cv2.imwrite(str(photographed.path.parent / "white.png"), np.zeros((4, 5), np.uint8))
    with pytest.raises(DeviceLost, match=r"white\.png: is 5 × 4 px, the manifest's camera 320 × 240 px"):
        open_rig(photographed)


def test_a_manifest_of_another_camera_is_refused(photographed: Profile) -> None:
    text = photographed.recording.read_text()
    photographed.recording.write_text(text.replace("full_scale_dn = 4095", "full_scale_dn = 255"))
    with pytest.raises(ProfileError, match=r"the camera's full scale is 4095, but 255 in .*replay\.toml"):
        open_rig(photographed)


def test_a_picture_that_was_not_recorded_is_refused(tiny_profile: Profile, tmp_path: Path) -> None:
    shape = tiny_profile.projector.shape
    recorded = np.full(shape, 128, np.uint8)
    frame = RecordedFrame(0.01, lambda: np.zeros(tiny_profile.camera.shape, np.uint16), signature_of(recorded))
    recording = Recording(
        source=tmp_path,
        camera_shape=tiny_profile.camera.shape,
        projector_shape=shape,
        full_scale_dn=4095,
        exposure_range_s=ExposureRange(0.001, 1.0),
        frames={"shown": (frame,)},
    )
    projector = ReplayProjector(recording, VirtualClock())
    projector.open()
    assert projector.show(recorded + 1, name="shown").name == "shown"
    other = recorded.copy()
    other[: shape[0] // 2] = 0
    with pytest.raises(DeviceLost, match="another picture"):
        projector.show(other, name="shown")
