"""Test pictures for the emulated camera: their brightness follows exposure and gain, and each tells its number."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.devices.clock import SystemClock
from rig.devices.protocols import Clock
from rig.emulated.uvc.camera import FrameRequest

FULL_SCALES = {"GREY": 255, "RGGB": 255, "YUYV": 255, "MJPG": 255, "Y10 ": 1023, "Y12 ": 4095, "Y16 ": 65535}
"""Written out, and not read from the drivers' table of pixel formats, which these pictures are to hold to account."""
NUMBER_BITS = 16
SQUARE_PX = 16
"""Side of a square that stands for one bit of the frame's number, at the picture's top left, lowest bit first."""
MEDIUM_EXPOSURE_S = 0.01
"""Exposure at which the picture has half of full scale, at a gain of 1."""


def encode_picture(levels: NDArray[np.uint16], fourcc: str) -> bytes:
    """Bytes of a frame: (H, W) digital numbers, 0 … ``FULL_SCALES[fourcc]``; colour formats become grey."""
    if fourcc in ("Y10 ", "Y12 ", "Y16 "):
        return levels.astype("<u2").tobytes()
    grey = levels.astype(np.uint8)
    if fourcc == "YUYV":
        return np.stack([grey, np.full_like(grey, 128)], axis=-1).tobytes()
    if fourcc == "MJPG":
        return cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
    return grey.tobytes()


def read_number(picture: NDArray[np.uint8] | NDArray[np.uint16]) -> int:
    """The frame's number modulo 65536, from an (H, W) picture of any depth.

    Raises ValueError when the squares cannot be told apart.
    """
    row = picture[SQUARE_PX // 2, SQUARE_PX // 2 : SQUARE_PX * (NUMBER_BITS + 2) : SQUARE_PX].astype(np.int64)
    dark, bright = row[-2:]
    if bright - dark < 2:
        raise ValueError(f"the squares of the number are {dark} and {bright} dn: too close to read")
    bits = row[:NUMBER_BITS] > (dark + bright) / 2
    return int(bits @ (1 << np.arange(NUMBER_BITS)))


class PatternSource:
    """A moving ramp above a flat field.

    The top rows are squares: 16 bits of the frame's number, then a dark and a bright one. Brightness is proportional
    to exposure × gain, and is clipped at full scale; squares are a quarter and three quarters of full scale always.
    """

    def __init__(self, clock: Clock | None = None):
        self._clock = clock or SystemClock()

    def expose(self, request: FrameRequest) -> bytes:
        """The picture, at the end of its exposure."""
        levels = self.picture(request)
        frame = encode_picture(levels, request.fourcc)
        self._clock.wait_until_s(request.started_s + request.exposure_s)
        return frame

    @staticmethod
    def level(request: FrameRequest) -> int:
        """Digital number of the flat field."""
        full = FULL_SCALES[request.fourcc]
        return min(full, round(full / 2 * request.exposure_s / MEDIUM_EXPOSURE_S * request.gain))

    def picture(self, request: FrameRequest) -> NDArray[np.uint16]:
        """(H, W) digital numbers: squares, then a quarter of ramp, then the flat field."""
        level = self.level(request)
        picture = np.full((request.height_px, request.width_px), level, np.uint16)
        ramp = (np.arange(request.width_px) + 4 * request.number) % request.width_px * level // request.width_px
        picture[SQUARE_PX : request.height_px // 4] = ramp.astype(np.uint16)
        picture[:SQUARE_PX] = self._squares(request)
        return picture

    @staticmethod
    def _squares(request: FrameRequest) -> NDArray[np.uint16]:
        full = FULL_SCALES[request.fourcc]
        bits = [*(request.number >> bit & 1 for bit in range(NUMBER_BITS)), 0, 1]
        row = np.full(request.width_px, full // 4, np.uint16)
        squares = np.repeat(np.array(bits, np.uint16) * (full // 2) + full // 4, SQUARE_PX)
        row[: squares.size] = squares[: request.width_px]
        return row
