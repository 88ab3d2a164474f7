"""How often a picture is photographed: as its noise asks for, and at the phases that room light asks for."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from calibration.structured_light.patterns import flat
from rig.capture.rig import Rig
from rig.devices.protocols import RawFrame
from rig.session import Session, Step
from rig.stages.light.repeats import quiet_repeats
from rig.stages.linear_light import distinct
from rig.stages.photograph import ExposureBracket, photograph

FRAME_S, SWELL_HZ, EXPOSURE_S = 1 / 30, 100.0, 0.007


def repeats_of(noise_share: float | None, *, limit: float = 5.0) -> int:
    camera = SimpleNamespace(white_noise_share=noise_share)
    record = SimpleNamespace(cameras={"camera": camera})
    profile = SimpleNamespace(
        camera=SimpleNamespace(name="camera"),
        limits=SimpleNamespace(comparison_rmse=limit),
        brightness=SimpleNamespace(target_white_share=0.7),
    )
    step = SimpleNamespace(load_record=lambda *_: record)
    return quiet_repeats(cast("Session", SimpleNamespace(profile=profile, finished=lambda _: step)))


def test_a_quiet_rig_takes_one_photograph_of_a_picture() -> None:
    """Noise of 3.6 grey levels at white is 2.7 at half the light."""
    assert repeats_of(0.01) == 1


def test_a_noisy_rig_takes_as_many_as_bring_its_noise_to_three_fifths_of_the_limit() -> None:
    n = repeats_of(0.02)
    white = 255 * 0.02 / 0.7
    assert n > 1
    assert white * np.sqrt(0.5 / n + 0.25 / max(n, 4)) <= 3.0
    assert white * np.sqrt(0.5 / (n - 1) + 0.25 / max(n - 1, 4)) > 3.0
    assert repeats_of(0.02, limit=8.0) < n


def test_however_noisy_a_rig_is_a_picture_has_an_end() -> None:
    assert repeats_of(1.0) == 8


def test_a_session_that_did_not_measure_its_noise_photographs_as_it_did() -> None:
    assert repeats_of(None) == 1


def test_a_frame_that_a_recording_gives_again_is_no_second_photograph() -> None:
    first, second = np.full((2, 3, 1), 7, np.uint16), np.full((2, 3, 1), 8, np.uint16)
    assert len(distinct([first, second, first.copy(), second])) == 2


@dataclass
class Clock:
    """Virtual time."""

    time_s: float = 0.0

    def now_s(self) -> float:
        return self.time_s

    def wait_until_s(self, time_s: float) -> None:
        self.time_s = max(self.time_s, time_s)


@dataclass
class Frames:
    """A step that keeps its frames."""

    name: str = "response"
    kept: dict[str, RawFrame] = field(default_factory=dict)

    def has_frame(self, name: str) -> bool:
        return name in self.kept

    def reuse_frame(self, *_: Any, **__: Any) -> bool:
        return False

    def load_frame(self, name: str) -> RawFrame:
        return self.kept[name]

    def save_frame(self, name: str, raw: RawFrame, **_: Any) -> None:
        self.kept[name] = raw


@dataclass
class SwellingRoom:
    """A rig in a room whose light swells, and which is ready for a frame at every third of its camera's."""

    every: int = 3
    driver: str = "simulated"
    clock: Clock = field(default_factory=Clock)
    events: list[Any] = field(default_factory=list)
    shots: int = 0

    @property
    def profile(self) -> Any:
        camera = SimpleNamespace(name="camera", driver=self.driver, frame_rate_hz=1 / FRAME_S)
        return SimpleNamespace(camera=camera, projector=SimpleNamespace(name="projector"))

    def shoot(self, _codes: Any, *, name: str, exposure_s: float) -> RawFrame:
        del name
        self.shots += 1
        start_s = (np.ceil(self.clock.now_s() / FRAME_S - 1e-6) + self.every) * FRAME_S
        self.clock.wait_until_s(start_s)
        level = 1000 + 100 * np.sin(2 * np.pi * SWELL_HZ * (start_s + exposure_s / 2))
        pixels = np.full((2, 2, 1), round(level), np.uint16)
        return RawFrame(pixels=pixels, exposure_s=exposure_s, started_s=start_s, sequence=self.shots)


def taken(room: SwellingRoom, bracket: ExposureBracket) -> list[float]:
    step, session = Frames(), SimpleNamespace(frame_log=list)
    white = flat((2, 2), 255, "white")
    rig, where, kept = cast("Rig", room), cast("Session", session), cast("Step", step)
    photograph(rig, where, kept, [white], bracket=bracket, n_patterns=1)
    return [float(frame.pixels.mean()) for frame in step.kept.values()]


@pytest.mark.parametrize("every", [3, 4, 5])
def test_repeats_are_taken_at_thirds_of_the_swell_however_fast_the_rig_is(every: int) -> None:
    levels = taken(SwellingRoom(every), ExposureBracket.blind_to(SWELL_HZ, (EXPOSURE_S,)))
    assert len(levels) == 3
    assert np.ptp(levels) > 50
    assert np.mean(levels) == pytest.approx(1000, abs=1)


def test_without_such_light_nothing_waits_and_nothing_is_taken_more_often() -> None:
    room = SwellingRoom()
    assert len(taken(room, ExposureBracket.blind_to(None, (EXPOSURE_S,), 2))) == 2
    assert room.shots == 2


def test_a_recording_gives_its_frames_in_their_order_whatever_its_clock_says() -> None:
    room = SwellingRoom(driver="replay")
    taken(room, ExposureBracket.blind_to(SWELL_HZ, (EXPOSURE_S,)))
    assert room.shots == 3


def test_repeats_come_in_whole_sets() -> None:
    assert [ExposureBracket.blind_to(100.0, (0.01,), n).repeats for n in (1, 3, 4, 8)] == [3, 3, 6, 9]
