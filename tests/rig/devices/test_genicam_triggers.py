"""Each trigger has its one frame: commands that are sent twice and frames that come late make none a wrong one."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.devices.clock import VirtualClock
from rig.devices.genicam.camera import GenicamCamera
from rig.devices.genicam.opened import OpenGenicam
from rig.devices.genicam.settings import GenicamOptions
from rig.devices.genicam.stream import FilledBuffer, GenicamSearch
from rig.devices.genicam.triggers import answer
from rig.errors import CaptureTimeout

EXPOSURE_S, READOUT_S, SENT_AGAIN_S = 0.02, 0.01, 0.5


@dataclass
class Sensor:
    """A camera on a virtual clock whose frames are the number of the picture that is shown when they begin."""

    clock: VirtualClock
    picture: int = 0
    under_way: list[tuple[float, float, int]] = field(default_factory=list)
    """(arrival, time stamp, picture), in the order of their arrival."""
    without_leader: bool = False
    """The next frame's first packet is lost."""

    def expose(self, began_s: float, late_s: float = 0.0) -> None:
        arrival_s = began_s + EXPOSURE_S + READOUT_S + late_s
        self.under_way = sorted([*self.under_way, (arrival_s, 7e3 + began_s, self.picture)])

    def next(self, until_s: float) -> FilledBuffer | None:
        arrival_s = self.under_way[0][0] if self.under_way else np.inf
        self.clock.wait_until_s(min(arrival_s, until_s))
        return self._taken() if arrival_s <= until_s else None

    def _taken(self) -> FilledBuffer:
        arrived_s, device_s, picture = self.under_way.pop(0)
        whole, self.without_leader = not self.without_leader, False
        if not whole:
            device_s, arrived_s = 0.0, -1e9
        return FilledBuffer(
            pointer=picture,
            is_complete=whole,
            has_leader=whole,
            number=picture,
            lost=0,
            device_s=device_s,
            arrived_s=arrived_s,
        )

    def drop_waiting(self) -> int:
        dropped = 0
        while self.under_way and self.under_way[0][0] <= self.clock.now_s():
            self._taken()
            dropped += 1
        return dropped

    @contextmanager
    def bytes_of(self, filled: FilledBuffer) -> Iterator[NDArray[np.uint8]]:
        yield np.full(4, filled.pointer, np.uint8)

    def give_back(self, filled: FilledBuffer) -> None:
        pass


@dataclass
class Commands:
    """What the trigger's command does; `sent_twice_late_s`: it was, and its second frame comes so much later."""

    sensor: Sensor
    sent_twice_late_s: float | None = None
    delay_s: float = 0.0
    """From the command to the exposure."""
    lateness_s: list[float] = field(default_factory=list)
    """Of the next frames, one by one."""

    def do(self, command: str) -> None:
        assert command == "TriggerSoftware"
        clock = self.sensor.clock
        self.sensor.expose(clock.now_s() + self.delay_s, self.lateness_s.pop(0) if self.lateness_s else 0.0)
        late_s, self.sent_twice_late_s = self.sent_twice_late_s, None
        if late_s is not None:
            self.sensor.expose(clock.now_s() + SENT_AGAIN_S, late_s)
            clock.wait_until_s(clock.now_s() + SENT_AGAIN_S + 0.02)

    def number(self, feature: str) -> float:
        return 2.0


@dataclass
class Bench:
    camera: GenicamCamera
    sensor: Sensor
    commands: Commands

    def shoot(self, picture: int) -> int:
        """Show a picture, and return that of the frame."""
        self.sensor.picture = picture
        frame = self.camera.capture(after_s=self.sensor.clock.now_s(), timeout_s=5.0)
        return int(frame.pixels[0, 0, 0])


