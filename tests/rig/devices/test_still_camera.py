"""A still camera: its steps, its states, and what is said of each fault."""

import sys
from collections.abc import Mapping
from contextlib import closing
from types import SimpleNamespace
from unittest.mock import MagicMock

import cv2
import numpy as np
import pytest

from rig.devices.clock import VirtualClock
from rig.devices.gphoto2 import camera as still
from rig.devices.gphoto2 import port
from rig.devices.gphoto2.camera import StillCamera, StillOptions, from_profile, seconds
from rig.devices.gphoto2.pictures import WantedPicture, from_jpeg, from_raw
from rig.devices.gphoto2.port import library, named
from rig.emulated.still.dng import dng
from rig.errors import CaptureTimeout, DeviceBusy, DeviceError, DeviceLost, ProfileError, SettingRefused
from rig.profile.schema import Profile
from tests.still import needs_gphoto2

SPEEDS = ["bulb", "30", '2"', "1.3", "1/2", "1/50", "0.0100s", "1/4000"]
SHAPE = (20, 30, 1)


class FakePort:
    """A camera of settings, for states that the virtual one never has."""

    settings: Mapping[str, str] = {}
    picture = b""
    clock: VirtualClock | None = None
    mirror_s = 0.12
    """From the command to the exposure, and back."""

    def __init__(self, device_id: str, name: str):
        self.now = {"shutterspeed": "1/50", **self.settings}

    def value(self, setting: str) -> str | None:
        return self.now.get(setting)

    def choices(self, setting: str) -> list[str]:
        known = {
            "shutterspeed": SPEEDS,
            "iso": ["Auto", "100", "200", "6400"],
            "imagequality": ["JPEG Fine", "NEF+Fine", "NEF (Raw)"],
        }
        return known.get(setting, [])

    def hold(self, setting: str, value: str) -> None:
        self.now[setting] = value

    def release(self, exposure_s: float) -> bytes:
        if self.clock is not None:
            self.clock.wait_until_s(self.clock.now_s() + self.mirror_s + exposure_s)
        return self.picture

    def close(self) -> None:
        pass


class FakeLibrary:
    """gphoto2 with one camera at a USB port, which keeps a picture on its card."""

    GP_CAPTURE_IMAGE = GP_FILE_TYPE_NORMAL = 0

    class GPhoto2Error(Exception):
        code = -1

    def __init__(self, *, deletes: bool):
        self.deletes, self.card = deletes, list[str]()
        self.PortInfoList = MagicMock()

    def Camera(self) -> "FakeLibrary":
        return self

    def set_port_info(self, port: object) -> None: ...
    def init(self) -> None: ...
    def exit(self) -> None: ...

    def capture(self, _kind: int) -> SimpleNamespace:
        self.card.append("IMG_0002.JPG")
        return SimpleNamespace(folder="/", name=self.card[-1])

    def file_get(self, _folder: str, name: str, _kind: int) -> SimpleNamespace:
        return SimpleNamespace(get_data_and_size=lambda: name.encode())

    def file_delete(self, _folder: str, name: str) -> None:
        if not self.deletes:
            raise self.GPhoto2Error
        self.card.remove(name)


@pytest.mark.parametrize("deletes", [True, False], ids=["", "of which the card is locked"])
def test_a_camera_keeps_no_picture_that_was_fetched_if_it_can_help_it(
    monkeypatch: pytest.MonkeyPatch, deletes: bool
) -> None:
    fake = FakeLibrary(deletes=deletes)
    monkeypatch.setattr(port, "library", lambda: fake)
    with closing(port.StillPort("usb:001,004", "the camera")) as opened_port:
        assert [opened_port.release(1e-3) for _ in range(3)] == [b"IMG_0002.JPG"] * 3
    assert len(fake.card) == (0 if deletes else 3)


