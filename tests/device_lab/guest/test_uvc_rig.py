"""A whole rig with a real kernel's camera: whatever happens to the cable, every picture's frame is its own."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from rig.capture.rig import Rig
from rig.devices.protocols import Codes, RawFrame, Shown
from rig.devices.v4l2.camera import V4l2Camera
from rig.emulated.uvc.camera import FrameRequest
from rig.errors import CaptureTimeout, DeviceLost, SettingRefused
from rig.profile.schema import load_profile
from tests.device_lab.guest.emulated_camera import CLOCK, HEIGHT, Plugged, load_drivers, plugging
from tests.device_lab.waiting import GENEROUS_S
from tests.rig.emulated.numbered_pictures import PatternSource, encode_picture, read_number

LAMP_SHAPE = (12, 16)
EXPOSURE_S = 0.01
PROFILE = """
schema = 2
name = "lab"
[[camera]]
name = "camera"
driver = "v4l2"
device_id = "usb-1209:0001-LAB1"
pixel_format = "GREY"
width_px = 320
height_px = 240
bit_depth = 8
frame_rate_hz = 30.0
exposure_range_s = [0.001, 0.1]
exposure_s = 0.01
hfov_deg = 60.0
[[projector]]
name = "projector"
driver = "kms"
output = "HDMI-A-1"
width_px = 16
height_px = 12
refresh_rate_hz = 60.0
latency_s = 0.25
hfov_deg = 40.0
[surface]
kind = "box"
closed = true
[[scale]]
between = ["camera", "projector"]
baseline_m = 0.5
[timing]
timeout_s = 1.0
replug_timeout_s = 10.0
"""


@dataclass
class Lamp:
    """A projector without a screen: it notes what it shows since when."""

    shape: tuple[int, int] = LAMP_SHAPE
    shown: list[tuple[float, int, str]] = field(default_factory=list)
    is_open: bool = False
    on_show: Callable[[str], None] = lambda name: None

    def open(self) -> None:
        self.is_open = True

    def close(self) -> None:
        self.is_open = False
        self.shown.append((CLOCK.now_s(), 0, "black"))

    def show(self, codes: Codes, *, name: str) -> Shown:
        self.shown.append((CLOCK.now_s(), int(codes[0, 0]), name))
        now_s = self.shown[-1][0]
        self.on_show(name)
        return Shown(now_s, name)

    def code_over(self, started_s: float, ended_s: float) -> float:
        """Mean code between two times."""
        shown = [(0.0, 0, "black"), *self.shown]
        ends = [later[0] for later in shown[1:]] + [ended_s]
        total = 0.0
        for (begin_s, code, _), end_s in zip(shown, ends, strict=True):
            total += code * max(0.0, min(end_s, ended_s) - max(begin_s, started_s))
        return total / (ended_s - started_s)


@dataclass
class LampSource:
    """A room that the lamp lights: the flat field of the test picture has the lamp's code, at EXPOSURE_S.

    The frame's number in the picture stands for noise: no two frames are equal.
    """

    lamp: Lamp
    began_s: dict[int, float] = field(default_factory=dict)
    """Start of each exposure, by the number that its picture tells."""

    def expose(self, request: FrameRequest) -> bytes:
        picture = PatternSource().picture(request)
        ended_s = request.started_s + request.exposure_s
        CLOCK.wait_until_s(ended_s)
        level = self.lamp.code_over(request.started_s, ended_s) * request.exposure_s / EXPOSURE_S * request.gain
        picture[HEIGHT // 4 :] = min(255, round(level))
        self.began_s[request.number] = request.started_s
        return encode_picture(picture, request.fourcc)


@dataclass
class Lab:
    plug: Callable[..., Plugged]
    lamp: Lamp
    source: LampSource
    profile_file: Path

    def camera(self, **options) -> Plugged:
        return self.plug(source=self.source, longest_delay_s=0.08, **options)

    @contextmanager
    def rig(self) -> Iterator[Rig]:
        profile = load_profile(self.profile_file)
        settings = profile.camera
        camera = V4l2Camera(
            settings.device_id or "",
            shape=settings.shape,
            pixel_format="GREY",
            bit_depth=8,
            frame_rate_hz=30.0,
            exposure_range_s=settings.exposure_range_s,
            controls={},
            clock=CLOCK,
        )
        with Rig(profile, camera, self.lamp, CLOCK) as rig:
            rig.shoot(codes_of(120), name="first")
            rig.set_exposure(EXPOSURE_S)
            yield rig
        assert not self.lamp.is_open
        assert self.lamp.shown[-1][2] == "black"


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Lab]:
    load_drivers()
    lamp = Lamp()
    (tmp_path / "lab.toml").write_text(PROFILE)
    with plugging() as plug:
        yield Lab(plug, lamp, LampSource(lamp), tmp_path / "lab.toml")


def codes_of(level: int) -> Codes:
    return np.full(LAMP_SHAPE, level, np.uint8)


def level_of(frame: RawFrame) -> float:
    return float(frame.pixels[HEIGHT // 2 :].mean())


def kinds_of(rig: Rig) -> list[str]:
    return [event.kind for event in rig.events]


LEVELS = tuple(range(20, 240, 18))


def shoot_levels(rig: Rig, levels: tuple[int, ...] = LEVELS) -> list[float]:
    return [level_of(rig.shoot(codes_of(level), name=f"level-{level}")) for level in levels]


def test_each_frame_shows_its_own_picture(lab: Lab) -> None:
    lab.camera()
    with lab.rig() as rig:
        assert shoot_levels(rig) == pytest.approx(LEVELS, abs=1)


def test_a_sequence_goes_on_at_the_missing_frame_when_the_camera_returns_under_another_number(lab: Lab) -> None:
    before = lab.camera()
    after: list[Plugged] = []

    def replug() -> None:
        before.unplug()
        CLOCK.wait_until_s(CLOCK.now_s() + 0.3)
        after.append(lab.camera())

    replugging = threading.Thread(target=replug)
    middle = f"level-{LEVELS[5]}"

    def pull_the_cable(name: str) -> None:
        if name == middle and replugging.ident is None:
            replugging.start()

    lab.lamp.on_show = pull_the_cable
    with before.node.open("rb"), lab.rig() as rig:
        seen = shoot_levels(rig)
        replugging.join(GENEROUS_S)
        assert seen == pytest.approx(LEVELS, abs=1)
        assert {"unplugged", "replugged"} <= set(kinds_of(rig))
    assert after[0].node != before.node
    assert after[0].camera.controls.value("exposure") == 100
    names = [name for _, _, name in lab.lamp.shown if name.startswith("level")]
    assert list(dict.fromkeys(names)) == [f"level-{level}" for level in LEVELS]
    again = [name for one, name in pairwise(names) if one == name]
    assert again
    assert set(again) <= {middle, f"level-{LEVELS[6]}"}


def test_a_camera_that_stays_away_is_lost_in_time_and_the_lamp_is_black(lab: Lab) -> None:
    lab.profile_file.write_text(PROFILE.replace("replug_timeout_s = 10.0", "replug_timeout_s = 1.5"))
    plugged = lab.camera()
    with lab.rig() as rig:
        kept = shoot_levels(rig, LEVELS[:3])
        plugged.unplug()
        began_s = CLOCK.now_s()
        with pytest.raises(DeviceLost, match=r"usb-1209:0001-LAB1.*1.5 s"):
            rig.shoot(codes_of(99), name="lost")
        assert CLOCK.now_s() - began_s < 10
        assert not lab.lamp.is_open
        assert kept == pytest.approx(LEVELS[:3], abs=1)


def test_a_camera_that_comes_back_as_another_is_refused(lab: Lab) -> None:
    plugged = lab.camera()
    with lab.rig() as rig:
        plugged.unplug()
        lab.camera(fourccs=("Y16",))
        with pytest.raises(SettingRefused, match="Y16"):
            rig.shoot(codes_of(99), name="other")
        assert not lab.lamp.is_open


def test_a_hung_camera_is_opened_again_then_reset_and_the_sequence_goes_on(lab: Lab) -> None:
    plugged = lab.camera()
    with lab.rig() as rig:
        seen = shoot_levels(rig, LEVELS[:3])
        plugged.faults.frozen_until_reset = True
        seen += shoot_levels(rig, LEVELS[3:6])
        assert seen == pytest.approx(LEVELS[:6], abs=1)
        assert "reset" in kinds_of(rig)
        assert plugged.camera.controls.value("exposure") == 100


def test_a_camera_that_stays_silent_is_a_time_out_that_says_what_was_tried(lab: Lab) -> None:
    plugged = lab.camera()
    with lab.rig() as rig:
        plugged.faults.frozen = True
        with pytest.raises(CaptureTimeout):
            rig.shoot(codes_of(99), name="silent")
        assert not lab.lamp.is_open


def test_no_wrong_frame_is_accepted_while_frames_are_dropped_copied_torn_and_marked_bad(lab: Lab) -> None:
    plugged = lab.camera()
    random = np.random.default_rng(7)
    faults = ("dropped_frames", "duplicate_frames", "short_frames", "error_frames")

    ordered = []

    def order(_: str) -> None:
        if random.random() < 0.5:
            ordered.append(str(random.choice(faults)))
            setattr(plugged.faults, ordered[-1], int(random.integers(1, 4)))

    with lab.rig() as rig:
        lab.lamp.on_show = order
        for level in map(int, random.integers(10, 240, 40)):
            frame = rig.shoot(codes_of(level), name=f"level-{level}")
            late_s = frame.started_s - lab.source.began_s[read_number(frame.pixels[..., 0])]
            assert level_of(frame) == pytest.approx(level, abs=1), (
                f"its time stamp is {late_s * 1e3:.0f} ms late; events: {rig.events[-4:]}"
            )
        assert set(ordered) == set(faults)
