"""The emulated camera against a host made of a socket: no kernel needed."""

import errno
import socket
import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from rig.devices.clock import SystemClock, VirtualClock
from rig.emulated.faults import Faults
from rig.emulated.usbip.attach import serve
from rig.emulated.uvc.camera import FrameRequest, UvcCamera
from rig.emulated.uvc.descriptors import Transport, video_formats
from tests.rig.emulated.numbered_pictures import PatternSource, encode_picture, read_number
from tests.rig.emulated.usb_host import Host

GET, SET = 0xA1, 0x21
FRAME_PARITY, END_OF_FRAME, ERROR = 1, 2, 0x40


class Numbers:
    """Frames at once: all bytes are the frame's number."""

    def __init__(self) -> None:
        self.requests: list[FrameRequest] = []

    def expose(self, request: FrameRequest) -> bytes | None:
        self.requests.append(request)
        return None if request.number == 2 else bytes([request.number % 256]) * (request.width_px * request.height_px)


@dataclass
class Plugged:
    camera: UvcCamera
    source: Numbers
    host: Host
    faults: Faults

    def start(self, transfers: int = 5, *, automatic: bool = False) -> None:
        if not automatic:
            assert self.host.control((SET, 1, 0x0200, 1 << 8), b"\1").status == 0
        agreed = self.host.control((GET, 0x81, 0x0100, 1), 34).data
        assert self.host.control((SET, 1, 0x0200, 1), agreed).status == 0
        self.host.control((0x01, 11, 1, 1))
        for _ in range(transfers):
            self.host.submit_iso()

    def frame(self) -> tuple[bytes, int]:
        """(pixels, last header's flags) of the next frame; gives each transfer back to the camera."""
        pixels = b""
        while True:
            _, reply = self.host.reply()
            self.host.submit_iso()
            position = 0
            for packet in reply.packets:
                data = reply.data[position : position + packet.actual_length]
                position += packet.actual_length
                if data:
                    assert data[0] == 2
                    pixels += data[2:]
                    if data[1] & END_OF_FRAME:
                        return pixels, data[1]


@pytest.fixture
def plugged(cable: tuple[socket.socket, Host]) -> Iterator[Plugged]:
    source, faults = Numbers(), Faults()
    formats = video_formats(("GREY",), ((64, 48), (320, 240)), (200,))
    camera = UvcCamera(source=source, formats=formats, faults=faults, control_delay_frames=2)
    with serve(camera, cable[0]):
        yield Plugged(camera, source, cable[1], faults)


def test_frames_arrive_whole_in_order_and_with_alternating_parity(plugged: Plugged) -> None:
    plugged.start()
    frames = [plugged.frame() for _ in range(4)]
    assert [(len(pixels), set(pixels)) for pixels, _ in frames] == [(64 * 48, {n}) for n in (0, 1, 3, 4)]
    parities = [flags & FRAME_PARITY for _, flags in frames]
    assert parities in ([0, 1, 0, 1], [1, 0, 1, 0])


def test_a_frame_larger_than_a_transfer_is_continued_in_the_next(plugged: Plugged) -> None:
    wish = struct.pack("<HBBI26x", 1, 1, 2, 50_000)
    plugged.host.control((SET, 1, 0x0100, 1), wish)
    plugged.host.control((SET, 1, 0x0200, 1), plugged.host.control((GET, 0x81, 0x0100, 1), 34).data)
    plugged.host.control((0x01, 11, 1, 1))
    for _ in range(5):
        plugged.host.submit_iso(7)
    pixels, total = b"", 0
    while total < 320 * 240:
        _, reply = plugged.host.reply()
        position = 0
        for packet in reply.packets:
            pixels += reply.data[position + 2 : position + packet.actual_length]
            position += packet.actual_length
        total = len(pixels)
        plugged.host.submit_iso(7)
    assert pixels == bytes(320 * 240)


