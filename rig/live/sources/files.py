"""Sources that are read at their own pace: video files, folders of pictures, a moving test picture."""

from __future__ import annotations

import math
import os
from pathlib import Path

import cv2
import numpy as np

from rig.devices.protocols import Clock
from rig.errors import UsageError
from rig.files.pictures import PictureCodes, read_shown
from rig.live.sources.film_colours import check_colours
from rig.live.sources.source import FilmBroken, Picture, PictureBroken, Pixels, SourceEnded, SourceGone

PICTURE_SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".ppm"}
_USUAL_RATE_HZ = 25.0
"""Of a video that does not say."""
_WHOLE = 0.95
"""Share of the pictures that a video announces; with fewer it broke off. Announcements are estimates."""
_PAN_PX = 4
"""A frame: at 60 Hz the eye still follows it."""


class VideoSource:
    """A video file, in the pace that it names; sound is ignored."""

    def __init__(self, path: Path):
        self._path = path
        self._video: cv2.VideoCapture | None = None
        self._rate_hz = _USUAL_RATE_HZ
        self._announced = 0
        self._count = 0
        self._pixels: Pixels | None = None
        self._told: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The file's name."""
        return self._path.name

    @property
    def frame_rate_hz(self) -> float:
        """The pace that the file names."""
        return self._rate_hz

    def open(self) -> None:
        """Begin with the first picture. Raises SourceGone, FilmBroken."""
        self.close()
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # what is wrong is said here, once
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        if not self._path.is_file():
            raise SourceGone(f"{self._path}: is there no more; put it back, or leave the source out")
        video = cv2.VideoCapture(str(self._path))
        if not video.isOpened():
            raise FilmBroken(f"{self._path}: is no video that can be read; convert it to MP4 or MKV")
        self._told = check_colours(self._path)
        rate_hz, announced = video.get(cv2.CAP_PROP_FPS), video.get(cv2.CAP_PROP_FRAME_COUNT)
        self._rate_hz = rate_hz if math.isfinite(rate_hz) and rate_hz > 0 else _USUAL_RATE_HZ
        self._announced = int(announced) if math.isfinite(announced) and announced > 0 else 0
        self._video, self._count = video, 0

    def read(self, _timeout_s: float) -> Picture | None:
        """Decode the next picture. Raises SourceEnded, FilmBroken when there are fewer than announced."""
        if self._video is None:
            raise FilmBroken(f"{self._path}: is closed")
        there, pixels = self._video.read(self._pixels)
        if there and pixels is not None:
            self._pixels = np.asarray(pixels, dtype=np.uint8)
            self._count += 1
            return Picture(self._pixels, is_bgr=True, told=self._told)
        if self._count == 0 or self._count < _WHOLE * self._announced:
            raise FilmBroken(
                f"{self._path}: breaks off after {self._count} of {self._announced} pictures; copy or convert it again"
            )
        raise SourceEnded

    def close(self) -> None:
        """Let the file go."""
        if self._video is not None:
            self._video.release()
            self._video = None


class FolderSource:
    """The pictures of a folder in the order of their names, in a given pace; refused ones are passed over and told."""

    def __init__(self, folder: Path, rate_hz: float):
        self._folder = folder
        self._rate_hz = rate_hz
        self._left: list[Path] = []
        self._good = 0

    @property
    def name(self) -> str:
        """The folder's name."""
        return self._folder.name

    @property
    def frame_rate_hz(self) -> float:
        """The pace that was given."""
        return self._rate_hz

    def open(self) -> None:
        """Begin with the first picture. Raises SourceGone, PictureBroken."""
        if not self._folder.is_dir():
            raise SourceGone(f"{self._folder}: is there no more; put it back, or leave the source out")
        try:
            files = sorted(path for path in self._folder.iterdir() if path.suffix.lower() in PICTURE_SUFFIXES)
        except OSError as error:
            raise PictureBroken(f"{self._folder}: cannot be read: {error.strerror}; check the name") from error
        if not files:
            raise PictureBroken(
                f"{self._folder}: has no pictures ({', '.join(sorted(PICTURE_SUFFIXES))}); check the name"
            )
        self._left, self._good = files[::-1], 0

    def read(self, _timeout_s: float) -> Picture | None:
        """Decode the next picture. Raises SourceEnded, PictureBroken when none can be read."""
        told: list[str] = []
        while self._left:
            try:
                path = self._left.pop()
                read = read_shown(path)
            except UsageError as error:
                told.append(f"passed over: {error}")
                continue
            self._good += 1
            return Picture(read.codes, told=(*told, *_taken_as(path, read)))
        if self._good == 0:
            raise PictureBroken(f"{self._folder}: none of its pictures can be read; export them again as PNG or JPEG")
        raise SourceEnded(*told)

    def close(self) -> None:
        """Forget what is left."""
        self._left = []


