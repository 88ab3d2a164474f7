"""Streaming and frames, on a driver that does what a script says; its buffers are real mapped memory."""

import errno
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from rig.devices.clock import VirtualClock
from rig.devices.v4l2 import abi
from rig.devices.v4l2.formats import PIXEL_FORMATS, Layout
from rig.devices.v4l2.frames import Fingerprint, Frames, FrameSearch
from rig.devices.v4l2.node import Node, device_error
from rig.devices.v4l2.stream import BUFFERS, Stream, StreamBroken
from rig.errors import DeviceBusy, DeviceError, DeviceForbidden, DeviceLost, SettingRefused

WIDTH, HEIGHT, PERIOD_S, EXPOSURE_S = 8, 4, 0.04, 0.01
BYTES = WIDTH * HEIGHT
START_OF_EXPOSURE = abi.TIMESTAMP_MONOTONIC | abi.TIMESTAMP_START_OF_EXPOSURE


@dataclass(kw_only=True)
class Step:
    """What the driver does next: a frame, or an errno."""

    sequence: int = 0
    stamp_s: float = 0.0
    flags: int = START_OF_EXPOSURE
    used: int = BYTES
    level: int = 1
    error: int = 0


@dataclass(kw_only=True)
class ScriptNode(Node):
    """A node whose driver follows a script; time passes while there is nothing to do."""

    path: Path
    _clock: VirtualClock
    steps: list[Step] = field(default_factory=list)
    queued: list[int] = field(default_factory=list)
    failures: dict[int, list[int]] = field(default_factory=dict)
    streaming: bool = False

    def __post_init__(self) -> None:
        self.path.write_bytes(bytes(BUFFERS * 4096))
        Node.__init__(self, self.path, self._clock)

    def ioctl(self, request, argument):
        if self.failures.get(request):
            raise OSError(self.failures[request].pop(0), "refused")
        {
            abi.REQBUFS: lambda given: None,
            abi.QUERYBUF: self._place,
            abi.QBUF: lambda given: self.queued.append(given.index),
            abi.DQBUF: self._fill,
            abi.STREAMON: lambda given: self._stream(True),
            abi.STREAMOFF: lambda given: self._stream(False),
        }[request](argument)
        return argument

    def _place(self, buffer) -> None:
        buffer.length, buffer.m.offset = BYTES, buffer.index * 4096

    def _stream(self, on: bool) -> None:
        self.streaming, self.queued = on, self.queued if on else []

    def _fill(self, buffer) -> None:
        if not self.steps:
            self._clock.wait_until_s(self._clock.now_s() + 0.01)
            raise OSError(errno.EAGAIN, "nothing yet")
        step = self.steps.pop(0)
        if step.error:
            raise OSError(step.error, "refused")
        self._clock.wait_until_s(step.stamp_s + 0.001)
        buffer.index = self.queued.pop(0)
        with self.path.open("r+b") as file:
            file.seek(buffer.index * 4096)
            file.write(bytes([step.level]) * BYTES)
        buffer.sequence, buffer.bytesused, buffer.flags = step.sequence, step.used, step.flags
        buffer.timestamp.seconds = int(step.stamp_s)
        buffer.timestamp.microseconds = round(step.stamp_s % 1 * 1e6)


@pytest.fixture
def node(tmp_path: Path) -> Iterator[ScriptNode]:
    with ScriptNode(path=tmp_path / "video0", _clock=VirtualClock(100.0)) as node:
        yield node


@pytest.fixture
def stream(node: ScriptNode) -> Iterator[Stream]:
    stream = Stream(node, node._clock)
    stream.start()
    yield stream
    stream.stop()


def frames_of(stream: Stream, node: ScriptNode, *, name: str = "GREY", exposes_always: bool = False) -> Frames:
    layout = Layout(width_px=WIDTH, height_px=HEIGHT, bytes_per_line=WIDTH)
    return Frames(
        stream, PIXEL_FORMATS[name], layout, 1, period_s=PERIOD_S, exposes_always=exposes_always, clock=node._clock
    )


def next_frame(frames: Frames, *, after_s: float = 0.0, until_s: float = 200.0, seen: FrameSearch | None = None):
    return frames.next(after_s, until_s, EXPOSURE_S, seen or FrameSearch())


def regular(*sequences: int) -> list[Step]:
    return [Step(sequence=sequence, stamp_s=100 + sequence * PERIOD_S, level=sequence) for sequence in sequences]


