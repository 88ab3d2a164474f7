"""Our V4L2 layer on the kernel's test camera vivid: every format, every fault that it can inject."""

import os
import threading
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from rig.devices.protocols import RawFrame
from rig.devices.v4l2.describe import describe
from rig.devices.v4l2.find import find_camera, find_cameras
from rig.devices.v4l2.formats import PIXEL_FORMATS
from rig.errors import CaptureTimeout, DeviceBusy, DeviceError, DeviceForbidden, DeviceLost, SettingRefused
from tests.device_lab.guest.rights import as_nobody
from tests.device_lab.guest.vivid_camera import (
    CLOCK,
    HDMI_HZ,
    ID,
    camera,
    control,
    hdmi_shows,
    is_streaming,
    load,
    open_and_close,
    opened,
    picture,
    program,
    replug,
)
from tests.device_lab.programs import output_of
from tests.device_lab.waiting import wait_until


@pytest.fixture(autouse=True, scope="module")
def vivid() -> Iterator[None]:
    load()
    yield
    output_of("modprobe", "-r", "vivid")


@pytest.fixture
def altered() -> Iterator[None]:
    """For tests that change more than our own camera does: a new vivid afterwards."""
    yield
    output_of("modprobe", "-r", "vivid")
    load()


class TestFinding:
    def test_the_capture_node_is_found_and_no_output(self) -> None:
        (found,) = find_cameras()
        assert (found.device_id, found.driver, found.node) == (ID, "vivid", Path("/dev/video0"))

    def test_another_id_is_lost_and_the_message_lists_what_is_there(self) -> None:
        with pytest.raises(DeviceLost, match=f"'usb-1-2'.*{ID}"):
            find_camera("usb-1-2")

    def test_it_tells_formats_rates_and_controls_as_another_program_does(self) -> None:
        abilities = describe(Path("/dev/video0"))
        listed = output_of("v4l2-ctl", "-d", "0", "--list-formats")
        assert len({one.pixel_format for one in abilities.formats}) == listed.count("]: '")
        assert (640, 360, 25.0) in {(f.width_px, f.height_px, r) for f in abilities.formats for r in f.frame_rates_hz}
        gain = next(one for one in abilities.controls if one.name == "gain_automatic")
        assert (gain.kind, gain.minimum, gain.maximum, gain.value) == ("boolean", 0, 1, 1)
        menu = next(one for one in abilities.controls if one.name == "menu")
        assert menu.menu == {1: "Menu Item 1", 3: "Menu Item 3", 4: "Menu Item 4"}


