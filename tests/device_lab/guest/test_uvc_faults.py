"""Our V4L2 camera against everything that a USB camera can do wrong: it recovers, or names the error, in time."""

import itertools
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from rig.devices.protocols import RawFrame
from rig.devices.v4l2.camera import V4l2Camera
from rig.devices.v4l2.find import find_cameras
from rig.errors import CaptureTimeout, DeviceBusy, DeviceError, DeviceLost, SettingRefused
from tests.device_lab.guest.emulated_camera import CLOCK, HEIGHT, WIDTH, Plugged, load_drivers, plugging
from tests.device_lab.programs import output_of
from tests.device_lab.waiting import GENEROUS_S, wait_until
from tests.rig.emulated.numbered_pictures import MEDIUM_EXPOSURE_S, read_number

EXPOSURE_MODE, EXPOSURE, GAIN = (1, 2), (1, 4), (2, 4)
NODROP = Path("/sys/module/uvcvideo/parameters/nodrop")
STRIKE_LIMIT_S = 4.0
"""An unplugging is noticed within this; it takes milliseconds, and who does not notice waits for five seconds."""


@pytest.fixture(scope="module", autouse=True)
def drivers() -> None:
    load_drivers()


@pytest.fixture
def plug() -> Iterator[Callable[..., Plugged]]:
    with plugging() as plug:
        yield plug


@pytest.fixture
def nodrop() -> Iterator[Callable[[int], None]]:
    """Whether uvcvideo hands over frames that it knows to be bad."""
    before = NODROP.read_text()
    yield lambda value: NODROP.write_text(str(value)) and None
    NODROP.write_text(before)


def camera_of(plugged: Plugged, **other) -> V4l2Camera:
    settings = {
        "shape": (HEIGHT, WIDTH, 1),
        "pixel_format": "GREY",
        "bit_depth": 8,
        "frame_rate_hz": 30.0,
        "exposure_range_s": (0.001, 0.1),
        "controls": {},
        "clock": CLOCK,
    }
    return V4l2Camera(f"usb-1209:0001-{plugged.serial}", **(settings | other))


@contextmanager
def opened(plugged: Plugged, exposure_s: float | None = MEDIUM_EXPOSURE_S, **other) -> Iterator[V4l2Camera]:
    camera = camera_of(plugged, **other)
    try:
        camera.open()
        if exposure_s is not None:
            camera.set_exposure(exposure_s)
        yield camera
    finally:
        camera.close()


def capture(camera: V4l2Camera, timeout_s: float = 5.0) -> RawFrame:
    return camera.capture(after_s=CLOCK.now_s(), timeout_s=timeout_s)


def number_of(frame: RawFrame) -> int:
    return read_number(frame.pixels[..., 0])


def level_of(frame: RawFrame) -> int:
    return int(frame.pixels[-1, -1, 0])


@dataclass
class Later:
    """Something that happens while the test does something else; its time, and its errors, are kept."""

    action: Callable[[], object]
    delay_s: float
    done_s: float | None = None
    errors: list[DeviceError] = field(default_factory=list)

    def __enter__(self) -> "Later":
        self.thread = threading.Thread(target=self._run)
        self.thread.start()
        return self

    def _run(self) -> None:
        CLOCK.wait_until_s(CLOCK.now_s() + self.delay_s)
        self.done_s = CLOCK.now_s()
        try:
            self.action()
        except DeviceError as error:  # told by the test's own thread
            self.errors.append(error)

    def __exit__(self, *_: object) -> None:
        self.thread.join(GENEROUS_S)
        assert not self.errors


def frames_until_error(camera: V4l2Camera) -> DeviceError:
    while True:
        try:
            capture(camera)
        except DeviceError as error:
            return error


def test_frames_begin_after_the_time_that_was_asked_for_and_tell_it(plug: Callable[..., Plugged]) -> None:
    plugged = plug()
    with opened(plugged) as camera:
        for _ in range(5):
            asked_s = CLOCK.now_s()
            frame = camera.capture(after_s=asked_s, timeout_s=5.0)
            assert asked_s <= frame.started_s <= CLOCK.now_s()
            assert level_of(frame) == round(255 / 2)
            assert frame.exposure_s == pytest.approx(MEDIUM_EXPOSURE_S)