def test_faults_are_those_that_were_ordered_and_only_as_many(plugged: Plugged) -> None:
    plugged.faults.error_frames = 1
    plugged.start()
    assert plugged.frame()[1] & ERROR
    plugged.faults.short_frames = 1
    lengths = [len(plugged.frame()[0]) for _ in range(12)]
    assert lengths.count(64 * 48 // 2) == 1
    numbers = [plugged.frame()[0][0]]
    plugged.faults.duplicate_frames = 1
    numbers += [plugged.frame()[0][0] for _ in range(12)]
    plugged.faults.dropped_frames = 3
    numbers += [plugged.frame()[0][0] for _ in range(20)]
    steps = np.diff(np.array(numbers, np.uint8))
    assert np.count_nonzero(steps == 0) == 1
    assert np.count_nonzero(steps >= 4) == 1


def test_a_frozen_camera_sends_nothing_until_it_thaws(plugged: Plugged) -> None:
    plugged.faults.frozen = True
    plugged.start(transfers=1)
    plugged.host.link.settimeout(0.3)
    with pytest.raises(TimeoutError):
        plugged.host.reply()
    plugged.host.link.settimeout(20)
    plugged.faults.frozen = False
    assert plugged.host.reply()[1].data


def test_a_reset_thaws_a_hung_camera_and_forgets_its_settings(plugged: Plugged) -> None:
    plugged.faults.frozen_until_reset = True
    plugged.host.control((SET, 1, 0x0400, 2 << 8), struct.pack("<H", 300))
    assert plugged.camera.controls.value("gain") == 300
    plugged.host.control((0x00, 9, 1, 0))
    assert plugged.camera.controls.value("gain") == 100
    plugged.start()
    assert plugged.frame()[0]


def test_a_stalled_control_refuses_with_the_reason_that_was_ordered(plugged: Plugged) -> None:
    plugged.faults.stalled_controls.add((2, 4))
    plugged.faults.stall_error = 1
    assert plugged.host.control((SET, 1, 0x0400, 2 << 8), struct.pack("<H", 300)).status == -errno.EPIPE
    assert plugged.host.control((GET, 0x81, 0x0200, 0), 1).data == b"\1"
    plugged.faults.stalled_controls.clear()
    assert plugged.host.control((SET, 1, 0x0400, 2 << 8), struct.pack("<H", 300)).status == 0


def test_gain_and_exposure_take_effect_after_the_stated_number_of_frames(plugged: Plugged) -> None:
    plugged.start()
    plugged.frame()
    plugged.camera.controls.put("gain", 400)
    before = len(plugged.source.requests)
    while plugged.source.requests[-1].gain == 1:
        plugged.frame()
    first = next(request.number for request in plugged.source.requests if request.gain == 4)
    assert before + 1 <= first <= before + 3


def test_automatic_exposure_brightens_a_dark_picture(plugged: Plugged) -> None:
    plugged.start(automatic=True)
    first = plugged.frame()
    while len(plugged.source.requests) < 12:
        plugged.frame()
    assert set(first[0]) == {0}
    assert plugged.source.requests[-1].exposure_s > plugged.source.requests[0].exposure_s


@pytest.mark.parametrize("selector", [0x0300, 0x0900])
def test_requests_for_what_the_stream_does_not_have_stall(plugged: Plugged, selector: int) -> None:
    assert plugged.host.control((GET, 0x81, selector, 1), 8).status == -errno.EPIPE


def test_a_bulk_camera_ends_each_frame_with_a_transfer_that_is_not_full(cable: tuple[socket.socket, Host]) -> None:
    formats = video_formats(("GREY",), ((64, 48),), (200,))
    host, source, faults = cable[1], Numbers(), Faults(short_frames=1)
    camera = UvcCamera(source=source, formats=formats, faults=faults, transport=Transport.BULK)
    with serve(camera, cable[0]):
        host.control((SET, 1, 0x0200, 1), host.control((GET, 0x81, 0x0100, 1), 34).data)
        for _ in range(9):
            host.command(1, 1, 769)
        lengths = [len(host.reply()[1].data) for _ in range(7)]
    assert lengths == [769, 769, 0, 769, 769, 769, 767]


def test_a_frame_that_is_ready_too_late_is_lost(cable: tuple[socket.socket, Host]) -> None:
    class EvenNumbersLate(Numbers):
        def expose(self, request: FrameRequest) -> bytes | None:
            late_s = 0.3 if request.number % 2 == 0 else 0.0
            SystemClock().wait_until_s(request.started_s + request.exposure_s + late_s)
            return super().expose(request)

    source, faults = EvenNumbersLate(), Faults()
    formats = video_formats(("GREY",), ((64, 48),), (200,))
    camera = UvcCamera(source=source, formats=formats, faults=faults, longest_delay_s=0.15)
    with serve(camera, cable[0]):
        plugged = Plugged(camera, source, cable[1], faults)
        plugged.start()
        assert [plugged.frame()[0][0] for _ in range(3)] == [1, 3, 5]


def test_frames_for_which_the_host_has_no_room_are_lost_and_not_kept(plugged: Plugged) -> None:
    plugged.start(transfers=0)
    SystemClock().wait_until_s(SystemClock().now_s() + 0.5)
    for _ in range(5):
        plugged.host.submit_iso()
    first = plugged.frame()[0][0]
    assert first > 3
    plugged.frame()
    assert plugged.frame()[0][0] > first


def test_a_camera_can_be_plugged_in_again() -> None:
    camera = UvcCamera(source=Numbers())
    for _ in range(2):
        ours, theirs = socket.socketpair()
        with theirs, serve(camera, ours):
            assert Host(theirs).control((0x80, 6, 0x0303, 0), 255).data[2:].decode("utf-16-le") == "EMULATED1"


@pytest.mark.parametrize("fourcc", ["GREY", "YUYV", "MJPG", "RGGB", "Y10 ", "Y12 ", "Y16 "])
def test_a_test_picture_tells_its_number_and_its_exposure(fourcc: str) -> None:
    clock = VirtualClock()
    source = PatternSource(clock)
    request = FrameRequest(
        fourcc=fourcc, width_px=320, height_px=240, started_s=5.0, exposure_s=0.004, gain=2.0, number=40_503
    )
    picture = source.picture(request)
    assert read_number(picture) == 40_503
    assert (
        picture[200, 100]
        == source.level(request)
        == round(0.4 * {"Y10 ": 1023, "Y12 ": 4095, "Y16 ": 65535}.get(fourcc, 255))
    )
    frame = source.expose(request)
    assert clock.now_s() == 5.004
    assert frame == encode_picture(picture, fourcc)
    assert np.any(
        source.picture(
            FrameRequest(
                fourcc=fourcc, width_px=320, height_px=240, started_s=5.0, exposure_s=0.004, gain=2.0, number=40_504
            )
        )[40]
        != picture[40]
    )


def test_an_overexposed_picture_is_clipped_and_a_uniform_one_has_no_number() -> None:
    assert (
        PatternSource.level(
            FrameRequest(fourcc="GREY", width_px=320, height_px=240, started_s=0.0, exposure_s=0.5, gain=1.0, number=0)
        )
        == 255
    )
    with pytest.raises(ValueError, match="too close"):
        read_number(np.full((240, 320), 7, np.uint8))
