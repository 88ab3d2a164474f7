"""Two cameras and two projectors on one clock: a picture is on one projector while the other is black."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest

from rig import open_rig
from rig.capture.rig import Rig
from rig.devices.clock import VirtualClock
from rig.devices.protocols import Codes, RawFrame, Shown
from rig.errors import DeviceLost, ProfileError, SettingRefused, UsageError
from rig.profile.schema import Profile

SHAPE = (6, 8)
LATENCIES_S = {"front": 0.03, "ceiling": 0.2}
PERIOD_S = 0.02


@dataclass(kw_only=True)
class Lamp:
    """A projector whose light comes after its latency; it notes what it is asked to show."""

    clock: VirtualClock
    latency_s: float
    shape: tuple[int, int] = SHAPE
    lit: list[tuple[float, int]] = field(default_factory=list)
    shown: list[str] = field(default_factory=list)
    away_until_s: float = 0.0
    opened: bool = False

    def open(self) -> None:
        if self.clock.now_s() < self.away_until_s:
            raise DeviceLost("unplugged")
        if not self.opened:
            self.lit.append((self.clock.now_s(), 99))  # whatever the display shows by itself
        self.opened = True

    def close(self) -> None:
        self.opened = False

    def check_on_screen(self) -> None:
        if not self.opened or self.clock.now_s() < self.away_until_s:
            raise DeviceLost("unplugged")

    def show(self, codes: Codes, *, name: str) -> Shown:
        self.check_on_screen()
        self.shown.append(name)
        self.lit.append((self.clock.now_s() + self.latency_s, int(codes.max())))
        return Shown(self.clock.now_s(), name)

    def level(self, time_s: float) -> int:
        return next((level for since_s, level in reversed(self.lit) if since_s <= time_s), 0)


@dataclass(kw_only=True)
class Eye:
    """A camera that sees the light of all lamps together, with a noise that never repeats."""

    clock: VirtualClock
    lamps: tuple[Lamp, ...]
    shape: tuple[int, int, int] = (*SHAPE, 1)
    full_scale_dn: int = 4095
    exposure_range_s: tuple[float, float] = (1e-3, 1.0)
    exposure_s: float = 0.0
    sequence: int = 0

    def open(self) -> None:
        self.sequence = 0

    def close(self) -> None:
        pass

    def set_exposure(self, exposure_s: float) -> float:
        self.exposure_s = exposure_s
        return exposure_s

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        started_s = max(after_s, self.clock.now_s())
        self.clock.wait_until_s(started_s + PERIOD_S)
        self.sequence += 1
        light = sum(max(lamp.level(started_s), lamp.level(started_s + PERIOD_S)) for lamp in self.lamps)
        pixels = np.full(self.shape, 10 * light, np.uint16)
        pixels[0, 0] = self.sequence
        return RawFrame(pixels=pixels, exposure_s=self.exposure_s, started_s=started_s, sequence=self.sequence)


@pytest.fixture(scope="module")
def profile(tiny_profile: Profile) -> Profile:
    """The tiny rig twice over, on drivers of real devices."""
    camera = tiny_profile.camera.model_copy(update={"driver": "v4l2"})
    projector = tiny_profile.projector.model_copy(update={"driver": "kms"})
    return tiny_profile.model_copy(
        update={
            "cameras": tuple(camera.model_copy(update={"name": name}) for name in ("left", "right")),
            "projectors": tuple(
                projector.model_copy(update={"name": name, "latency_s": latency_s})
                for name, latency_s in LATENCIES_S.items()
            ),
        }
    )


@dataclass
class Room:
    rig: Rig
    front: Lamp
    ceiling: Lamp
    eyes: dict[str, Eye]

    def shoot(self, level: int, projector: str, camera: str = "left") -> int:
        """The light that a camera sees of a flat picture on one projector."""
        codes = np.full(SHAPE, level, np.uint8)
        frame = self.rig.shoot(codes, name=f"flat-{level}", camera=camera, projector=projector)
        return int(frame.pixels[1, 1, 0]) // 10


@pytest.fixture
def room(profile: Profile) -> Iterator[Room]:
    clock = VirtualClock()
    front, ceiling = (Lamp(clock=clock, latency_s=latency_s) for latency_s in LATENCIES_S.values())
    eyes = {name: Eye(clock=clock, lamps=(front, ceiling)) for name in ("left", "right")}
    with Rig(profile, eyes, {"front": front, "ceiling": ceiling}, clock) as rig:
        for name in eyes:
            rig.set_exposure(0.01, camera=name)
        yield Room(rig, front, ceiling, eyes)


def test_a_picture_is_seen_alone_whichever_projector_shows_it(room: Room) -> None:
    levels = [(200, "front"), (150, "ceiling"), (120, "front"), (110, "front"), (0, "ceiling"), (90, "ceiling")]
    assert [room.shoot(level, projector) for level, projector in levels] == [level for level, _ in levels]


def test_each_camera_sees_it_with_its_own_exposure(room: Room) -> None:
    room.rig.set_exposure(0.05, camera="right")
    assert [room.shoot(80, "front", camera) for camera in ("left", "right", "left")] == [80, 80, 80]
    assert [eye.exposure_s for eye in room.eyes.values()] == [0.01, 0.05]


def test_a_projector_is_made_black_once_until_its_turn_comes(room: Room) -> None:
    for level in (200, 100, 50):
        room.shoot(level, "front")
    room.shoot(70, "ceiling")
    assert room.ceiling.shown == ["black", "flat-70"]
    assert room.front.shown == ["flat-200", "flat-100", "flat-50", "black"]


def test_one_that_was_opened_again_is_made_black_again(room: Room) -> None:
    room.shoot(200, "front")
    room.ceiling.opened, room.ceiling.away_until_s = False, room.rig.clock.now_s() + 3.0
    assert room.shoot(100, "front") == 100
    assert room.ceiling.shown == ["black", "black"]
    assert [event.kind for event in room.rig.events] == ["unplugged", "replugged"]
    assert room.rig.events[0].detail.startswith("projector ceiling")


def test_devices_are_found_by_name_and_have_to_be_named(room: Room) -> None:
    rig, codes = room.rig, np.zeros(SHAPE, np.uint8)
    assert list(rig.cameras) == ["left", "right"]
    assert rig.projectors["ceiling"] is room.ceiling
    with pytest.raises(UsageError, match=r"this rig has 2 cameras \(left, right\): say which, camera=NAME"):
        rig.shoot(codes, name="x", projector="front")
    with pytest.raises(UsageError, match=r"this rig has 2 projectors \(front, ceiling\): say which, projector=NAME"):
        rig.shoot(codes, name="x", camera="left")
    with pytest.raises(UsageError, match="no projector of this rig is named 'wall'; there are: front, ceiling"):
        rig.shoot(codes, name="x", camera="left", projector="wall")
    with pytest.raises(UsageError, match="2 cameras"):
        _ = rig.camera


def test_codes_have_the_shape_of_the_projector_that_shows_them(room: Room) -> None:
    room.ceiling.shape = (3, 4)
    with pytest.raises(SettingRefused, match=r"codes of shape \(3, 4\), not uint8 of \(6, 8\)"):
        room.shoot(1, "ceiling")


def test_every_device_is_closed_when_the_rig_is(room: Room) -> None:
    room.rig.close()
    assert not room.front.opened
    assert not room.ceiling.opened


def test_such_a_profile_is_not_opened_yet_and_the_message_says_from_when_on(profile: Profile) -> None:
    with pytest.raises(ProfileError) as caught:
        open_rig(profile)
    lines = str(caught.value).splitlines()
    assert [line.partition("ci-tiny.toml: ")[2].partition(";")[0] for line in lines] == [
        "camera: there are 2 (left, right)",
        "projector: there are 2 (front, ceiling)",
    ]
    assert all("version 0.3 will run several" in line for line in lines)