@pytest.fixture
def bench() -> Bench:
    clock = VirtualClock(100.0)
    camera = GenicamCamera(
        "192.168.7.9",
        shape=(2, 2, 1),
        pixel_format="Mono8",
        bit_depth=8,
        frame_rate_hz=30.0,
        exposure_range_s=(1e-4, 1.0),
        options=GenicamOptions(),
        clock=clock,
    )
    sensor = Sensor(clock)
    commands = Commands(sensor)
    camera._opened = OpenGenicam(  # there is no library here
        device=0,
        camera=0,
        features=cast(Any, commands),
        stream=cast(Any, sensor),
        exposure="ExposureTime",
        exposure_s=EXPOSURE_S,
        held=[],
        packet_bytes=None,
        undo=ExitStack(),
    )
    return Bench(camera, sensor, commands)


def test_frames_follow_their_triggers_without_a_pause(bench: Bench) -> None:
    began_s = bench.sensor.clock.now_s()
    assert [bench.shoot(picture) for picture in range(50)] == list(range(50))
    each_s = (bench.sensor.clock.now_s() - began_s) / 50
    assert each_s == pytest.approx(EXPOSURE_S + READOUT_S)


@pytest.mark.parametrize("late_s", [0.0, 0.1, 0.3, 0.7, 1.5])
def test_the_second_frame_of_a_command_that_was_sent_twice_is_nobody_s(bench: Bench, late_s: float) -> None:
    assert [bench.shoot(picture) for picture in (1, 2)] == [1, 2]
    bench.commands.sent_twice_late_s = late_s
    assert [bench.shoot(picture) for picture in range(3, 9)] == list(range(3, 9))


@pytest.mark.parametrize("seed", range(40))
def test_no_frame_is_wrong_where_commands_are_sent_twice_and_frames_are_late(bench: Bench, seed: int) -> None:
    """A frame that is doubted, and after which none comes for a moment, is not known to have been the answer."""
    rng = np.random.default_rng(seed)
    assert [bench.shoot(picture) for picture in range(6)] == list(range(6))
    bench.commands.sent_twice_late_s = float(rng.uniform(0.0, 1.0))
    bench.commands.lateness_s = [0.0, *rng.uniform(0.0, 0.9, rng.integers(1, 6))]
    assert [bench.shoot(picture) for picture in range(6, 20)] == list(range(6, 20))


@pytest.mark.parametrize("before", [2, 20])
@pytest.mark.parametrize("early_s", [0.002, 0.01, 0.019])
def test_a_frame_that_nobody_asked_for_and_that_is_under_way_is_passed_over(
    bench: Bench, early_s: float, before: int
) -> None:
    assert [bench.shoot(2) for _ in range(before)] == [2] * before
    bench.sensor.expose(bench.sensor.clock.now_s() - early_s)
    assert [bench.shoot(picture) for picture in (3, 4)] == [3, 4]


def test_answers_that_become_quicker_cost_a_moment_only_while_their_scatter_is_unknown(bench: Bench) -> None:
    rng, clock, waits_s = np.random.default_rng(3), bench.sensor.clock, []
    for picture in range(200):
        began_s, bench.commands.delay_s = clock.now_s(), float(rng.uniform(0.0, 0.01))
        assert bench.shoot(picture) == picture
        waits_s.append(clock.now_s() - began_s)
    assert sum(wait_s > 0.1 for wait_s in waits_s[:4]) <= 3
    assert max(waits_s[4:]) < 0.05


def test_frames_that_keep_coming_without_a_trigger_are_no_answer(bench: Bench) -> None:
    assert bench.shoot(1) == 1
    for k in range(10):
        bench.sensor.expose(bench.sensor.clock.now_s() - 0.1 + k)
    with pytest.raises(CaptureTimeout, match="exposed too early"):
        bench.shoot(2)


@pytest.mark.parametrize("before", [0, 5])
def test_a_frame_whose_first_packet_is_lost_is_passed_over_and_named(bench: Bench, before: int) -> None:
    """Nothing tells of which trigger it is."""
    assert [bench.shoot(picture) for picture in range(before)] == list(range(before))
    clock, seen = bench.sensor.clock, GenicamSearch()
    bench.sensor.expose(clock.now_s())
    bench.sensor.without_leader = True
    assert answer(bench.camera._opened, clock, (clock.now_s(), clock.now_s() + 1.0), seen) == (None, None)
    assert str(seen) == "1 frames came, 1 with packets missing, 0 exposed too early"