class StillSource:
    """One picture, held until the show ends, or as long as a picture of a folder when other sources follow.

    Parameters
    ----------
    path
        Of the picture.
    hold_s
        None: for ever.
    clock
        The machine's.
    """

    def __init__(self, path: Path, hold_s: float | None, clock: Clock):
        self._path = path
        self._hold_s = hold_s
        self._clock = clock
        self._until_s: float | None = None

    @property
    def name(self) -> str:
        """The file's name."""
        return self._path.name

    @property
    def frame_rate_hz(self) -> None:
        """It comes once."""
        return

    def open(self) -> None:
        """Look for the file. Raises SourceGone."""
        if not self._path.is_file():
            raise SourceGone(f"{self._path}: is there no more; put it back, or leave the source out")
        self._until_s = None

    def read(self, timeout_s: float) -> Picture | None:
        """Give the picture, then None while it is held. Raises SourceEnded, PictureBroken."""
        now_s = self._clock.now_s()
        if self._until_s is None:
            try:
                read = read_shown(self._path)
            except UsageError as error:
                raise PictureBroken(str(error)) from error
            self._until_s = math.inf if self._hold_s is None else now_s + self._hold_s
            return Picture(read.codes, told=_taken_as(self._path, read))
        if now_s >= self._until_s:
            raise SourceEnded
        self._clock.wait_until_s(min(now_s + timeout_s, self._until_s))
        return None

    def close(self) -> None:
        """Forget it."""
        self._until_s = None


def _taken_as(path: Path, read: PictureCodes) -> tuple[str, ...]:
    return (f"{path.name}: taken as {read.profile}",) if read.profile else ()


class PatternSource:
    """A test picture that pans without end: ramps, blocks, fields of colour, black and white."""

    def __init__(self, shape: tuple[int, int], rate_hz: float):
        self._width_px = shape[1]
        self._rate_hz = rate_hz
        once = test_picture(shape)
        self._round = np.concatenate([once, once], axis=1)
        self._count = 0

    @property
    def name(self) -> str:
        """The words for it."""
        return "test pattern"

    @property
    def frame_rate_hz(self) -> float:
        """The pace that was given."""
        return self._rate_hz

    def open(self) -> None:
        """Begin at the left."""
        self._count = 0

    def read(self, _timeout_s: float) -> Picture | None:
        """Pan by a few pixels."""
        left = self._count * _PAN_PX % self._width_px
        self._count += 1
        return Picture(self._round[:, left : left + self._width_px])

    def close(self) -> None:
        """Nothing to let go."""


def test_picture(shape: tuple[int, int]) -> Pixels:
    """(H, W, 3) codes whose right side goes on at its left: soft colours, ramps, a checker, black and white fields."""
    height, width = shape
    y, x = np.mgrid[:height, :width].astype(np.float32) / np.float32(height)
    turn = 2 * np.pi * x * height / width
    colours = [
        128 + 70 * np.sin(turn * k + phase) * np.cos(np.pi * y * k) for k, phase in ((1.0, 0.0), (2.0, 2.1), (3.0, 4.2))
    ]
    picture = np.stack(colours, axis=-1)
    band = height // 5
    picture[:band] = (255 * np.abs(2 * (x[:band] * height / width) - 1))[..., None]
    checker = (np.floor(8 * y) + np.floor(8 * x)) % 2
    lower = slice(height - band, height)
    picture[lower] = (40 + 175 * checker[lower])[..., None]
    third, quarter = height // 3, width // 4
    picture[third : 2 * third, : quarter // 2] = 0
    picture[third : 2 * third, 2 * quarter : 2 * quarter + quarter // 2] = 255
    return np.asarray(np.clip(np.rint(picture), 0, 255), dtype=np.uint8)
