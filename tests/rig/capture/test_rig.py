"""The rig accepts a frame only when it belongs to what was shown, whatever the devices deliver."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from rig import open_rig
from rig.capture.rig import Rig
from rig.devices.clock import VirtualClock
from rig.devices.protocols import Codes, RawFrame, Shown
from rig.errors import CaptureTimeout, DeviceError, DeviceLost, ProfileError, SettingRefused
from rig.profile.schema import Profile

CAMERA_SHAPE = (4, 5, 1)
PROJECTOR_SHAPE = (3, 6)
LATENCY_S = 0.06
Fault = Callable[[RawFrame], RawFrame]


@dataclass
class FakeProjector:
    clock: VirtualClock
    shape: tuple[int, int] = PROJECTOR_SHAPE
    history: list[str] = field(default_factory=list)
    close_fails: bool = False
    open_fails: bool = False

    def open(self) -> None:
        if self.open_fails:
            raise DeviceLost("the lamp is out")
        self.history.append("open")

    def close(self) -> None:
        self.history.append("close")
        if self.close_fails:
            raise DeviceLost("pulled out")

    def show(self, codes: Codes, *, name: str) -> Shown:
        self.history.append(name)
        return Shown(self.clock.now_s(), name)


@dataclass
class FakeCamera:
    """Delivers good frames, each changed by the next of its faults; None is a timeout."""

    clock: VirtualClock
    faults: Iterable[Fault | None] = ()
    shape: tuple[int, int, int] = CAMERA_SHAPE
    full_scale_dn: int = 4095
    exposure_range_s: tuple[float, float] = (1e-3, 1.0)
    exposure_s: float = 0.01
    sequence: int = 0
    is_open: bool = False

    def __post_init__(self) -> None:
        self.faults = iter(self.faults)

    def open(self) -> None:
        self.is_open = True

    def close(self) -> None:
        self.is_open = False

    def set_exposure(self, exposure_s: float) -> float:
        self.exposure_s = round(exposure_s, 3)
        return self.exposure_s

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        fault = next(iter(self.faults), lambda frame: frame)
        if fault is None:
            self.clock.wait_until_s(self.clock.now_s() + timeout_s)
            raise CaptureTimeout(f"no frame within {timeout_s:g} s")
        self.sequence += 1
        started_s = max(after_s, self.clock.now_s())
        self.clock.wait_until_s(started_s + self.exposure_s)
        pixels = np.full(self.shape, 100, np.uint16)
        return fault(RawFrame(pixels=pixels, exposure_s=self.exposure_s, started_s=started_s, sequence=self.sequence))


@pytest.fixture
def profile(tiny_profile: Profile) -> Profile:
    timing = tiny_profile.timing.model_copy(update={"retries": 3, "timeout_s": 2.0})
    projector = tiny_profile.projector.model_copy(update={"latency_s": LATENCY_S})
    return tiny_profile.model_copy(update={"timing": timing}).with_device(projector)


def make_rig(profile: Profile, *faults: Fault | None) -> Rig:
    clock = VirtualClock(10.0)
    return Rig(profile, FakeCamera(clock, faults), FakeProjector(clock), clock)


def white() -> Codes:
    return np.full(PROJECTOR_SHAPE, 255, np.uint8)


def kinds(rig: Rig) -> list[str]:
    return [event.kind for event in rig.events]


def stale(frame: RawFrame) -> RawFrame:
    return replace(frame, started_s=frame.started_s - 1e-6)


def very_stale(frame: RawFrame) -> RawFrame:
    return replace(frame, started_s=frame.started_s - 10)


def repeated(frame: RawFrame) -> RawFrame:
    return replace(frame, sequence=frame.sequence - 1)


def short(frame: RawFrame) -> RawFrame:
    return replace(frame, pixels=frame.pixels[:-1])


def too_bright(frame: RawFrame) -> RawFrame:
    return replace(frame, pixels=np.full_like(frame.pixels, 4096))


def of_bytes(frame: RawFrame) -> RawFrame:
    return replace(frame, pixels=frame.pixels.astype(np.uint8))  # type: ignore[arg-type]


def old_exposure(frame: RawFrame) -> RawFrame:
    return replace(frame, exposure_s=frame.exposure_s * 1.05)


def of_another_clock(frame: RawFrame) -> RawFrame:
    return replace(frame, started_s=frame.started_s + 1e9)


def undated(frame: RawFrame) -> RawFrame:
    return replace(frame, started_s=float("nan"))


def test_a_frame_is_asked_for_after_the_latency(profile: Profile) -> None:
    with make_rig(profile) as rig:
        assert rig.shoot(white(), name="white").started_s == 10.0 + LATENCY_S
        assert rig.events == []


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        (stale, "stale"),
        (undated, "stale"),
        (of_another_clock, "ahead"),
        (short, "malformed"),
        (too_bright, "malformed"),
        (of_bytes, "malformed"),
        (old_exposure, "exposure"),
        (None, "timeout"),
    ],
)
def test_a_bad_frame_is_rejected_noted_and_asked_for_again(profile: Profile, fault: Fault | None, kind: str) -> None:
    with make_rig(profile, fault) as rig:
        rig.set_exposure(0.02)
        frame = rig.shoot(white(), name="white")
        assert frame.started_s >= 10.0 + LATENCY_S
        assert frame.pixels.shape == CAMERA_SHAPE
        assert frame.exposure_s == 0.02
        assert kinds(rig) == [kind]
        assert rig.events[0].detail.startswith("white: ")
        assert rig.events[0].time_s > 10.0


def test_the_same_frame_twice_is_not_two_measurements(profile: Profile) -> None:
    with make_rig(profile, lambda frame: frame, repeated) as rig:
        first, second = rig.shoot(white(), name="white"), rig.shoot(white(), name="white")
        assert second.sequence == first.sequence + 2
        assert kinds(rig)[0] == "repeated"


def test_the_frame_after_lost_ones_is_asked_for_again(profile: Profile) -> None:
    """Nobody can tell whether it is a copy of a lost one; a gap alone is a camera that ran on while nobody asked."""
    with make_rig(profile, lambda f: replace(f, sequence=40), lambda f: replace(f, sequence=44, lost=3)) as rig:
        rig.camera.sequence = 50  # type: ignore[attr-defined]
        rig.shoot(white(), name="white")
        assert rig.events == []
        assert rig.shoot(white(), name="white").sequence == 53
        assert [(e.kind, e.detail) for e in rig.events] == [("lost", "white: 3 frames before frame 44")]


def test_a_counter_that_begins_anew_costs_one_frame(profile: Profile) -> None:
    with make_rig(profile, lambda f: replace(f, sequence=900), lambda f: replace(f, sequence=1)) as rig:
        rig.shoot(white(), name="white")
        assert rig.shoot(white(), name="white").sequence == 3
        assert [(e.kind, e.detail) for e in rig.events] == [("repeated", "white: frame 1 came after frame 900")]


@pytest.mark.parametrize(("fault", "attempts"), [(very_stale, 8), (None, 4)])
def test_it_gives_up_after_the_retries_and_a_reopening_and_says_so(
    profile: Profile, fault: Fault | None, attempts: int
) -> None:
    """Every round has four attempts, or ends with the second silence in a row."""
    with make_rig(profile, *[fault] * 9) as rig:
        message = rf"no good frame of 'white' in {attempts} attempts of 2 s \((stale|timeout)\).*camera was reopened"
        with pytest.raises(CaptureTimeout, match=message):
            rig.shoot(white(), name="white")
        assert len(rig.events) == attempts + 1
        assert not rig.camera.is_open  # type: ignore[attr-defined]
        assert rig.projector.history[-1] == "close"  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "codes",
    [
        np.zeros((3, 5), np.uint8),
        np.zeros((6, 3), np.uint8),
        np.zeros((3, 6, 4), np.uint8),
        np.zeros((3, 6), np.float32),
        np.zeros((3, 6), np.uint16),
    ],
)
def test_codes_that_the_projector_cannot_show_are_refused(profile: Profile, codes: Codes) -> None:
    with make_rig(profile) as rig:
        with pytest.raises(SettingRefused, match=r"uint8 codes of shape \(3, 6\)"):
            rig.shoot(codes, name="white")
        assert rig.projector.history == ["open"]  # type: ignore[attr-defined]


def test_an_exposure_outside_the_range_is_refused(profile: Profile) -> None:
    with make_rig(profile) as rig:
        for exposure_s in (1e-4, 1.1, float("nan")):
            with pytest.raises(SettingRefused, match=r"outside the camera's 0.001 … 1 s"):
                rig.shoot(white(), name="white", exposure_s=exposure_s)


def test_the_camera_says_what_exposure_it_chose(profile: Profile) -> None:
    with make_rig(profile) as rig:
        assert rig.set_exposure(0.0204) == 0.02
        assert rig.shoot(white(), name="white").exposure_s == 0.02


def test_patterns_are_shot_one_by_one_as_asked_for(profile: Profile) -> None:
    @dataclass(frozen=True)
    class Named:
        name: str
        codes: Codes

    with make_rig(profile) as rig:
        frames = rig.shoot_all([Named("white", white()), Named("black", white() * 0)])
        assert rig.projector.history == ["open"]  # type: ignore[attr-defined]
        assert next(frames).sequence == 1
        assert rig.projector.history == ["open", "white"]  # type: ignore[attr-defined]
        assert next(frames).sequence == 2
        assert next(frames, None) is None


def test_both_devices_are_closed_even_when_one_fails(profile: Profile) -> None:
    rig = make_rig(profile)
    rig.projector.close_fails = True  # type: ignore[attr-defined]
    with pytest.raises(DeviceLost, match="pulled out"), rig:
        pass
    assert not rig.camera.is_open  # type: ignore[attr-defined]


def test_an_error_inside_closes_both_devices_and_comes_out(profile: Profile) -> None:
    rig = make_rig(profile)
    with pytest.raises(ZeroDivisionError), rig:
        raise ZeroDivisionError
    assert rig.projector.history[-1] == "close"  # type: ignore[attr-defined]
    assert not rig.camera.is_open  # type: ignore[attr-defined]


def test_a_projector_that_does_not_open_leaves_the_camera_closed(profile: Profile) -> None:
    rig = make_rig(profile)
    rig.projector.open_fails = True  # type: ignore[attr-defined]
    with pytest.raises(DeviceLost, match="the lamp is out"):
        rig.open()
    assert not rig.camera.is_open  # type: ignore[attr-defined]


def test_threads_shoot_one_after_the_other(profile: Profile) -> None:
    with make_rig(profile) as rig:
        threads = [Thread(target=lambda: [rig.shoot(white(), name="white") for _ in range(20)]) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert rig.events == []
        assert rig.shoot(white(), name="white").sequence == 81


def test_a_simulated_rig_opens_by_name_and_resumes_its_time() -> None:
    with open_rig("ci-tiny", resume_at_s=100.0) as rig:
        frame = rig.shoot(np.zeros(rig.projector.shape, np.uint8), name="black")
        assert frame.started_s >= 100.0 + rig.profile.projector.latency_s
        assert frame.exposure_s == pytest.approx(rig.profile.camera.exposure_s, rel=0.01)
    with pytest.raises(DeviceError):
        rig.shoot(np.zeros(rig.projector.shape, np.uint8), name="black")


def test_a_resumed_rig_sees_what_it_would_have_seen() -> None:
    def frames(start_s: float, count: int) -> list[RawFrame]:
        with open_rig("ci-tiny", resume_at_s=start_s) as rig:
            codes = np.full(rig.projector.shape, 128, np.uint8)
            return [rig.shoot(codes, name="level-128") for _ in range(count)]

    whole = frames(0.0, 5)
    resumed = frames(whole[1].started_s + whole[1].exposure_s, 3)
    for expected, frame in zip(whole[2:], resumed, strict=True):
        assert frame.started_s == expected.started_s
        np.testing.assert_array_equal(frame.pixels, expected.pixels)


def test_a_profile_that_is_not_there_opens_nothing(tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match="no such profile"):
        open_rig(tmp_path / "lab.toml")
