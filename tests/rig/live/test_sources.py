"""Sources of live pictures: what they give, how they end, and what they say when they break."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest

from rig.devices.clock import SystemClock
from rig.devices.protocols import RawFrame
from rig.errors import UsageError
from rig.files.pictures import write_png
from rig.live.sources.camera import codes_of
from rig.live.sources.choose import SourceSettings, make_source, parse_size
from rig.live.sources.files import FolderSource, PatternSource, VideoSource
from rig.live.sources.raw import SharedMemorySource, SharedMemoryWriter, StreamSource
from rig.live.sources.reader import Fitter
from rig.live.sources.source import Picture, Pixels, Source, SourceBroken, SourceEnded

SHAPE = (48, 64)
CLOCK = SystemClock()


@contextmanager
def opened(source: Source) -> Iterator[Source]:
    source.open()
    try:
        yield source
    finally:
        source.close()


def fitted(picture: Picture, shape: tuple[int, int] = SHAPE) -> Pixels:
    out = np.zeros((*shape, 3), np.uint8)
    Fitter(shape).fit(picture, out)
    return out


def codes_of_all(source: Source) -> list[int]:
    """Red of the middle of each picture, to the end."""
    codes = []
    while True:
        try:
            picture = source.read(1.0)
        except SourceEnded:
            return codes
        if picture is not None:
            codes.append(int(fitted(picture)[SHAPE[0] // 2, SHAPE[1] // 2, 0]))


@pytest.fixture
def video(tmp_path: Path) -> Path:
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, SHAPE[::-1])
    for k in range(20):
        writer.write(np.full((*SHAPE, 3), (0, 0, 10 * k), np.uint8))  # blue, green, red
    writer.release()
    return path


def test_a_video_gives_its_frames_in_order_in_its_own_pace_red_first(video: Path) -> None:
    with opened(VideoSource(video)) as source:
        assert source.frame_rate_hz == pytest.approx(30.0)
        codes = codes_of_all(source)
    assert np.abs(np.array(codes) - 10 * np.arange(20)).max() <= 4


def test_a_video_that_breaks_off_says_after_how_many_pictures(video: Path) -> None:
    data = video.read_bytes()
    video.write_bytes(data[: len(data) // 2])
    with pytest.raises(SourceBroken, match="film"), opened(VideoSource(video)) as source:
        codes_of_all(source)


@pytest.mark.parametrize("content", [b"", b"no video at all" * 100])
def test_a_file_that_is_no_video_is_refused_when_it_is_opened(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "film.mp4"
    path.write_bytes(content)
    with pytest.raises(SourceBroken, match="no video"):
        VideoSource(path).open()


def test_a_folder_gives_its_pictures_by_name_and_passes_over_the_unreadable(tmp_path: Path) -> None:
    for k in (2, 1, 3):
        write_png(tmp_path / f"{k}.png", np.full((*SHAPE, 3), 50 * k, np.uint8))
    (tmp_path / "0-broken.png").write_bytes(b"\x89PNG and nothing more")
    (tmp_path / "notes.txt").write_text("no picture", encoding="utf-8")
    with opened(FolderSource(tmp_path, 2.0)) as source:
        assert source.frame_rate_hz == 2.0
        assert codes_of_all(source) == [50, 100, 150]


def test_a_folder_without_any_readable_picture_is_broken(tmp_path: Path) -> None:
    with pytest.raises(SourceBroken, match="no pictures"):
        FolderSource(tmp_path, 1.0).open()
    (tmp_path / "a.png").write_bytes(b"nothing")
    with pytest.raises(SourceBroken, match="none of its pictures"), opened(FolderSource(tmp_path, 1.0)) as source:
        source.read(1.0)


def test_the_test_pattern_moves_has_all_tones_and_comes_round() -> None:
    source = PatternSource(SHAPE, 60.0)
    pictures = [source.read(1.0) for _ in range(SHAPE[1] // 4 + 1)]
    first, second, last = (fitted(p) for p in (pictures[0], pictures[1], pictures[-1]) if p is not None)
    assert (first != second).any()
    assert np.array_equal(first, last)
    assert (first.min(), first.max()) == (0, 255)


@contextmanager
def written(path: Path, data: bytes) -> Iterator[None]:
    """Somebody writes into a named pipe."""

    def write() -> None:
        descriptor = os.open(path, os.O_WRONLY)
        left = memoryview(data)
        while left:
            left = left[os.write(descriptor, left) :]
        os.close(descriptor)

    thread = threading.Thread(target=write)
    thread.start()
    yield
    thread.join(10.0)


def raw(codes: list[int], shape: tuple[int, int] = SHAPE) -> bytes:
    return b"".join(np.full((*shape, 3), code, np.uint8).tobytes() for code in codes)


def ppm(code: int, shape: tuple[int, int]) -> bytes:
    return f"P6\n{shape[1]} {shape[0]}\n255\n".encode() + raw([code], shape)


@pytest.fixture
def fifo(tmp_path: Path) -> Path:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    return path


def test_a_named_pipe_gives_raw_pictures_of_the_given_size_until_its_writer_leaves(fifo: Path) -> None:
    with opened(StreamSource(fifo, SHAPE, CLOCK)) as source, written(fifo, raw([7, 8, 9])):
        assert codes_of_all(source) == [7, 8, 9]


def test_a_pipe_with_headers_may_change_its_size(fifo: Path) -> None:
    data = ppm(7, SHAPE) + ppm(8, (24, 32)) + ppm(9, (96, 200))
    with opened(StreamSource(fifo, None, CLOCK)) as source, written(fifo, data):
        assert codes_of_all(source) == [7, 8, 9]


def test_a_pipe_nobody_writes_to_gives_nothing_and_does_not_block(fifo: Path) -> None:
    with opened(StreamSource(fifo, SHAPE, CLOCK)) as source:
        assert source.read(0.02) is None
        assert source.read(0.02) is None


def test_a_pipe_that_ends_in_the_middle_of_a_picture_is_broken(fifo: Path) -> None:
    with opened(StreamSource(fifo, SHAPE, CLOCK)) as source, written(fifo, raw([7]) + b"half"):
        assert source.read(1.0) is not None
        with pytest.raises(SourceBroken, match="after 4 bytes"):
            codes_of_all(source)


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (b"GIF89a" + bytes(100), "no PPM"),
        (b"P6\n99999 99999\n255\n", "limit is 16384"),
        (b"P6\n1 1\n65535\n" + bytes(80), "no PPM"),
    ],
)
def test_a_pipe_with_something_else_in_it_is_broken(fifo: Path, data: bytes, problem: str) -> None:
    with (
        opened(StreamSource(fifo, None, CLOCK)) as source,
        written(fifo, data),
        pytest.raises(SourceBroken, match=problem),
    ):
        codes_of_all(source)


def test_a_pipe_that_is_not_there_is_broken(tmp_path: Path) -> None:
    with pytest.raises(SourceBroken, match="mkfifo"):
        StreamSource(tmp_path / "nowhere", SHAPE, CLOCK).open()


def test_shared_memory_gives_the_newest_picture_once(tmp_path: Path) -> None:
    writer = SharedMemoryWriter("frames", SHAPE, tmp_path)
    with opened(SharedMemorySource("frames", CLOCK, tmp_path)) as source:
        assert source.read(0.01) is None
        for code in (1, 2, 3):
            writer.write(np.full((*SHAPE, 3), code, np.uint8))
        picture = source.read(1.0)
        assert picture is not None
        assert fitted(picture)[0, 0, 0] == 3
        assert source.read(0.01) is None
    writer.close()


def test_a_picture_that_is_just_being_written_is_not_taken(tmp_path: Path) -> None:
    writer = SharedMemoryWriter("frames", SHAPE, tmp_path)
    writer.write(np.full((*SHAPE, 3), 1, np.uint8))
    with opened(SharedMemorySource("frames", CLOCK, tmp_path)) as source:
        data = bytearray(writer.path.read_bytes())
        data[16] = 3  # the counter's lowest byte: odd
        writer.path.write_bytes(data)
        assert source.read(0.01) is None
    writer.close()


def test_a_writer_that_starts_again_in_another_size_is_followed(tmp_path: Path) -> None:
    first = SharedMemoryWriter("frames", SHAPE, tmp_path)
    with opened(SharedMemorySource("frames", CLOCK, tmp_path)) as source:
        first.close()
        second = SharedMemoryWriter("frames", (24, 32), tmp_path)
        second.write(np.full((24, 32, 3), 9, np.uint8))
        assert source.read(0.01) is None
        picture = source.read(1.0)
        assert picture is not None
        assert picture.pixels.shape == (24, 32, 3)
        second.close()
        with pytest.raises(SourceEnded):
            source.read(0.01)


@pytest.mark.parametrize("data", [b"", b"RIGFRAME", b"NOFRAMES" + bytes(200), b"RIGFRAME" + b"\xff" * 200])
def test_shared_memory_of_another_format_is_broken(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "frames").write_bytes(data)
    with pytest.raises(SourceBroken):
        SharedMemorySource("frames", CLOCK, tmp_path).open()


def test_shared_memory_that_is_shortened_while_it_is_read_is_broken(tmp_path: Path) -> None:
    writer = SharedMemoryWriter("frames", SHAPE, tmp_path)
    writer.write(np.full((*SHAPE, 3), 1, np.uint8))
    with opened(SharedMemorySource("frames", CLOCK, tmp_path)) as source:
        os.truncate(writer.path, 1000)
        with pytest.raises(SourceBroken, match="bytes of picture"):
            source.read(1.0)
    writer.close()


@pytest.mark.parametrize("shape", [(24, 32), (96, 128), (48, 200), (200, 64), (47, 63)])
def test_a_picture_of_any_size_covers_the_projector(shape: tuple[int, int]) -> None:
    assert (fitted(Picture(np.full((*shape, 3), 77, np.uint8))) == 77).all()


def test_the_middle_of_a_wide_picture_is_kept() -> None:
    wide = np.zeros((48, 192, 3), np.uint8)
    wide[:, 64:128] = (200, 100, 50)
    assert (fitted(Picture(wide)) == (200, 100, 50)).all()
    assert (fitted(Picture(wide, is_bgr=True)) == (50, 100, 200)).all()


@pytest.mark.parametrize(
    ("depth", "value", "code"), [(8, 200, 200), (10, 1023, 255), (12, 2048, 128), (16, 65535, 255)]
)
def test_a_camera_of_any_depth_gives_eight_bits(depth: int, value: int, code: int) -> None:
    out = np.zeros((*SHAPE, 3), np.uint8)
    pixels = np.full((*SHAPE, 1), value, np.uint16)
    codes_of(RawFrame(pixels=pixels, exposure_s=0.01, started_s=0.0, sequence=1), 2**depth - 1, out)
    assert (out == code).all()


def test_a_word_of_the_command_line_names_a_source(tmp_path: Path, video: Path, fifo: Path) -> None:
    settings = SourceSettings(SHAPE)
    kinds = {
        "pattern": PatternSource,
        "-": StreamSource,
        "shm:frames": SharedMemorySource,
        "pipe:somewhere": StreamSource,
        str(fifo): StreamSource,
        str(tmp_path): FolderSource,
        str(video): VideoSource,
    }
    assert {word: type(make_source(word, settings, CLOCK)) for word in kinds} == kinds
    assert make_source("camera:usb-1", settings, CLOCK).name == "camera usb-1"


def test_a_word_that_names_no_source_is_refused_with_what_there_is() -> None:
    with pytest.raises(UsageError, match=r"nowhere\.mp4: no such source; give a video"):
        make_source("nowhere.mp4", SourceSettings(SHAPE), CLOCK)


def test_a_size_is_width_times_height() -> None:
    assert parse_size("1920x1080") == (1080, 1920)
    assert parse_size("") is None
    for wrong in ("1920", "axb", "0x5", "-1x5", "1920x1080x3"):
        with pytest.raises(UsageError, match="WIDTHxHEIGHT"):
            parse_size(wrong)