class TestFormats:
    def test_it_offers_most_formats_that_are_decoded(self) -> None:
        offered = {one.pixel_format for one in describe(Path("/dev/video0")).formats} & set(PIXEL_FORMATS)
        assert offered >= {"GREY", "Y10", "Y12", "Y16", "Y16-BE", "YUYV", "UYVY", "YVYU", "VYUY", "NV12"}
        assert offered >= {"RGB3", "BGR3", "RGGB", "GRBG", "GBRG", "BA81", "RG10", "RG12", "RG16"}

    def test_grey_of_every_depth_is_the_same_picture(self) -> None:
        grey = picture("GREY")
        assert np.ptp(grey) > 100
        for name, factor in {"Y10": 4, "Y12": 16, "Y16": 256, "Y16-BE": 256}.items():
            np.testing.assert_array_equal(picture(name), grey * factor, err_msg=name)

    def test_luma_of_every_yuv_format_is_the_same(self) -> None:
        luma = picture("YUYV")
        for name in ("UYVY", "YVYU", "VYUY", "NV12"):
            np.testing.assert_array_equal(picture(name), luma, err_msg=name)

    def test_colours_from_yuv_are_those_of_rgb_but_for_chroma_at_edges(self) -> None:
        rgb = picture("RGB3", 3)
        np.testing.assert_array_equal(picture("BGR3", 3), rgb)
        inside = np.all(rgb == np.roll(rgb, 4, axis=1), axis=2) & np.all(rgb == np.roll(rgb, -4, axis=1), axis=2)
        for name in ("YUYV", "UYVY", "YVYU", "VYUY", "NV12"):
            assert np.abs(picture(name, 3) - rgb)[inside].max() <= 3, name

    def test_bayer_is_kept_raw_in_every_order_and_depth(self) -> None:
        rgb = picture("RGB3", 3)
        for names, shift in ((("RGGB", "GRBG", "GBRG", "BA81"), 0), (("RG10", "BA10", "GB10", "BG10"), 2)):
            for name, order in zip(names, ("RGGB", "GRBG", "GBRG", "BGGR"), strict=True):
                raw = picture(name)[:, :, 0]
                for place, colour in enumerate(order):
                    rows, columns = slice(place // 2, None, 2), slice(place % 2, None, 2)
                    expected = rgb[rows, columns, "RGB".index(colour)]
                    np.testing.assert_array_equal(raw[rows, columns] >> shift, expected, err_msg=name)


@pytest.mark.usefixtures("altered")
@pytest.mark.parametrize(
    ("pixel_format", "channels", "bytes_per_pixel"), [("GREY", 1, 1), ("RGB3", 3, 3), ("YUYV", 1, 2)]
)
def test_what_an_output_shows_is_captured_byte_for_byte(
    pixel_format: str, channels: int, bytes_per_pixel: int, tmp_path: Path
) -> None:
    data = np.random.default_rng(5).integers(16, 235, (480, 640, bytes_per_pixel), np.uint8)
    with (
        hdmi_shows(pixel_format, data.tobytes(), tmp_path),
        opened(pixel_format, (480, 640, channels), frame_rate_hz=HDMI_HZ) as it,
    ):
        wait_until(lambda: np.array_equal(it.capture(after_s=0.0, timeout_s=5.0).pixels, data[:, :, :channels]))
        for _ in range(6):
            frame = it.capture(after_s=CLOCK.now_s(), timeout_s=5.0)
            np.testing.assert_array_equal(frame.pixels, data[:, :, :channels])


@pytest.mark.usefixtures("altered")
class TestControls:
    def test_automatics_are_off_and_the_profile_s_controls_hold(self) -> None:
        with opened(controls={"brightness": 90, "menu": 4, "boolean": 0, "bitmask": 0x80402010}) as it:
            it.capture(after_s=CLOCK.now_s(), timeout_s=5.0)
            got = output_of("v4l2-ctl", "-d", 0, "-C", "gain_automatic,brightness,menu,boolean,bitmask")
        assert {line.split(" (")[0] for line in got.splitlines()} == {
            "gain_automatic: 0", "brightness: 90", "menu: 4", "boolean: 0", f"bitmask: {0x80402010 - 2**32}",
        }  # fmt: skip

    @pytest.mark.parametrize(
        ("controls", "message"),
        [
            ({"brigthness": 3}, "no control 'brigthness'; did you mean brightness"),
            ({"contrast": 256}, "contrast: asked for 256, but its range is 0 … 255"),
            ({"menu": 2}, r"menu: asked for 2, but it is one of 1 \(Menu Item 1\), 3"),
            ({"read_only_integer_32_bits": 1}, "cannot be set: .*read-only"),
            ({"gain": 3, "gain_automatic": 1}, "gain is inactive"),
        ],
    )
    def test_a_control_that_cannot_be_set_is_named(self, controls: dict[str, int], message: str) -> None:
        with pytest.raises(SettingRefused, match=message):
            open_and_close(controls=controls)


class TestModes:
    def test_a_size_that_it_lacks_is_refused_with_those_it_has(self) -> None:
        with pytest.raises(SettingRefused, match=r"asked for GREY 642 x 361.*offers GREY in 320 x 180, 640 x 360"):
            open_and_close(shape=(361, 642, 1))

    def test_a_format_that_it_lacks_is_refused_with_those_it_has(self) -> None:
        with pytest.raises(SettingRefused, match=r"asked for MJPG.*offers YUYV, UYVY"):
            open_and_close("MJPG")

    def test_a_rate_that_it_lacks_is_refused_with_those_it_has(self) -> None:
        with pytest.raises(SettingRefused, match=r"asked for 17 Hz.*offers 1, 2, 4, 5, 10, 12.5, 15, 25, 30"):
            open_and_close(frame_rate_hz=17)

    def test_without_exposure_control_the_exposure_is_the_frame_period(self) -> None:
        with pytest.raises(SettingRefused, match=r"has to be \[0.04, 0.04\], not \[0.001, 0.04\]"):
            open_and_close(exposure_range_s=(0.001, 0.04))


def check_that_losses_are_told(frames: list[RawFrame]) -> None:
    """Most gaps in the driver's count are told in full; a frame that a busy host made late came, but is passed over."""
    gaps = [later.sequence - earlier.sequence - 1 for earlier, later in pairwise(frames)]
    told = [frame.lost for frame in frames[1:]]
    assert all(lost <= gap for lost, gap in zip(told, gaps, strict=True)), (told, gaps)
    assert sum(lost == gap for lost, gap in zip(told, gaps, strict=True)) > len(gaps) / 2, (told, gaps)


class TestStreaming:
    def test_frames_come_at_the_rate_that_was_set(self) -> None:
        with opened() as it:
            frames = [it.capture(after_s=0.0, timeout_s=5.0) for _ in range(20)]
        periods_s = [(b.started_s - a.started_s) / (b.sequence - a.sequence) for a, b in pairwise(frames)]
        assert np.median(periods_s) == pytest.approx(0.04, rel=0.05)
        check_that_losses_are_told(frames)

    def test_nothing_is_lost_while_nobody_asks(self) -> None:
        with opened() as it:
            it.capture(after_s=0.0, timeout_s=5.0)
            CLOCK.wait_until_s(CLOCK.now_s() + 0.6)
            frames = [it.capture(after_s=0.0, timeout_s=5.0) for _ in range(8)]
        skipped = max(later.sequence - earlier.sequence - 1 for earlier, later in pairwise(frames))
        assert skipped > 6
        assert max(frame.lost for frame in frames) < skipped

    @pytest.mark.usefixtures("altered")
    def test_dropped_frames_are_told(self) -> None:
        with opened() as it:
            control(percentage_of_dropped_buffers=60)
            fresh_s = CLOCK.now_s()
            frames = [it.capture(after_s=fresh_s, timeout_s=5.0) for _ in range(20)]
        check_that_losses_are_told(frames)
        assert sum(frame.lost for frame in frames) > 5

    @pytest.mark.usefixtures("altered")
    def test_a_frame_with_the_error_flag_is_passed_over_and_counted(self) -> None:
        with opened() as it:
            control(inject_v4l2_buf_flag_error=1)
            frames = [it.capture(after_s=0.0, timeout_s=5.0) for _ in range(8)]
        assert sum(frame.lost for frame in frames) >= 1

    @pytest.mark.usefixtures("altered")
    def test_counting_goes_on_when_the_driver_s_counter_overflows(self) -> None:
        control(wrap_sequence_number=1)
        with opened(shape=(180, 320, 1), frame_rate_hz=120) as it:
            frames = [it.capture(after_s=0.0, timeout_s=5.0) for _ in range(150)]
        assert all(later.sequence > earlier.sequence for earlier, later in pairwise(frames))
        assert frames[-1].sequence < 400

    @pytest.mark.usefixtures("altered")
    def test_time_stamps_of_another_clock_are_refused(self) -> None:
        control(wrap_timestamp=1)
        with pytest.raises(DeviceError, match="of another clock"):
            open_and_close()

    @pytest.mark.usefixtures("altered")
    def test_both_kinds_of_time_stamp_end_after_their_frame(self) -> None:
        for source in (0, 1):
            control(timestamp_source=source)
            with opened() as it:
                asked_s = CLOCK.now_s()
                frame = it.capture(after_s=asked_s, timeout_s=5.0)
                assert asked_s <= frame.started_s <= CLOCK.now_s() - frame.exposure_s

    def test_it_gives_up_in_time(self) -> None:
        with opened() as it, pytest.raises(CaptureTimeout, match=r"within 0\.3 s: \d+ frames came"):
            it.capture(after_s=CLOCK.now_s() + 10, timeout_s=0.3)


@pytest.mark.usefixtures("altered")
class TestFaults:
    @pytest.mark.parametrize("fault", ["reqbufs", "qbuf", "streamon"])
    def test_a_stream_that_does_not_start_is_an_error_and_the_next_opening_works(self, fault: str) -> None:
        it = camera()
        control(**{f"inject_vidioc_{fault}_error": 1})
        with pytest.raises(DeviceError, match=r"/dev/video0: .* failed"):
            it.open()
        with opened():
            pass

    def test_a_buffer_that_is_not_taken_back_costs_a_new_stream_but_no_error(self) -> None:
        with opened() as it:
            before = it.capture(after_s=0.0, timeout_s=5.0)
            control(inject_vidioc_qbuf_error=1)
            frames = [it.capture(after_s=0.0, timeout_s=5.0) for _ in range(8)]
        assert all(later.sequence > earlier.sequence for earlier, later in pairwise([before, *frames]))

    def test_a_fatal_streaming_error_costs_a_new_stream_but_no_error(self) -> None:
        with opened() as it:
            before = it.capture(after_s=0.0, timeout_s=5.0)
            control(inject_fatal_streaming_error=1)
            asked_s = CLOCK.now_s()
            after = it.capture(after_s=asked_s, timeout_s=5.0)
        assert after.sequence > before.sequence
        assert after.started_s >= asked_s

    def test_a_fatal_error_while_the_next_stream_fails_too_is_named_and_passes(self) -> None:
        with opened() as it:
            control(inject_fatal_streaming_error=1, inject_vidioc_streamon_error=1)
            with pytest.raises(DeviceError, match="starting to stream failed"):
                it.capture(after_s=0.0, timeout_s=5.0)
            assert it.capture(after_s=CLOCK.now_s(), timeout_s=5.0).pixels.std() > 0

    def test_unplugging_while_it_waits_is_noticed_at_once(self) -> None:
        unplugged_s = []

        def unplug() -> None:
            control(disconnect=1)
            unplugged_s.append(CLOCK.now_s())

        with opened() as it:
            timer = threading.Timer(0.3, unplug)
            timer.start()
            with pytest.raises(DeviceLost, match="ENODEV"):
                it.capture(after_s=CLOCK.now_s() + 60, timeout_s=60.0)
            lost_s = CLOCK.now_s()
            timer.join()
            assert lost_s - unplugged_s[0] < 20.0
            for _ in range(2):
                it.close()
            with pytest.raises(DeviceLost, match="closed"):
                it.capture(after_s=0.0, timeout_s=1.0)

    def test_it_comes_back_under_another_number_with_all_its_settings(self) -> None:
        with opened(controls={"brightness": 90}) as it:
            other_program = os.open("/dev/video0", os.O_RDWR)
            try:
                control(disconnect=1)
                with pytest.raises(DeviceLost):
                    it.capture(after_s=CLOCK.now_s(), timeout_s=5.0)
                with pytest.raises(DeviceLost, match="no camera at all"):
                    it.open()
                replug()
                it.open()
                assert find_camera(ID).node != Path("/dev/video0")
                assert it.capture(after_s=CLOCK.now_s(), timeout_s=5.0).pixels.std() > 0
                got = output_of("v4l2-ctl", "-d", find_camera(ID).node, "-C", "brightness,gain_automatic")
                assert got.split() == ["brightness:", "90", "gain_automatic:", "0"]
            finally:
                os.close(other_program)

    def test_another_size_after_replugging_is_refused(self) -> None:
        it = camera()
        it.open()
        it.close()
        replug()
        output_of("v4l2-ctl", "-d", 0, "-i", 1, "--set-dv-bt-timings", "index=0")
        control(enable_capture_scaler=0, enable_capture_cropping=0, enable_capture_composing=0)
        with pytest.raises(SettingRefused, match="asked for GREY 640 x 360, the camera set GREY 640 x 480"):
            it.open()

    def test_a_camera_that_another_program_streams_from_is_busy(self) -> None:
        with program("v4l2-ctl", "-d", 0, "--stream-mmap=3"):
            wait_until(lambda: is_streaming())
            asked_s = CLOCK.now_s()
            with pytest.raises(DeviceBusy, match="another program"):
                open_and_close()
            assert CLOCK.now_s() - asked_s < 5.0

    def test_a_camera_that_another_program_is_about_to_leave_is_waited_for(self) -> None:
        with program("v4l2-ctl", "-d", 0, "--stream-mmap=3") as process:
            wait_until(lambda: is_streaming())
            timer = threading.Timer(0.3, process.kill)
            timer.start()
            with opened() as it:
                assert it.capture(after_s=0.0, timeout_s=5.0).pixels.std() > 0
            timer.join()

    def test_a_camera_that_the_user_may_not_open_is_forbidden_with_advice(self) -> None:
        os.chmod("/dev/video0", 0o600)
        with as_nobody(), pytest.raises(DeviceForbidden, match="usermod -aG"):
            open_and_close()


def test_no_descriptor_stays_open_and_no_buffer_mapped() -> None:
    def held() -> tuple[int, int]:
        return len(os.listdir("/proc/self/fd")), Path("/proc/self/maps").read_text().count("/dev/video")

    assert cv2.__version__
    before = held()
    for _ in range(3):
        with opened() as it:
            it.capture(after_s=0.0, timeout_s=5.0)
            assert held() > before
    assert held() == before
