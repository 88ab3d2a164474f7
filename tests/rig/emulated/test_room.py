"""What the emulated camera sees, without any kernel: a stand-in display, virtual time."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from rig.devices.clock import VirtualClock
from rig.devices.protocols import Codes
from rig.devices.simulated.world import SimulatedWorld
from rig.emulated.commands import COMMANDS, obey
from rig.emulated.rig import EmulatedRig, camera_formats, open_display, real_time_world, still, usb_identity
from rig.emulated.room import RoomSource
from rig.emulated.uvc.camera import FrameRequest
from rig.emulated.uvc.formats import encoded
from rig.errors import DeviceLost, ProfileError
from rig.profile.schema import Profile

SHAPE = (192, 256)
WHITE, BLACK = np.full((*SHAPE, 3), 255, np.uint8), np.zeros((*SHAPE, 3), np.uint8)


class ScriptedDisplay:
    """A display whose picture is a function of time; looking at it may take a while."""

    def __init__(self, clock: VirtualClock, picture_at: Callable[[float], Codes], look_s: float = 0.0):
        self._clock, self._picture_at, self._look_s = clock, picture_at, look_s

    def shape(self) -> tuple[int, int]:
        height, width, _ = self._picture_at(self._clock.now_s()).shape
        return height, width

    def picture(self) -> Codes:
        codes = self._picture_at(self._clock.now_s())
        self._clock.wait_until_s(self._clock.now_s() + self._look_s)
        return codes


def dark(_: float) -> Codes:
    raise DeviceLost("Virtual-1 is dark")


@pytest.fixture(scope="module")
def world(tiny_profile: Profile) -> SimulatedWorld:
    assert tiny_profile.simulation is not None
    settings = tiny_profile.simulation.model_copy(update={"cell_size_m": 0.6})
    return SimulatedWorld(settings, (240, 320), SHAPE)


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock(10.0)


def request(started_s: float = 10.0, exposure_s: float = 0.04, fourcc: str = "Y12 ", gain: float = 1.0) -> FrameRequest:
    return FrameRequest(
        fourcc=fourcc, width_px=320, height_px=240, started_s=started_s, exposure_s=exposure_s, gain=gain, number=0
    )


def photograph(source: RoomSource, wanted: FrameRequest) -> np.ndarray:
    frame = source.expose(wanted)
    assert frame is not None
    return np.frombuffer(frame, "<u2").reshape(240, 320).astype(float)


def test_a_frame_is_ready_at_the_end_of_its_exposure(world: SimulatedWorld, clock: VirtualClock) -> None:
    source = RoomSource(world, ScriptedDisplay(clock, lambda _: WHITE), clock)
    assert photograph(source, request(started_s=11.0, exposure_s=0.5)).mean() > 500
    assert clock.now_s() == pytest.approx(11.5)


def test_light_follows_exposure_and_gain_above_the_black_level(world: SimulatedWorld, clock: VirtualClock) -> None:
    source = RoomSource(world, ScriptedDisplay(clock, lambda _: WHITE), clock)
    means = [
        photograph(source, request(clock.now_s(), exposure_s, gain=gain)).mean() - 64
        for exposure_s, gain in [(0.002, 1.0), (0.004, 1.0), (0.002, 2.0)]
    ]
    assert means[1] == pytest.approx(2 * means[0], rel=0.05)
    assert means[2] == pytest.approx(means[1], rel=0.02)


def test_pictures_that_change_during_an_exposure_are_mixed_by_their_shares(
    world: SimulatedWorld, clock: VirtualClock
) -> None:
    source = RoomSource(world, ScriptedDisplay(clock, lambda now_s: WHITE if now_s < 10.075 else BLACK), clock)
    mixed = photograph(source, request(10.0, 0.1, gain=0.05)).mean() - 64
    white = photograph(RoomSource(world, still(WHITE), clock), request(clock.now_s(), 0.1, gain=0.05)).mean() - 64
    assert mixed / white == pytest.approx(0.7, abs=0.15)


def test_a_frame_that_comes_too_late_is_lost_and_the_next_one_is_prompt(
    world: SimulatedWorld, clock: VirtualClock
) -> None:
    slow = RoomSource(world, ScriptedDisplay(clock, lambda _: WHITE, look_s=0.2), clock, prompt_s=0.1)
    assert slow.expose(request(10.0, 0.01)) is None
    assert slow.late_frames == 1
    assert RoomSource(world, ScriptedDisplay(clock, lambda _: WHITE), clock).expose(request(clock.now_s())) is not None


def test_a_dark_display_is_told_once_and_lights_nothing(world: SimulatedWorld, clock: VirtualClock) -> None:
    told: list[str] = []
    source = RoomSource(world, ScriptedDisplay(clock, dark), clock, note=told.append)
    frames = [photograph(source, request(clock.now_s())) for _ in range(3)]
    assert told == ["Virtual-1 is dark"]
    lit = photograph(RoomSource(world, still(WHITE), clock), request(clock.now_s()))
    assert max(frame.mean() for frame in frames) < 0.1 * lit.mean()


def test_a_display_of_another_size_is_told(world: SimulatedWorld, clock: VirtualClock) -> None:
    told: list[str] = []
    source = RoomSource(world, ScriptedDisplay(clock, lambda _: np.zeros((4, 6, 3), np.uint8)), clock, note=told.append)
    source.expose(request())
    assert told == ["the display shows 6 x 4 px, the room expects 256 x 192 px"]


def test_two_frames_never_have_the_same_noise(world: SimulatedWorld, clock: VirtualClock) -> None:
    source = RoomSource(world, still(WHITE), clock)
    first, second = (photograph(source, request(clock.now_s())) for _ in range(2))
    assert (first != second).mean() > 0.5


@pytest.mark.parametrize("fourcc", ["GREY", "YUYV", "Y10 ", "Y12 ", "Y16 ", "MJPG"])
def test_every_format_holds_the_picture(fourcc: str) -> None:
    pixels = np.arange(48, dtype=np.uint16).reshape(6, 8)
    data = np.frombuffer(encoded(pixels, fourcc), np.uint8)
    decoded = {
        "GREY": lambda: data.reshape(6, 8),
        "YUYV": lambda: data.reshape(6, 8, 2)[..., 0],
        "MJPG": lambda: cv2.imdecode(data, cv2.IMREAD_GRAYSCALE),
    }.get(fourcc, lambda: data.view("<u2").reshape(6, 8))()
    assert np.abs(decoded.astype(int) - pixels).max() <= (3 if fourcc == "MJPG" else 0)


def emulated_profile(tiny_profile: Profile, **camera: object) -> Profile:
    named = {"driver": "v4l2", "device_id": "usb-1209:0001-V7", "pixel_format": "Y12", **camera}
    return tiny_profile.with_device(tiny_profile.camera.model_copy(update=named))


def test_the_profile_says_what_the_camera_calls_itself_and_offers(tiny_profile: Profile) -> None:
    profile = emulated_profile(tiny_profile)
    assert usb_identity(profile) == (0x1209, 0x0001, "V7")
    assert [offered.fourcc for offered in camera_formats(profile)] == ["Y12 ", "GREY", "YUYV"]


@pytest.mark.parametrize("device_id", ["platform:vivid-000", "usb-1209:0001", "usb-xyz:0001-A", None])
def test_an_id_that_is_no_usb_identity_is_refused(tiny_profile: Profile, device_id: str | None) -> None:
    with pytest.raises(ProfileError, match="usb-1209:0001-EMULATED1"):
        usb_identity(emulated_profile(tiny_profile, device_id=device_id))


def test_a_format_that_the_camera_cannot_send_is_refused(tiny_profile: Profile) -> None:
    with pytest.raises(ProfileError, match="pixel_format"):
        camera_formats(emulated_profile(tiny_profile, pixel_format="BA81"))


def test_a_room_with_a_latency_of_its_own_is_refused(tiny_profile: Profile) -> None:
    with pytest.raises(ProfileError, match="latency of its real display"):
        real_time_world(tiny_profile)


def test_a_profile_without_a_room_is_refused(tiny_profile: Profile) -> None:
    with pytest.raises(ProfileError, match="needs a"):
        real_time_world(tiny_profile.model_copy(update={"simulation": None}))


def test_a_profile_without_a_kms_display_needs_to_be_told_where_to_look(tiny_profile: Profile) -> None:
    with pytest.raises(ProfileError, match="--picture"):
        open_display(tiny_profile)


class TestTypedCommands:
    @pytest.fixture
    def rig(self, tiny_profile: Profile) -> EmulatedRig:
        assert tiny_profile.simulation is not None
        lens = tiny_profile.simulation.projector.model_copy(update={"latency_s": 0.0, "jitter_s": 0.0})
        world = tiny_profile.simulation.with_device(lens).model_copy(update={"cell_size_m": 1.2})
        return EmulatedRig(
            profile=emulated_profile(tiny_profile).model_copy(update={"simulation": world}), display=still(WHITE)
        )

    def test_they_set_faults(self, rig: EmulatedRig) -> None:
        assert [obey(rig, line) for line in ("drop 3", "short", "error 2", "repeat 4", "freeze")] == [""] * 5
        faults = rig.faults
        assert (faults.dropped_frames, faults.short_frames, faults.error_frames, faults.duplicate_frames) == (
            3,
            1,
            2,
            4,
        )
        assert faults.frozen
        obey(rig, "go")
        assert not faults.frozen

    def test_unknown_words_are_answered_with_the_known_ones(self, rig: EmulatedRig) -> None:
        answer = obey(rig, "explode")
        assert answer is not None
        assert all(command in answer for command in COMMANDS)

    def test_quit_ends_and_unplugging_twice_does_nothing(self, rig: EmulatedRig) -> None:
        assert obey(rig, "quit") is None
        assert obey(rig, "unplug") == obey(rig, "unplug") == ""
        assert not rig.alive
