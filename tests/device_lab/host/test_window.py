"""A projector that is a window on a monitor of a desktop, seen by photographs of the display server."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rig.devices.clock import SystemClock
from rig.devices.protocols import Codes
from rig.devices.window import link
from rig.devices.window.find import find_monitors
from rig.devices.window.projector import WindowProjector
from rig.errors import DeviceError, DeviceLost, SettingRefused
from tests.device_lab.host.displays import (
    Area,
    WaylandDisplay,
    XDisplay,
    arrange,
    two_monitors,
    virtual_display,
    weston,
)
from tests.device_lab.waiting import GENEROUS_S, wait_until

CHOSEN, OTHER = "DUMMY1", "DUMMY0"


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """No limit of the product judges how fast this machine is; the test of a limit sets its own."""
    monkeypatch.setattr(link, "START_LIMIT_S", GENEROUS_S)
    monkeypatch.setattr(link, "SHOW_LIMIT_S", GENEROUS_S)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[XDisplay]:
    with two_monitors(tmp_path_factory.mktemp("xorg")) as display:
        yield display


@pytest.fixture
def desktop(server: XDisplay, monkeypatch: pytest.MonkeyPatch) -> XDisplay:
    point_to(server, monkeypatch)
    arrange(server)
    return server


@pytest.fixture
def projector(desktop: XDisplay) -> Iterator[WindowProjector]:
    yield from opened(CHOSEN, desktop.monitors[CHOSEN].shape)


def opened(output: str, shape: tuple[int, int]) -> Iterator[WindowProjector]:
    projector = make(output, shape)
    projector.open()
    yield projector
    projector.close()


def make(output: str, shape: tuple[int, int], refresh_rate_hz: float = 60.0) -> WindowProjector:
    return WindowProjector(output, shape=shape, refresh_rate_hz=refresh_rate_hz, clock=SystemClock())


def point_to(display: XDisplay | WaylandDisplay, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in display.environment.items():
        monkeypatch.setenv(name, value)


def show_until_it_notices(projector: WindowProjector) -> None:
    """Show pictures for a while; what was sent to the window arrives some time."""
    clock = SystemClock()
    until_s = clock.now_s() + GENEROUS_S
    while clock.now_s() < until_s:
        projector.show(np.zeros(projector.shape, np.uint8), name="black")


def noise(shape: tuple[int, ...]) -> Codes:
    return np.random.default_rng(7).integers(0, 256, shape, dtype=np.uint8)


def wait_until_shown(desktop: XDisplay | WaylandDisplay, monitor: str, codes: Codes) -> None:
    wait_until(lambda: np.array_equal(desktop.photograph_of(monitor), codes), f"the picture on {monitor}")


class TestMonitors:
    def test_each_is_found_with_its_place_and_mode(self, desktop: XDisplay) -> None:
        found = {m.name: Area(m.x_px, m.y_px, m.width_px, m.height_px) for m in find_monitors()}
        assert found == desktop.monitors
        assert {m.index: m.name for m in find_monitors()} == {0: OTHER, 1: CHOSEN}
        assert {round(m.refresh_rate_hz) for m in find_monitors()} == {60}

    def test_one_that_is_off_is_not_found(self, desktop: XDisplay) -> None:
        desktop.xrandr("--output", CHOSEN, "--off")
        assert [m.name for m in find_monitors()] == [OTHER]


class TestPictures:
    @pytest.mark.parametrize("channels", [(), (3,)], ids=["grey", "colour"])
    def test_each_pixel_is_exact_and_the_other_monitor_untouched(
        self, desktop: XDisplay, projector: WindowProjector, channels: tuple[int, ...]
    ) -> None:
        codes = noise((*projector.shape, *channels))
        projector.show(codes, name="noise")
        expected = codes if channels else np.repeat(codes[..., np.newaxis], 3, axis=2)
        assert np.array_equal(desktop.photograph_of(CHOSEN), expected)
        assert not desktop.photograph_of(OTHER).any()

    def test_a_monitor_is_chosen_by_its_number_too(self, desktop: XDisplay) -> None:
        for number, name in enumerate((OTHER, CHOSEN)):
            area = desktop.monitors[name]
            for projector in opened(f"monitor:{number}", area.shape):
                codes = noise((*area.shape, 3))
                projector.show(codes, name="noise")
                assert np.array_equal(desktop.photograph_of(name), codes)

    def test_a_hundred_pictures_are_each_the_one_that_was_asked_for(
        self, desktop: XDisplay, projector: WindowProjector
    ) -> None:
        for number in range(100):
            projector.show(np.full(projector.shape, number + 100, np.uint8), name=str(number))
            if number % 10 == 0:
                assert (desktop.photograph_of(CHOSEN) == number + 100).all()

    def test_it_is_black_before_the_first_picture_and_after_the_last(self, desktop: XDisplay) -> None:
        for projector in opened(CHOSEN, desktop.monitors[CHOSEN].shape):
            assert not desktop.photograph().any()
            projector.show(np.full(projector.shape, 255, np.uint8), name="white")
            assert desktop.photograph().any()
            projector.close()
            assert not desktop.photograph().any()

    def test_the_screen_saver_waits(self, desktop: XDisplay) -> None:
        before_s = desktop.saver_timeout_s()
        assert before_s > 0
        for _ in opened(CHOSEN, desktop.monitors[CHOSEN].shape):
            assert desktop.saver_timeout_s() == 0
        assert desktop.saver_timeout_s() == before_s


class TestRefusals:
    def test_another_size_is_refused(self, desktop: XDisplay) -> None:
        projector = make(CHOSEN, (600, 800))
        with pytest.raises(SettingRefused, match=r"'DUMMY1' is at 640 x 480 px, the profile says 800 x 600 px"):
            projector.open()
        assert not desktop.photograph().any()

    def test_another_refresh_rate_is_refused(self, desktop: XDisplay) -> None:
        with pytest.raises(SettingRefused, match="refreshed at 60 Hz, the profile says 120 Hz"):
            make(CHOSEN, desktop.monitors[CHOSEN].shape, 120.0).open()

    def test_an_unknown_monitor_is_answered_with_the_known_ones(self, desktop: XDisplay) -> None:
        with pytest.raises(DeviceLost, match=r"'HDMI-1' .* 'DUMMY0' \(monitor:0, .* 'DUMMY1' \(monitor:1,"):
            make("HDMI-1", (480, 640)).open()

    def test_a_closed_projector_shows_nothing(self, projector: WindowProjector) -> None:
        projector.close()
        with pytest.raises(DeviceLost, match="closed"):
            projector.show(noise(projector.shape), name="noise")


class TestLoss:
    def test_a_monitor_that_is_switched_off_is_lost_and_comes_back(
        self, desktop: XDisplay, projector: WindowProjector
    ) -> None:
        codes = noise((*projector.shape, 3))
        projector.show(codes, name="noise")
        desktop.xrandr("--output", CHOSEN, "--off")
        with pytest.raises(DeviceLost, match=r"'DUMMY1'.*unplugged or switched off"):
            projector.show(codes, name="noise")
        assert not desktop.photograph_of(OTHER).any()
        with pytest.raises(DeviceLost, match="no monitor 'DUMMY1'"):
            projector.open()
        arrange(desktop)
        projector.open()
        projector.show(codes, name="noise")
        assert np.array_equal(desktop.photograph_of(CHOSEN), codes)

    def test_a_monitor_that_is_set_to_another_mode_is_refused(
        self, desktop: XDisplay, projector: WindowProjector
    ) -> None:
        desktop.xrandr("--addmode", CHOSEN, "640x400")
        desktop.xrandr("--output", CHOSEN, "--mode", "640x400")
        with pytest.raises(SettingRefused, match="mode is now 640 x 400 px, it was 640 x 480 px"):
            projector.show(noise(projector.shape), name="noise")

    def test_a_monitor_that_is_moved_is_lost(self, desktop: XDisplay, projector: WindowProjector) -> None:
        desktop.xrandr("--output", CHOSEN, "--pos", "800x100")
        with pytest.raises(DeviceLost, match="moved"):
            projector.show(noise(projector.shape), name="noise")

    def test_a_window_that_somebody_closes_is_lost_and_comes_back(
        self, desktop: XDisplay, projector: WindowProjector
    ) -> None:
        desktop.ask_to_close("procam-rig projector")
        with pytest.raises(DeviceLost, match=r"'DUMMY1'.*closed by somebody"):
            show_until_it_notices(projector)
        assert not desktop.photograph().any()
        projector.open()
        projector.show(np.full(projector.shape, 255, np.uint8), name="white")
        assert desktop.photograph_of(CHOSEN).all()

    def test_a_display_server_that_hangs_is_waited_for_within_a_limit(self, monkeypatch: pytest.MonkeyPatch) -> None:
        with virtual_display(320, 240) as display:
            point_to(display, monkeypatch)
            for projector in opened("screen", (240, 320)):
                display.server.send_signal(signal.SIGSTOP)
                monkeypatch.setattr(link, "SHOW_LIMIT_S", 0.5)
                with pytest.raises(DeviceLost, match=r"did not present a picture within 0\.5 s"):
                    projector.show(noise(projector.shape), name="noise")
                display.server.send_signal(signal.SIGCONT)

    def test_a_display_server_that_dies_leaves_the_rig_alive(self, monkeypatch: pytest.MonkeyPatch) -> None:
        with virtual_display(320, 240) as display:
            point_to(display, monkeypatch)
            for projector in opened("screen", (240, 320)):
                display.server.kill()
                display.server.wait()
                with pytest.raises(DeviceLost, match="display server"):
                    projector.show(noise(projector.shape), name="noise")
                with pytest.raises(DeviceError, match=r'driver = "kms"'):
                    projector.open()

    def test_a_killed_program_leaves_a_black_screen(self, desktop: XDisplay) -> None:
        script = (
            "import signal, sys, numpy\n"
            "from rig.devices.clock import SystemClock\n"
            "from rig.devices.window.projector import WindowProjector\n"
            "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a shell's background jobs ignore it
            "projector = WindowProjector('DUMMY1', shape=(480, 640), refresh_rate_hz=60, clock=SystemClock())\n"
            "projector.open()\n"
            "projector.show(numpy.full((480, 640), 255, numpy.uint8), name='white')\n"
            "print('shown', flush=True)\n"
            "sys.stdin.read()\n"
        )
        for how in (signal.SIGKILL, signal.SIGTERM, signal.SIGINT):
            with subprocess.Popen(
                [sys.executable, "-c", script],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            ) as program:
                assert program.stdout is not None
                assert program.stdout.readline() == b"shown\n"
                assert desktop.photograph().any()
                program.send_signal(how)
                program.wait()
                wait_until_shown(desktop, CHOSEN, np.zeros((480, 640, 3), np.uint8))


def test_a_desktop_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":987")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(DeviceError, match=":987"):
        find_monitors()


class TestWayland:
    """The compositor's outputs are windows of an X server, which is photographed."""

    def test_each_pixel_is_exact_on_the_chosen_output_and_the_other_is_untouched(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with weston(tmp_path, [(800, 600), (640, 480)]) as desktop:
            point_to(desktop, monkeypatch)
            for projector in opened("monitor:1", (480, 640)):
                desktop.point_at("X2")  # the projector hides the pointer
                codes = noise((*projector.shape, 3))
                projector.show(codes, name="noise")
                wait_until_shown(desktop, "X2", codes)
                assert not desktop.photograph_of("X1").any()
                desktop.point_at("X1")
                projector.close()
                wait_until_shown(desktop, "X2", np.zeros_like(codes))

    def test_two_outputs_of_one_name_are_not_guessed_between(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with weston(tmp_path, [(800, 600), (640, 480)]) as desktop:
            point_to(desktop, monkeypatch)
            names = {monitor.name for monitor in find_monitors()}
            assert len(names) == 1, "this compositor tells connectors' names: choose by these"
            with pytest.raises(SettingRefused, match=r"2 monitors are named .*monitor:0.*monitor:1"):
                make(names.pop(), (480, 640)).open()

    def test_an_output_with_large_text_is_filled_pixel_by_pixel(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with weston(tmp_path, [(640, 480)], scale=2) as desktop:
            point_to(desktop, monkeypatch)
            for projector in opened("monitor:0", (480, 640)):
                codes = noise((*projector.shape, 3))
                projector.show(codes, name="noise")
                wait_until_shown(desktop, "X1", codes)
