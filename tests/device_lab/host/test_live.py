"""Live pictures in a window of a desktop, seen by photographs of the display server."""

import signal
from pathlib import Path

import pytest

from tests.device_lab.host.displays import virtual_display
from tests.device_lab.live_show import live_show
from tests.device_lab.waiting import wait_until


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