def opened(
    monkeypatch: pytest.MonkeyPatch, settings: Mapping[str, str], clock: VirtualClock | None = None
) -> StillCamera:
    picture = np.random.default_rng(3).integers(0, 255, SHAPE[:2], np.uint8)
    monkeypatch.setattr(FakePort, "settings", settings)
    monkeypatch.setattr(FakePort, "picture", cv2.imencode(".jpg", picture)[1].tobytes())
    monkeypatch.setattr(still, "StillPort", FakePort)
    camera = StillCamera(
        "usb:001,004",
        WantedPicture(SHAPE, 255, None),
        pixel_format="JPEG",
        exposure_range_s=(1e-3, 10.0),
        options=StillOptions(settings={"iso": "100"}),
        clock=clock or VirtualClock(),
    )
    camera.open()
    return camera


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1/50", 0.02),
        ("0.0200s", 0.02),
        ('2"', 2.0),
        ("1.3", 1.3),
        ("30", 30.0),
        ("bulb", None),
        ("0", None),
        ("", None),
    ],
)
def test_shutter_speeds_are_read_as_cameras_write_them(text: str, expected: float | None) -> None:
    assert seconds(text) == expected


def test_the_nearest_step_is_taken_and_said(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = opened(monkeypatch, {})
    assert [camera.set_exposure(one) for one in (0.019, 0.013, 1.0, 9.0)] == [0.02, 0.01, 1.3, 2.0]
    frame = camera.capture(after_s=5.0, timeout_s=60.0)
    assert (frame.exposure_s, frame.started_s, frame.sequence) == (2.0, 5.0, 1)
    with pytest.raises(SettingRefused, match="outside"):
        camera.set_exposure(20.0)
    with pytest.raises(CaptureTimeout, match=r"within 0\.5 s"):
        camera.capture(after_s=0.0, timeout_s=0.5)


def test_mirror_and_shutter_are_learned_and_a_picture_that_would_come_too_late_is_not_begun(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = VirtualClock()
    monkeypatch.setattr(FakePort, "clock", clock)
    camera = opened(monkeypatch, {}, clock)
    camera.set_exposure(0.02)
    assert camera.delay_s is None
    camera.capture(after_s=0.0, timeout_s=1.0)
    assert camera.delay_s == pytest.approx(FakePort.mirror_s)
    before_s = clock.now_s()
    with pytest.raises(CaptureTimeout, match=r"timing\.timeout_s more time"):
        camera.capture(after_s=before_s, timeout_s=0.1)
    assert clock.now_s() == before_s


def test_missing_libraries_are_named_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("gphoto2", "rawpy"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(DeviceError, match=r'gphoto2 is missing.*pip install "procam-rig\[still\]"'):
        library()
    with pytest.raises(DeviceError, match=r'rawpy is missing.*pip install "procam-rig\[still\]"'):
        from_raw(b"", WantedPicture((32, 48, 1), 100, "RGGB"))


def test_sensitivity_goes_by_the_camera_s_steps_and_is_put_back(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = opened(monkeypatch, {})
    gain = camera.gain_control()
    assert gain is not None
    assert gain.now() == (100.0, 100.0, 6400.0, "ISO")
    assert gain.change(1500.0).value == 6400.0  # nearer than 200 by a ratio
    assert gain.profile_lines() == '[camera.options.settings] iso = "6400"'
    with pytest.raises(SettingRefused, match="100 … 6400 ISO"):
        gain.change(50.0)
    camera.close()
    assert gain.now().value == 100.0
    assert camera.gain_control() is None


@pytest.mark.parametrize(
    ("settings", "remedy"),
    [
        ({"expprogram": "A"}, "turn it to M"),
        ({"focusmode": "AF-S"}, "switch to MF"),
        ({"batterylevel": "3%"}, "charge it"),
    ],
)
def test_dial_lens_and_battery_are_named(
    monkeypatch: pytest.MonkeyPatch, settings: Mapping[str, str], remedy: str
) -> None:
    with pytest.raises(SettingRefused, match=remedy):
        opened(monkeypatch, settings)
    assert opened(monkeypatch, {"expprogram": "M", "focusmode": "Manual", "batterylevel": "80%"}).delay_s is None


@needs_gphoto2
@pytest.mark.parametrize(
    ("code", "kind", "remedy"),
    [
        (-115, DeviceError, "card is full"),
        (-3, DeviceError, "card is full"),
        (-110, DeviceError, "it is busy"),
        (-112, DeviceError, "manual focus"),
        (-53, DeviceBusy, "another program has it"),
        (-52, DeviceLost, "switch it on"),
        (-10, CaptureTimeout, "plug it in again"),
    ],
)
def test_errors_of_the_library_are_said_with_the_remedy(code: int, kind: type[DeviceError], remedy: str) -> None:
    import gphoto2

    with pytest.raises(kind, match=remedy), named("camera", "releasing"):
        raise gphoto2.GPhoto2Error(code)


@needs_gphoto2
@pytest.mark.parametrize("mosaic", ["RGGB", "GRBG", "GBRG", "BGGR"])
def test_raw_pixels_are_left_as_they_are_and_white_is_full_scale(mosaic: str) -> None:
    pixels = np.random.default_rng(1).integers(0, 15001, (32, 48)).astype(np.uint16)
    data = dng(pixels, 15000, mosaic)
    np.testing.assert_array_equal(from_raw(data, WantedPicture((32, 48, 1), 15000, mosaic))[..., 0], pixels)
    scaled = from_raw(data, WantedPicture((32, 48, 1), 16383, mosaic))[..., 0]
    assert scaled.max() <= 16383
    np.testing.assert_allclose(scaled, pixels.astype(float) * 16383 / 15000, atol=0.51)
    assert from_raw(data, WantedPicture((32, 48, 3), 15000, None)).shape == (32, 48, 3)


@needs_gphoto2
def test_filters_with_black_levels_of_their_own_become_one_sensor() -> None:
    """A session knows one black level of a camera; grey light over four of them has to be grey."""
    black = (600, 512, 640, 530)  # of the pixels of the first row, then of the second
    light = np.arange(32 * 48).reshape(32, 48) // 4 * 4
    pixels = light + np.tile(np.reshape(black, (2, 2)), (16, 24))
    raw = dng(pixels.astype(np.uint16), 15000, "GRBG", black)
    found = from_raw(raw, WantedPicture((32, 48, 1), 15000, "GRBG"))[..., 0]
    np.testing.assert_array_equal(found, light + 640)
    dark = dng((pixels - light).astype(np.uint16), 15000, "GRBG", black)
    colour = from_raw(dark, WantedPicture((32, 48, 3), 15000, None))
    np.testing.assert_array_equal(colour, np.full((32, 48, 3), 640))
    clipped = np.full((32, 48), 15000, np.uint16)
    assert from_raw(dng(clipped, 15000, "GRBG", black), WantedPicture((32, 48, 1), 16383, "GRBG")).min() == 16383


@needs_gphoto2
def test_pictures_that_are_not_as_the_profile_says_are_refused() -> None:
    raw = dng(np.full((32, 48), 7, np.uint16), 100, "RGGB")
    with pytest.raises(SettingRefused, match="are RGGB, not BGGR"):
        from_raw(raw, WantedPicture((32, 48, 1), 100, "BGGR"))
    with pytest.raises(SettingRefused, match="48 x 32 px, not 40 x 32"):
        from_raw(raw, WantedPicture((32, 40, 1), 100, "RGGB"))
    with pytest.raises(DeviceError, match="no raw file"):
        from_raw(b"nothing", WantedPicture((32, 40, 1), 100, "RGGB"))
    with pytest.raises(DeviceError, match="no JPEG"):
        from_jpeg(b"nothing", WantedPicture((32, 40, 1), 255, None))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pixel_format": "Mono8"}, "JPEG or RAW"),
        ({"pixel_format": "JPEG", "bit_depth": 12}, "bit depth of 8"),
        ({"pixel_format": "RAW", "channels": 1}, "has three"),
        ({"pixel_format": "JPEG", "bit_depth": 8, "options": {"iso": "100"}}, r"camera\.options\.iso"),
    ],
)
def test_profiles_that_make_no_sense_are_refused(
    tiny_profile: Profile, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(ProfileError, match=message):
        from_profile(tiny_profile.camera.model_copy(update=changes), VirtualClock())