class TestErrors:
    @pytest.mark.parametrize(
        ("number", "kind", "message"),
        [
            (errno.ENODEV, DeviceLost, "ENODEV"),
            (errno.ENOENT, DeviceLost, "rig devices"),
            (errno.EBUSY, DeviceBusy, "another program uses the camera"),
            (errno.EACCES, DeviceForbidden, "usermod -aG"),
            (errno.EPERM, DeviceForbidden, "usermod -aG"),
            (errno.EINVAL, SettingRefused, "cannot do this"),
            (errno.ENOSPC, DeviceError, "no room for this stream"),
            (errno.EIO, DeviceError, "plug it in again"),
            (errno.EPIPE, DeviceError, "plug it in again"),
        ],
    )
    def test_each_errno_says_what_to_do(self, number: int, kind: type[DeviceError], message: str) -> None:
        error = device_error(OSError(number, ""), "setting it", Path("/dev/video0"))
        assert type(error) is kind
        assert str(error).startswith("/dev/video0: setting it failed: ")
        assert message in str(error)

    def test_a_node_that_is_not_there_is_lost(self, tmp_path: Path) -> None:
        with pytest.raises(DeviceLost):
            Node(tmp_path / "video9", VirtualClock())

    def test_a_closed_node_says_so_and_closes_again(self, node: ScriptNode) -> None:
        for _ in range(3):
            node.close()
        with pytest.raises(DeviceLost, match="closed"):
            _ = node.fd


class TestStream:
    def test_all_buffers_are_with_the_driver_while_it_streams(self, node: ScriptNode, stream: Stream) -> None:
        assert (node.streaming, node.queued) == (True, [0, 1, 2, 3])
        node.steps = regular(0)
        filled = stream.next(200.0)
        assert filled is not None
        assert node.queued == [1, 2, 3]
        stream.give_back(filled.index)
        assert node.queued == [1, 2, 3, 0]

    def test_waiting_has_a_limit(self, node: ScriptNode, stream: Stream) -> None:
        assert stream.next(100.5) is None
        assert node._clock.now_s() == pytest.approx(100.5, abs=0.02)

    def test_a_wait_without_end_is_no_error(self, node: ScriptNode, stream: Stream) -> None:
        node.steps = regular(0)
        assert stream.next(float("inf")) is not None

    @pytest.mark.parametrize(("number", "kind"), [(errno.ENODEV, DeviceLost), (errno.EIO, StreamBroken)])
    def test_a_stream_that_ends_says_whether_the_camera_is_still_there(
        self, node: ScriptNode, stream: Stream, number: int, kind: type[DeviceError]
    ) -> None:
        node.steps = [Step(error=number)]
        with pytest.raises(kind):
            stream.next(200.0)

    @pytest.mark.parametrize("request_number", [abi.REQBUFS, abi.QUERYBUF, abi.QBUF, abi.STREAMON])
    def test_a_start_that_fails_can_be_stopped_and_tried_again(self, node: ScriptNode, request_number: int) -> None:
        stream = Stream(node, node._clock)
        node.failures = {request_number: [errno.EIO]}
        with pytest.raises(DeviceError):
            stream.start()
        for _ in range(2):
            stream.stop()
        stream.start()
        assert node.streaming
        stream.stop()

    def test_buffers_that_another_program_has_for_a_moment_are_waited_for(self, node: ScriptNode) -> None:
        stream = Stream(node, node._clock)
        node.failures = {abi.REQBUFS: [errno.EBUSY] * 3}
        stream.start()
        stream.stop()
        node.failures = {abi.REQBUFS: [errno.EBUSY] * 1000}
        with pytest.raises(DeviceBusy):
            stream.start()

    def test_stopping_forgives_a_camera_that_is_gone_and_nothing_else(self, node: ScriptNode) -> None:
        stream = Stream(node, node._clock)
        stream.start()
        node.failures = {abi.STREAMOFF: [errno.ENODEV]}
        stream.stop()
        stream.start()
        node.failures = {abi.STREAMOFF: [errno.EIO]}
        with pytest.raises(DeviceError, match="stopping the stream failed"):
            stream.stop()


