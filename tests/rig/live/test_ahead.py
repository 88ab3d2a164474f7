"""A film's next picture is computed while the last one is on its way to the screen; who shows has the processors."""

import math
import os
import threading
from collections.abc import Iterator

import numpy as np
import pytest

from rig.devices.clock import SystemClock, VirtualClock
from rig.devices.protocols import Codes, Shown
from rig.devices.simulated.display import ClockedDisplay
from rig.errors import DeviceLost
from rig.live.show.controls import Controls
from rig.live.show.frame_mailbox import LiveFrame
from rig.live.show.loop import LiveLoop, LoopArguments
from rig.live.show.output import DirectOutput, Output, ThreadedOutput
from rig.live.show.priority import normal_priority, realtime_priority
from rig.live.sources.source import Pixels
from tests.rig.live.stand_ins import PERIOD_S, RATE_HZ, SHAPE, Doubler


class Film:
    """One picture a refresh, known ahead."""

    is_timed = True

    def __init__(self, clock: VirtualClock, count: int):
        self.clock, self.count, self.next, self.dropped = clock, count, 1, 0
        self.origin_s: float | None = None

    @property
    def ended(self) -> bool:
        return self.next > self.count

    def take(self, latch_s: float, target_s: float) -> LiveFrame | None:
        self.origin_s = target_s - PERIOD_S if self.origin_s is None else self.origin_s
        due = min(round((target_s - self.origin_s) / PERIOD_S), self.count)
        if due < self.next:
            self.clock.wait_until_s(latch_s)
            return None
        self.dropped += due - self.next
        self.next = due + 1
        picture = np.full((*SHAPE, 3), due % 100, np.uint8)
        return LiveFrame(due, picture, self.clock.now_s(), self.origin_s + due * PERIOD_S)

    def skip(self, target_s: float) -> None:
        raise AssertionError("nobody freezes here")


class SlowOutput:
    """In virtual time: takes a while to hand a picture over, beside whatever else is done."""

    is_concurrent = True

    def __init__(self, display: ClockedDisplay, clock: VirtualClock, copying_s: float):
        self.display, self.clock, self.copying_s = display, clock, copying_s
        self.on_screen_s = 0.0

    def start(self, codes: Pixels, *, check: bool) -> None:
        ready_s = self.clock.now_s() + self.copying_s
        self.on_screen_s = math.ceil(ready_s / PERIOD_S + 1e-9) * PERIOD_S

    def finish(self) -> Shown:
        self.clock.wait_until_s(self.on_screen_s)
        return Shown(self.on_screen_s, "live")


class SlowDisplay(ClockedDisplay):
    """The same, done by the caller."""

    copying_s = 0.0

    def show(self, codes: Codes, *, name: str) -> Shown:
        self._clock.wait_until_s(self._clock.now_s() + self.copying_s)
        return super().show(codes, name=name)


def film_shown(busy_s: float, copying_s: float, *, ahead: bool) -> tuple[LiveLoop, Film]:
    clock = VirtualClock()
    display = SlowDisplay(SHAPE, RATE_HZ, clock)
    display.copying_s = copying_s
    display.open()
    film = Film(clock, 240)
    output: Output = SlowOutput(display, clock, copying_s) if ahead else DirectOutput(display)
    arguments = LoopArguments(
        projector=display,
        queue=film,
        compensators={"exact": Doubler(clock, busy_s)},
        clock=clock,
        refresh_rate_hz=RATE_HZ,
        output=output,
    )
    loop = LiveLoop(arguments, Controls(strategy="exact"))
    while not loop.ended:
        loop.step()
    loop.complete()
    return loop, film


def test_computing_and_showing_together_may_take_longer_than_a_refresh() -> None:
    serial, film = film_shown(0.7 * PERIOD_S, 0.5 * PERIOD_S, ahead=False)
    assert film.dropped > 60
    overlapped, film = film_shown(0.7 * PERIOD_S, 0.5 * PERIOD_S, ahead=True)
    figures = overlapped.statistics.figures(film.dropped)
    assert figures.on_time_share > 0.98
    assert figures.out_of_order == 0
    assert overlapped.statistics.frames > serial.statistics.frames


def test_a_picture_is_begun_ahead_but_less_than_a_refresh_and_a_half() -> None:
    loop, _ = film_shown(0.3 * PERIOD_S, 0.1 * PERIOD_S, ahead=True)
    assert 1.2 < loop.statistics.figures().latency_frames_p99 <= 1.5


