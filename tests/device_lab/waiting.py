"""Waits that last as long as a busy machine needs, and no longer than a condition takes to hold."""

from collections.abc import Callable

from rig.devices.clock import SystemClock

GENEROUS_S = 200.0
"""For what takes seconds at most on an idle machine; less than a test's time limit, so that the wait says what for."""


def wait_until(true: Callable[[], object], what: str = "it", *, poll_s: float = 0.02) -> None:
    """Poll until a condition holds; fail when it does not within GENEROUS_S."""
    clock = SystemClock()
    until_s = clock.now_s() + GENEROUS_S
    while not true():
        assert clock.now_s() < until_s, f"{what} did not happen within {GENEROUS_S:g} s"
        clock.wait_until_s(clock.now_s() + poll_s)