def test_everything_automatic_is_off_while_it_is_open(plug: Callable[..., Plugged]) -> None:
    plugged = plug(exposure_s=0.002)
    assert plugged.camera.controls.value("exposure_mode") == 8
    with opened(plugged, 0.004, controls={"gain": 200}):
        values = plugged.camera.controls.value
        assert values("exposure_mode") == 1
        assert values("white_balance_automatic") == values("focus_automatic") == 0
        assert (values("gain"), values("exposure")) == (200, 40)


@pytest.mark.parametrize("after_s", [0.3, 0.307, 0.314, 0.321, 0.328])
def test_a_camera_unplugged_while_it_streams_is_lost_at_once(plug: Callable[..., Plugged], after_s: float) -> None:
    """At any moment of a frame: its buffers may come back, unfilled and unstamped, before the node is gone."""
    plugged = plug()
    with opened(plugged) as camera, Later(plugged.attachment.unplug, after_s) as cut:
        error = frames_until_error(camera)
        assert CLOCK.now_s() - cut.done_s < STRIKE_LIMIT_S
    assert isinstance(error, DeviceLost)
    camera.close()
    with pytest.raises(DeviceLost, match="LAB1"):
        camera.open()


def test_a_camera_under_another_node_number_is_found_again_with_its_settings(plug: Callable[..., Plugged]) -> None:
    before = plug(exposure_s=0.004)
    with opened(before, 0.002, controls={"gain": 300}) as camera, before.node.open("rb"):
        assert level_of(capture(camera)) == round(255 / 2 * 0.2 * 3)
        before.unplug()
        assert isinstance(frames_until_error(camera), DeviceLost)
        after = plug(exposure_s=0.002)
        assert after.node != before.node
        assert after.camera.controls.value("gain") == 100
        camera.open()
        camera.set_exposure(0.004)
        assert after.camera.controls.value("gain") == 300
        assert level_of(capture(camera)) == round(255 / 2 * 0.4 * 3)


def test_two_cameras_are_told_apart_by_their_serial_numbers(plug: Callable[..., Plugged]) -> None:
    first, second = plug(serial="ONE"), plug(serial="TWO")
    nodes = {camera.device_id: camera.node for camera in find_cameras()}
    assert nodes["usb-1209:0001-ONE"] == first.node
    assert nodes["usb-1209:0001-TWO"] == second.node


def test_a_frozen_camera_is_a_time_out_that_names_it_and_goes_on_when_it_thaws(plug: Callable[..., Plugged]) -> None:
    plugged = plug()
    with opened(plugged) as camera:
        plugged.faults.frozen = True
        CLOCK.wait_until_s(CLOCK.now_s() + 0.2)
        began_s = CLOCK.now_s()
        with pytest.raises(CaptureTimeout, match="LAB1"):
            capture(camera, timeout_s=0.5)
        assert CLOCK.now_s() - began_s < 0.5 + STRIKE_LIMIT_S
        plugged.faults.frozen = False
        assert level_of(capture(camera)) == 128


def test_a_hung_camera_lives_again_after_a_reset(plug: Callable[..., Plugged]) -> None:
    plugged = plug()
    with opened(plugged) as camera:
        plugged.faults.frozen_until_reset = True
        CLOCK.wait_until_s(CLOCK.now_s() + 0.2)
        with pytest.raises(CaptureTimeout):
            capture(camera, timeout_s=0.3)
        camera.close()
        camera.reset()
        wait_until(lambda: f"usb-1209:0001-{plugged.serial}" in [found.device_id for found in find_cameras()])
        camera.open()
        camera.set_exposure(0.004)
        assert level_of(capture(camera)) == round(255 / 2 * 0.4)


@pytest.mark.parametrize("reason", [0, 1], ids=["no reason given", "not ready"])
def test_a_control_that_always_stalls_is_a_named_error(plug: Callable[..., Plugged], reason: int) -> None:
    plugged = plug()
    with opened(plugged) as camera:
        plugged.faults.stall_error = reason
        plugged.faults.stalled_controls.add(EXPOSURE)
        began_s = CLOCK.now_s()
        with pytest.raises(DeviceError, match="exposure"):
            camera.set_exposure(0.02)
        assert CLOCK.now_s() - began_s < 10


def test_a_control_that_stalls_for_a_moment_is_asked_again(plug: Callable[..., Plugged]) -> None:
    plugged = plug()
    with opened(plugged) as camera:
        plugged.faults.stalled_controls.add(EXPOSURE)
        with Later(plugged.faults.stalled_controls.clear, 0.3):
            assert camera.set_exposure(0.004) == pytest.approx(0.004)
        assert level_of(capture(camera)) == round(255 / 2 * 0.4)