class TestFingerprint:
    @pytest.mark.parametrize("size", [1, 8, 1003])
    def test_one_changed_byte_is_another_buffer(self, size: int) -> None:
        fingerprint = Fingerprint()
        data = np.random.default_rng(3).integers(0, 256, size, np.uint8)
        for place in {0, size // 2, size - 1}:
            changed = data.copy()
            changed[place] ^= 1
            assert fingerprint.of(changed) != fingerprint.of(data) == fingerprint.of(data.copy())

    def test_moved_bytes_and_another_size_are_another_buffer(self) -> None:
        fingerprint = Fingerprint()
        stripes = np.repeat(np.array([0, 255] * 8, np.uint8), 8)
        prints = {fingerprint.of(np.roll(stripes, shift)) for shift in range(16)}
        assert len(prints) == 16
        assert fingerprint.of(stripes[:-8]) not in prints


class TestFrames:
    def test_each_frame_has_its_own_pixels_number_and_time(self, node: ScriptNode, stream: Stream) -> None:
        frames = frames_of(stream, node)
        node.steps = regular(0, 1, 2)
        got = [next_frame(frames) for _ in range(3)]
        assert [int(frame.pixels[0, 0, 0]) for frame in got] == [0, 1, 2]
        assert all(np.ptp(frame.pixels) == 0 and frame.pixels.shape == (HEIGHT, WIDTH, 1) for frame in got)
        assert [frame.sequence for frame in got] == [1, 2, 3]
        assert [frame.started_s for frame in got] == pytest.approx([100 + n * PERIOD_S - EXPOSURE_S for n in range(3)])
        assert {(frame.exposure_s, frame.lost, frame.repeats) for frame in got} == {(EXPOSURE_S, 0, False)}

    @pytest.mark.parametrize(
        ("flags", "name", "earlier_s"),
        [
            (START_OF_EXPOSURE, "GREY", EXPOSURE_S),
            (abi.TIMESTAMP_MONOTONIC, "GREY", EXPOSURE_S + PERIOD_S),
            (START_OF_EXPOSURE, "MJPG", EXPOSURE_S + PERIOD_S),
            (abi.TIMESTAMP_MONOTONIC, "MJPG", EXPOSURE_S + 2 * PERIOD_S),
        ],
    )
    def test_a_frame_never_claims_to_have_begun_later_than_it_may_have(
        self, node: ScriptNode, stream: Stream, flags: int, name: str, earlier_s: float
    ) -> None:
        seen = FrameSearch()
        node.steps = [Step(sequence=0, stamp_s=100.5, flags=flags)]
        assert next_frame(frames_of(stream, node, name=name), after_s=101.0, until_s=100.6, seen=seen) is None
        assert seen.early_s == pytest.approx(101.0 - (100.5 - earlier_s))

    def test_stale_frames_are_passed_over_and_their_buffers_given_back(self, node: ScriptNode, stream: Stream) -> None:
        node.steps = regular(*range(7))
        frame = next_frame(frames_of(stream, node), after_s=100.2)
        assert frame.started_s == pytest.approx(100 + 6 * PERIOD_S - EXPOSURE_S)
        assert len(node.queued) == BUFFERS

    @pytest.mark.parametrize(
        ("bad", "told"),
        [
            ({"flags": START_OF_EXPOSURE | abi.BUFFER_ERROR}, "1 with the error flag, 0 too short"),
            ({"used": BYTES - 1}, "0 with the error flag, 1 too short"),
        ],
    )
    def test_bad_frames_are_passed_over_told_and_counted_as_lost(
        self, node: ScriptNode, stream: Stream, bad: dict[str, int], told: str
    ) -> None:
        seen = FrameSearch()
        node.steps = [*regular(0), Step(sequence=1, stamp_s=100.04, **bad), *regular(2, 3)]
        frames = frames_of(stream, node)
        assert [next_frame(frames, seen=seen).lost for _ in range(3)] == [0, 1, 0]
        assert told in str(seen)

    def test_a_gap_is_loss_when_a_buffer_was_waiting(self, node: ScriptNode, stream: Stream) -> None:
        frames = frames_of(stream, node)
        node.steps = regular(0, 1, 5, 6)
        assert [next_frame(frames).lost for _ in range(4)] == [0, 0, 3, 0]

    def test_a_gap_while_all_buffers_were_full_is_no_loss_and_its_next_frame_is_not_trusted(
        self, node: ScriptNode, stream: Stream
    ) -> None:
        frames = frames_of(stream, node)
        node.steps = regular(0, 1, 2, 3)
        node._clock.wait_until_s(110.0)
        got = [next_frame(frames) for _ in range(4)]
        node.steps = [Step(sequence=251, stamp_s=110.04), Step(sequence=252, stamp_s=110.08)]
        got.append(next_frame(frames))
        assert [frame.lost for frame in got] == [0] * 5
        assert got[-1].sequence - got[-2].sequence == 249

    def test_a_counter_that_overflows_or_begins_anew_counts_on(self, node: ScriptNode, stream: Stream) -> None:
        frames = frames_of(stream, node)
        node.steps = [
            Step(sequence=n & 0xFFFFFFFF, stamp_s=100 + k * PERIOD_S) for k, n in enumerate((-2, -1, 0, 1, 3))
        ]
        assert [next_frame(frames).sequence for _ in range(5)] == [1, 2, 3, 4, 6]
        stream.stop()
        stream.start()
        node.steps = regular(10, 11, 12)
        assert [next_frame(frames).sequence for _ in range(2)] == [8, 9], "the first after a pause is not trusted"

    def test_a_frame_whose_stamp_came_late_is_not_trusted_and_the_next_one_is(
        self, node: ScriptNode, stream: Stream
    ) -> None:
        seen = FrameSearch()
        frames = frames_of(stream, node)
        node.steps = [*regular(0, 1, 2), Step(sequence=3, stamp_s=100 + 3.6 * PERIOD_S), *regular(4, 5)]
        got = [next_frame(frames, seen=seen) for _ in range(5)]
        assert [frame.sequence for frame in got] == [1, 2, 3, 5, 6]
        assert seen.late == 1
        assert "1 stamped too late" in str(seen)

    def test_a_copy_of_the_frame_before_says_so_even_if_that_was_stale(self, node: ScriptNode, stream: Stream) -> None:
        frames = frames_of(stream, node)
        node.steps = [
            Step(sequence=n, stamp_s=100 + n * PERIOD_S, level=level) for n, level in enumerate((5, 5, 6, 6, 5))
        ]
        assert next_frame(frames, after_s=100.02).repeats
        assert [next_frame(frames).repeats for _ in range(3)] == [False, True, False]

    @pytest.mark.parametrize(
        ("step", "message"),
        [
            (Step(sequence=0, stamp_s=100.0, flags=abi.TIMESTAMP_START_OF_EXPOSURE), "not of the monotonic clock"),
            (Step(sequence=0, stamp_s=50.0), r"-50\.\d+ s from now, so it is of another clock"),
            (Step(sequence=0, stamp_s=0.0), r"-100\.\d+ s from now, so it is of another clock"),
        ],
    )
    def test_times_of_another_clock_are_refused(
        self, node: ScriptNode, stream: Stream, step: Step, message: str
    ) -> None:
        frames = frames_of(stream, node)
        node.steps = [step]
        with pytest.raises(DeviceError, match=message):
            next_frame(frames)

    @pytest.mark.parametrize("came_before", [0, 3])
    def test_buffers_that_an_unplugged_camera_gives_back_unfilled_are_no_word_about_its_clock(
        self, node: ScriptNode, stream: Stream, came_before: int
    ) -> None:
        frames = frames_of(stream, node)
        unfilled = Step(flags=abi.TIMESTAMP_MONOTONIC | abi.BUFFER_ERROR, used=0)
        node.steps = [*regular(*range(came_before)), unfilled, unfilled, Step(error=errno.ENODEV)]
        assert [next_frame(frames).sequence for _ in range(came_before)] == list(range(1, came_before + 1))
        with pytest.raises(DeviceLost, match="the camera is gone"):
            next_frame(frames)

    @pytest.mark.parametrize("stamp_s", [0.0, 100 + PERIOD_S])
    def test_an_unfilled_buffer_neither_counts_nor_makes_the_next_frame_late(
        self, node: ScriptNode, stream: Stream, stamp_s: float
    ) -> None:
        frames, seen = frames_of(stream, node), FrameSearch()
        unfilled = Step(sequence=0, stamp_s=stamp_s, flags=START_OF_EXPOSURE | abi.BUFFER_ERROR)
        node.steps = [*regular(100, 101, 102), unfilled, *regular(103, 104)]
        got = [next_frame(frames, seen=seen) for _ in range(5)]
        assert [frame.sequence for frame in got] == [1, 2, 3, 4, 5]
        assert [frame.lost for frame in got] == [0, 0, 0, 1, 0], "the rejected buffer alone"
        assert (seen.with_error, seen.late) == (1, 0)

    def test_exposures_that_abut_do_not_overlap_by_jitter(self, node: ScriptNode, stream: Stream) -> None:
        frames = frames_of(stream, node, exposes_always=True)
        node.steps = [
            Step(sequence=n, stamp_s=stamp_s)
            for n, stamp_s in enumerate((100.002, 100.0105, 100.0305, 100.0245, 99.99))
        ]
        started_s = [next_frame(frames).started_s for _ in range(5)]
        assert started_s[:4] == pytest.approx([99.952, 99.962, 99.9805, 99.9905])
        assert started_s[4] == pytest.approx(99.94), "more than jitter is left as it is"

    def test_without_exposure_control_both_kinds_of_time_stamp_count_alike(
        self, node: ScriptNode, stream: Stream
    ) -> None:
        node.steps = [Step(sequence=0, stamp_s=100.0), Step(sequence=1, stamp_s=100.05, flags=abi.TIMESTAMP_MONOTONIC)]
        frames = frames_of(stream, node, exposes_always=True)
        assert [next_frame(frames).started_s for _ in range(2)] == pytest.approx([99.95, 100.0])

    def test_a_buffer_that_is_not_taken_back_breaks_the_stream(self, node: ScriptNode, stream: Stream) -> None:
        frames = frames_of(stream, node)
        node.steps = regular(0)
        node.failures = {abi.QBUF: [errno.EINVAL]}
        with pytest.raises(StreamBroken, match="giving a buffer back failed"):
            next_frame(frames)
