"""No frame is taken for another picture's, whatever the camera delivers."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.capture.rig import Rig
from rig.capture.tended_camera import FrameValidator, Rejection, Wanted
from rig.devices.clock import VirtualClock
from rig.devices.protocols import Codes, RawFrame
from rig.devices.simulated.devices import SimulatedCamera, SimulatedProjector
from rig.devices.simulated.optics import make_optics
from rig.devices.simulated.settings import SimulationSettings
from rig.devices.simulated.world import SimulatedWorld
from rig.profile.schema import Profile

SHAPE = (4, 8)
"""Of camera and projector: each camera pixel sees the projector pixel of the same place."""
BITS = 16
FRAME_RATE_HZ = 30.0
EXPOSURES_S = (0.02, 0.01)
LATENCY_S, JITTER_S, READOUT_S, STAMP_JITTER_S = 0.046, 0.03, 0.004, 0.002
WRONG_DN = 130
"""Seven standard deviations of white; an old picture's share of 5 % of the light is more."""


@dataclass
class CodeBench:
    """A world that costs nothing: what is shown is what is seen."""

    settings: SimulationSettings

    def __post_init__(self) -> None:
        self.camera = make_optics(self.settings.camera, SHAPE)
        self.projector = make_optics(self.settings.projector, SHAPE)

    def light(self, codes: Codes) -> SimpleNamespace:
        return SimpleNamespace(total=(codes / 255).astype(np.float32))

    def through_lens(self, radiosity: NDArray[np.float32]) -> NDArray[np.float32]:
        return radiosity


def coded(number: int) -> Codes:
    """16 bits and their complement, a pixel each."""
    bits = (number >> np.arange(BITS)) & 1
    return (255 * np.concatenate([bits, 1 - bits])).astype(np.uint8).reshape(SHAPE)


def make_rig(profile: Profile, camera: dict[str, Any], projector: dict[str, Any] | None = None) -> Rig:
    """A rig of few pixels, with these faults; its latency covers everything that a time stamp does not tell."""
    assert profile.simulation is not None
    lens = {"blur_px": 0.0, "compression": 0.0, "stale_frame_rate": 0.0}
    light = {"latency_s": LATENCY_S, "jitter_s": JITTER_S, **(projector or {})}
    settings = profile.simulation.with_device(
        profile.simulation.camera.model_copy(update={**lens, **camera})
    ).with_device(profile.simulation.projector.model_copy(update=light))
    pipeline_s = camera.get("pipeline_frames", 0) / FRAME_RATE_HZ
    latency_s = LATENCY_S + JITTER_S + pipeline_s + camera.get("time_stamp_jitter_s", 0.0)
    clock, world = VirtualClock(), cast("SimulatedWorld", CodeBench(settings))
    shown = SimulatedProjector(world, clock, refresh_rate_hz=60.0)
    seen = SimulatedCamera(
        (world,), shown, clock, bit_depth=12, frame_rate_hz=FRAME_RATE_HZ, exposure_range_s=(1e-3, 1.0)
    )
    settled = profile.projector.model_copy(update={"latency_s": latency_s})
    return Rig(profile.with_device(settled), seen, shown, clock)


def shows(frame: RawFrame, number: int) -> bool:
    """Whether every pixel of a frame has the brightness that this picture gives it."""
    if frame.pixels.shape != (*SHAPE, 1):
        return False
    white_dn = 4031 / 32000 * 1.1e6 * frame.exposure_s
    expected = 64 + white_dn * (coded(number) / 255)
    return bool(np.abs(frame.pixels[..., 0] - expected).max() < WRONG_DN)


