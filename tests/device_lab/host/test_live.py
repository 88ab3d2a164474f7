"""Live pictures in a window of a desktop, seen by photographs of the display server."""

import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.devices.clock import SystemClock
from tests.device_lab.host.displays import virtual_display
from tests.device_lab.live_show import live_show

LIMIT_S = 60.0


def wait_until(true: Callable[[], bool]) -> None:
    clock = SystemClock()
    until_s = clock.now_s() + LIMIT_S
    while not true():
        assert clock.now_s() < until_s, f"not true within {LIMIT_S:g} s"
        clock.wait_until_s(clock.now_s() + 0.05)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_window_shows_moving_pictures_and_is_black_after_a_signal(tmp_path: Path, number: int) -> None:
    with virtual_display(640, 480) as desktop:
        with live_show("window", "screen", tmp_path, desktop.environment) as show:
            wait_until(lambda: bool(desktop.photograph().any()))
            first = desktop.photograph()
            wait_until(lambda: bool((desktop.photograph() != first).any()))
            result = show.end(number)
        assert not desktop.photograph().any()
    assert result["frames"] > 1
    assert result["out_of_order"] == 0
    assert result["ended_by"] == "signal"
    assert any("as they are" in note for note in result["notes"])
