"""What every clock has to do."""

import pytest

from rig.devices.clock import SystemClock, VirtualClock
from rig.devices.protocols import Clock


@pytest.fixture(params=[SystemClock, VirtualClock])
def clock(request: pytest.FixtureRequest) -> Clock:
    clock: Clock = request.param()
    return clock


class TestClock:
    def test_it_has_the_whole_protocol(self, clock: Clock) -> None:
        assert isinstance(clock, Clock)

    def test_it_never_goes_back(self, clock: Clock) -> None:
        times_s = [clock.now_s() for _ in range(100)]
        assert times_s == sorted(times_s)

    def test_waiting_ends_at_or_after_the_time(self, clock: Clock) -> None:
        until_s = clock.now_s() + 0.002
        clock.wait_until_s(until_s)
        assert clock.now_s() >= until_s

    def test_a_time_that_has_passed_is_not_waited_for(self, clock: Clock) -> None:
        before_s = clock.now_s()
        clock.wait_until_s(before_s - 1e6)
        assert clock.now_s() >= before_s


def test_virtual_time_stands_still_until_somebody_waits() -> None:
    clock = VirtualClock(5.0)
    assert clock.now_s() == clock.now_s() == 5.0
    clock.wait_until_s(1e9)
    assert clock.now_s() == 1e9