def count_wrong(rig: Rig, shots: int) -> int:
    """How many shots came back with another picture, or another exposure, than was asked for."""
    wrong = 0
    with rig:
        for k in range(shots):
            number, exposure_s = (k * 40503) % 2**BITS, EXPOSURES_S[k // 20 % 2]
            frame = rig.shoot(coded(number), name=f"code-{number}", exposure_s=exposure_s)
            wrong += not shows(frame, number) or frame.exposure_s != exposure_s
    return wrong


FAULTS: dict[str, dict[str, Any]] = {
    "stale": {"stale_frame_rate": 0.05},
    "repeated": {"duplicate_frame_rate": 0.1},
    "malformed": {"short_frame_rate": 0.03},
    "exposure": {"exposure_delay_frames": 6},
}
HARMLESS_ALONE = {
    "dropped_frame_rate": 0.05,
    "sequence_restart_rate": 0.02,
    "time_stamp_jitter_s": STAMP_JITTER_S,
    "pipeline_frames": 1,
    "readout_s": READOUT_S,
}


def every(first_s: float, period_s: float, length_s: float) -> tuple[tuple[float, float], ...]:
    return tuple((t, t + length_s) for t in np.arange(first_s, 3000.0, period_s).tolist())


@pytest.mark.slow
def test_of_ten_thousand_frames_with_every_fault_none_is_wrong(tiny_profile: Profile) -> None:
    faults: dict[str, Any] = dict(HARMLESS_ALONE)
    for fault in FAULTS.values():
        faults |= fault
    events = {"unplugged_s": every(30.0, 200.0, 3.0), "frozen_s": every(110.0, 300.0, 40.0)}
    rig = make_rig(tiny_profile, {**faults, **events}, {"unplugged_s": every(70.0, 250.0, 2.0)})
    assert count_wrong(rig, 10_000) == 0
    seen = Counter(event.kind for event in rig.events)
    for kind in ("stale", "repeated", "lost", "malformed", "exposure"):
        assert seen[kind] > 100, kind
    assert seen["timeout"] >= 2 * seen["reopened"] > 6
    assert seen["unplugged"] == seen["replugged"] > 10


@pytest.mark.parametrize("kind", FAULTS)
def test_each_fault_is_found_by_its_name_and_no_frame_is_wrong(tiny_profile: Profile, kind: str) -> None:
    rig = make_rig(tiny_profile, FAULTS[kind])
    assert count_wrong(rig, 300) == 0
    assert {event.kind for event in rig.events} == {kind}


@pytest.mark.parametrize("kind", FAULTS)
def test_without_the_policy_each_fault_gives_wrong_frames(
    tiny_profile: Profile, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FrameValidator, "rejection", lambda *_: None)
    assert count_wrong(make_rig(tiny_profile, FAULTS[kind]), 300) > 3


@pytest.mark.parametrize("fault", HARMLESS_ALONE)
def test_faults_that_the_latency_covers_cost_time_only(tiny_profile: Profile, fault: str) -> None:
    assert count_wrong(make_rig(tiny_profile, {fault: HARMLESS_ALONE[fault]}), 300) == 0


def test_a_latency_that_does_not_cover_the_pipeline_gives_wrong_frames(tiny_profile: Profile) -> None:
    rig = make_rig(tiny_profile, {"pipeline_frames": 3})
    projector = rig.profile.projector.model_copy(update={"latency_s": LATENCY_S + JITTER_S})
    rig.profile = rig.profile.with_device(projector)
    assert count_wrong(rig, 100) > 50


@pytest.mark.parametrize("lost_and_copied", [{"dropped_frame_rate": 0.3, "duplicate_frame_rate": 0.3}])
def test_a_copy_of_a_frame_that_was_lost_is_not_taken(tiny_profile: Profile, lost_and_copied: dict[str, Any]) -> None:
    rig = make_rig(tiny_profile, lost_and_copied)
    assert count_wrong(rig, 1000) == 0


def test_a_picture_that_goes_dark_during_the_exposure_is_shown_and_taken_again(tiny_profile: Profile) -> None:
    rig = make_rig(tiny_profile, {}, {"unplugged_s": ((1.01, 1.02), (2.025, 2.03), (3.04, 3.05))})
    assert count_wrong(rig, 60) == 0
    assert [event.kind for event in rig.events] == 3 * ["unplugged", "replugged"]


# --- one frame after the other -------------------------------------------------------------------------------------

WANTED = Wanted(settled_s=1.0, exposure_s=0.01)


def noisy(seed: int, sequence: int, **changed: Any) -> RawFrame:
    pixels = np.random.default_rng(seed).integers(100, 120, (*SHAPE, 1), dtype=np.uint16)
    return replace(RawFrame(pixels=pixels, exposure_s=0.01, started_s=1.0 + sequence, sequence=sequence), **changed)


def judge(*, live: bool = True) -> Callable[[RawFrame], Rejection | None]:
    association = FrameValidator((*SHAPE, 1), 4095, 1 / FRAME_RATE_HZ, live=live)
    return lambda frame: association.rejection(frame, WANTED, now_s=100.0)


def test_pixels_that_come_twice_are_a_copy() -> None:
    verdict = judge()
    assert verdict(noisy(1, 1)) is None
    copy = verdict(noisy(1, 2))
    assert copy is not None
    assert copy.kind == "repeated"
    assert "frozen?" in copy.detail
    assert verdict(noisy(2, 3)) is None


def test_a_frame_whose_driver_says_that_it_repeats_is_a_copy() -> None:
    rejection = judge()(noisy(1, 1, repeats=True))
    assert rejection is not None
    assert rejection.kind == "repeated"


@pytest.mark.parametrize("level", [0, 4095])
def test_black_and_saturated_frames_may_be_equal(level: int) -> None:
    verdict = judge()
    for sequence in (1, 2):
        flat = np.full((*SHAPE, 1), level, np.uint16)
        assert verdict(noisy(1, sequence, pixels=flat, repeats=sequence == 2)) is None


def test_a_recording_may_give_a_frame_twice() -> None:
    verdict = judge(live=False)
    assert verdict(noisy(1, 1)) is None
    assert verdict(noisy(1, 2, lost=3)) is None


def test_an_old_frame_does_not_lower_the_count() -> None:
    """Else the frame that follows could be one that was delivered before."""
    verdict = judge()
    assert verdict(noisy(1, 9)) is None
    stale = verdict(noisy(2, 5, started_s=0.5))
    assert stale is not None
    again = verdict(noisy(3, 8))
    assert again is not None
    assert again.detail == "frame 8 came after frame 9"