def test_a_camera_that_answers_slowly_is_waited_for(plug: Callable[..., Plugged]) -> None:
    plugged = plug()
    with opened(plugged) as camera:
        plugged.faults.control_delay_s = 0.1
        assert camera.set_exposure(0.004) == pytest.approx(0.004)
        plugged.faults.control_delay_s = 0.0
        assert level_of(capture(camera)) == round(255 / 2 * 0.4)


@pytest.mark.parametrize("kept", [0, 1], ids=["driver drops them", "driver hands them over"])
@pytest.mark.parametrize("fault", ["error_frames", "short_frames"])
def test_bad_frames_are_never_accepted_and_their_loss_is_told(
    plug: Callable[..., Plugged], nodrop: Callable[[int], None], fault: str, kept: int
) -> None:
    nodrop(kept)
    plugged = plug()
    with opened(plugged) as camera:
        frames = [capture(camera)]

        def loss_is_told() -> bool:
            setattr(plugged.faults, fault, 3)
            frames.extend(camera.capture(after_s=0.0, timeout_s=5.0) for _ in range(12))
            return any(frame.lost for frame in frames)

        wait_until(loss_is_told, "a frame that tells the loss before it, and that a busy host did not make late,")
    assert getattr(plugged.faults, fault) == 0
    assert {level_of(frame) for frame in frames} == {128}
    numbers = [number_of(frame) for frame in frames]
    assert sum(after - before - 1 for before, after in itertools.pairwise(numbers)) >= 3


def test_frames_that_the_camera_itself_drops_only_take_time(plug: Callable[..., Plugged]) -> None:
    plugged = plug()
    with opened(plugged) as camera:
        before = number_of(capture(camera))
        plugged.faults.dropped_frames = 5
        after = number_of(capture(camera))
        while plugged.faults.dropped_frames:
            after = number_of(capture(camera))
        assert number_of(capture(camera)) > after >= before + 1


def test_a_copy_of_an_old_frame_says_that_it_is_one(plug: Callable[..., Plugged]) -> None:
    plugged = plug()
    with opened(plugged) as camera:
        capture(camera)
        plugged.faults.duplicate_frames = 3
        frames = [camera.capture(after_s=0.0, timeout_s=5.0) for _ in range(8)]
    numbers = [number_of(frame) for frame in frames]
    copies = [one == other for one, other in itertools.pairwise(numbers)]
    assert any(copies)
    assert [frame.repeats for frame in frames[1:]] == copies


def test_a_camera_that_comes_back_with_other_formats_is_refused_by_name(plug: Callable[..., Plugged]) -> None:
    before = plug()
    with opened(before) as camera:
        before.unplug()
        assert isinstance(frames_until_error(camera), DeviceLost)
        plug(fourccs=("YUYV",), sizes=((160, 120),))
        with pytest.raises(SettingRefused, match=r"GREY 320 x 240.*YUYV"):
            camera.open()


@pytest.mark.parametrize("delay_frames", range(5))
def test_the_first_frame_after_a_new_exposure_has_it(plug: Callable[..., Plugged], delay_frames: int) -> None:
    plugged = plug(control_delay_frames=delay_frames)
    with opened(plugged, exposure_s=None) as camera:
        for exposure_s in (0.002, 0.016, 0.004, 0.01):
            assert camera.set_exposure(exposure_s) == pytest.approx(exposure_s)
            frame = capture(camera)
            assert level_of(frame) == round(255 / 2 * exposure_s / MEDIUM_EXPOSURE_S)
            assert frame.exposure_s == pytest.approx(exposure_s)


def test_a_camera_that_another_program_uses_is_busy(plug: Callable[..., Plugged]) -> None:
    plugged = plug()
    command = ["v4l2-ctl", "-d", str(plugged.node), "--stream-mmap", "--stream-count=100000"]
    sent = plugged.camera.frames_sent
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as other:
        try:
            wait_until(lambda: plugged.camera.frames_sent > sent)
            began_s = CLOCK.now_s()
            with pytest.raises(DeviceBusy, match="another program"):
                camera_of(plugged).open()
            assert CLOCK.now_s() - began_s < 10
        finally:
            other.terminate()
    with opened(plugged) as camera:
        assert level_of(capture(camera)) == 128


def test_the_kernel_has_nothing_to_complain_about() -> None:
    log = output_of("dmesg")
    assert [line for line in log.splitlines() if "BUG" in line or "WARNING:" in line or "Oops" in line] == []