def test_a_picture_that_took_too_long_costs_itself_and_what_it_hid_but_nothing_after() -> None:
    clock = VirtualClock()
    display = ClockedDisplay(SHAPE, RATE_HZ, clock)
    display.open()
    film, doubler = Film(clock, 240), Doubler(clock, 0.5 * PERIOD_S)
    output = SlowOutput(display, clock, 0.1 * PERIOD_S)
    loop = LiveLoop(
        LoopArguments(
            projector=display,
            queue=film,
            compensators={"exact": doubler},
            clock=clock,
            refresh_rate_hz=RATE_HZ,
            output=output,
        ),
        Controls(strategy="exact"),
    )
    while not loop.ended:
        doubler.busy_s = (2.0 if loop.statistics.frames == 100 else 0.5) * PERIOD_S
        loop.step()
    loop.complete()
    assert 1 <= loop.statistics.late <= 3
    assert film.dropped <= 3


class Stubborn(ClockedDisplay):
    """A display whose `show` fails as a test wants it to."""

    error: BaseException | None = None

    def show(self, codes: Codes, *, name: str) -> Shown:
        if self.error is not None:
            raise self.error
        return super().show(codes, name=name)


@pytest.fixture
def display() -> Iterator[Stubborn]:
    made = Stubborn(SHAPE, 200.0, SystemClock())
    made.open()
    yield made
    made.close()


@pytest.mark.parametrize("make", [DirectOutput, ThreadedOutput])
@pytest.mark.parametrize("error", [DeviceLost("unplugged"), ValueError("a mistake of ours")])
def test_what_goes_wrong_in_the_projector_comes_out_of_finish(
    display: Stubborn, make: type[DirectOutput] | type[ThreadedOutput], error: Exception
) -> None:
    output = make(display)
    display.error = error
    output.start(np.zeros((*SHAPE, 3), np.uint8), check=False)
    with pytest.raises(type(error), match=str(error)):
        output.finish()
    display.error = None
    output.start(np.full((*SHAPE, 3), 7, np.uint8), check=True)
    assert output.finish().on_screen_s > 0
    assert (display.picture == 7).all()


@pytest.mark.parametrize("make", [DirectOutput, ThreadedOutput])
def test_a_check_tells_of_a_picture_that_has_gone(
    display: Stubborn, make: type[DirectOutput] | type[ThreadedOutput]
) -> None:
    output = make(display)
    display.is_plugged = False
    output.start(np.zeros((*SHAPE, 3), np.uint8), check=True)
    with pytest.raises(DeviceLost):
        output.finish()


def test_a_closed_output_has_shown_what_was_started(display: Stubborn) -> None:
    output = ThreadedOutput(display)
    output.start(np.full((*SHAPE, 3), 9, np.uint8), check=False)
    output.close()
    assert (display.picture == 9).all()


def test_a_show_comes_first_where_the_system_allows_it_and_goes_back_afterwards() -> None:
    policies: list[int] = []

    def reads() -> None:
        policies.append(os.sched_getscheduler(0))
        normal_priority()
        policies.append(os.sched_getscheduler(0))

    with realtime_priority() as is_realtime:
        during = os.sched_getscheduler(0)
        thread = threading.Thread(target=reads)
        thread.start()
        thread.join()
    assert during == (os.SCHED_RR if is_realtime else os.SCHED_OTHER)
    assert policies == [during, os.SCHED_OTHER]
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


def test_a_user_who_may_not_come_first_shows_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    with realtime_priority() as is_realtime:
        normal_priority()
    assert not is_realtime


def test_a_picture_is_told_with_the_settings_that_it_was_computed_with() -> None:
    clock = VirtualClock()
    display = ClockedDisplay(SHAPE, RATE_HZ, clock)
    display.open()
    told: list[tuple[bool, bool]] = []
    steps = iter(range(1000))
    loop = LiveLoop(
        LoopArguments(
            projector=display,
            queue=Film(clock, 60),
            compensators={"exact": Doubler(clock)},
            clock=clock,
            refresh_rate_hz=RATE_HZ,
            keys=lambda: "b" if next(steps) % 20 == 10 else "",
            on_shown=lambda frame: told.append((frame.controls.black, not frame.codes.any())),
            output=SlowOutput(display, clock, 0.1 * PERIOD_S),
        ),
        Controls(strategy="exact"),
    )
    while not loop.ended:
        loop.step()
    loop.complete()
    assert {black for black, _ in told} == {True, False}
    assert all(black == dark for black, dark in told)
