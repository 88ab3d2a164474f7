"""Choosing a monitor of a desktop, and what is said where there is none. Real windows: tests/device_lab/host."""

from pathlib import Path

import pytest

from rig.devices.clock import SystemClock
from rig.devices.window.find import FoundMonitor, find_monitors
from rig.devices.window.monitor import check_mode, choose_monitor
from rig.devices.window.projector import WindowProjector
from rig.errors import DeviceError, DeviceLost, SettingRefused

OPERATOR = FoundMonitor(name="eDP-1", index=0, x_px=0, y_px=0, width_px=1920, height_px=1080, refresh_rate_hz=60.0)
WALL = FoundMonitor(name="HDMI-1", index=1, x_px=1920, y_px=0, width_px=1280, height_px=800, refresh_rate_hz=60.0)
TWIN = FoundMonitor(name="HDMI-1", index=2, x_px=3200, y_px=0, width_px=1280, height_px=800, refresh_rate_hz=0.0)


def test_a_monitor_is_chosen_by_name_or_number() -> None:
    for output in ("HDMI-1", "monitor:1"):
        assert choose_monitor([OPERATOR, WALL], output) is WALL


def test_an_unknown_monitor_is_answered_with_the_known_ones() -> None:
    expected = r"no monitor 'DP-3'.*'eDP-1' \(monitor:0, 1920 x 1080 px at 0, 0\), 'HDMI-1' \(monitor:1, .* 1920, 0\)"
    with pytest.raises(DeviceLost, match=expected):
        choose_monitor([OPERATOR, WALL], "DP-3")
    with pytest.raises(DeviceLost, match="it has none"):
        choose_monitor([], "DP-3")


def test_two_monitors_of_one_name_are_not_guessed_between() -> None:
    with pytest.raises(SettingRefused, match=r"2 monitors are named 'HDMI-1'; choose one of .*monitor:1.*monitor:2"):
        choose_monitor([OPERATOR, WALL, TWIN], "HDMI-1")
    assert choose_monitor([OPERATOR, WALL, TWIN], "monitor:2") is TWIN


def test_only_the_profiles_mode_is_accepted() -> None:
    check_mode(WALL, (800, 1280), 60.0)
    check_mode(WALL, (800, 1280), 59.94)
    check_mode(TWIN, (800, 1280), 120.0)  # its desktop does not know its rate
    with pytest.raises(SettingRefused, match="1280 x 800 px, the profile says 1920 x 1080 px"):
        check_mode(WALL, (1080, 1920), 60.0)
    with pytest.raises(SettingRefused, match="60 Hz, the profile says 120 Hz"):
        check_mode(WALL, (800, 1280), 120.0)


def test_without_a_desktop_the_advice_is_to_use_the_other_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    projector = WindowProjector("monitor:0", shape=(480, 640), refresh_rate_hz=60, clock=SystemClock())
    for open_it in (find_monitors, projector.open):
        with pytest.raises(DeviceError, match=r'neither DISPLAY nor WAYLAND_DISPLAY .* driver = "kms"'):
            open_it()


def test_missing_packages_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "glfw.py").write_text("raise ImportError('No module named glfw')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("DISPLAY", ":987")
    with pytest.raises(DeviceError, match=r"pip install 'procam-rig\[window\]'.*No module named glfw"):
        find_monitors()


def test_a_process_that_crashes_is_told_with_its_last_words(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "glfw.py").write_text("import os, sys\nprint('driver bug 42', file=sys.stderr)\nos.abort()")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("DISPLAY", ":987")
    with pytest.raises(DeviceLost, match=r"process ended \(SIGABRT: driver bug 42\)"):
        find_monitors()
