"""Pixel formats that the emulated camera can be given; their bits are those of the drivers' table."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.devices.v4l2.formats import PIXEL_FORMATS

FOURCCS = ("GREY", "Y10 ", "Y12 ", "Y16 ", "YUYV", "RGGB", "MJPG")
"""V4L2's codes of four characters."""
_MJPEG_BITS_PER_PIXEL = 16
"""The room that a compressed frame may take, as cameras announce it: that of the same picture as YUYV."""
_NEUTRAL_CHROMA = 128
"""Grey."""
_JPEG_QUALITY = 95


def full_scale_dn(fourcc: str) -> int:
    """The largest digital number of a format."""
    return int(2 ** PIXEL_FORMATS[fourcc.strip()].bits - 1)


def bits_per_pixel(fourcc: str) -> int:
    """Return what a pixel takes in a frame; of a compressed one at most."""
    return PIXEL_FORMATS[fourcc.strip()].bits_per_pixel or _MJPEG_BITS_PER_PIXEL


def encoded(levels: NDArray[np.uint16], fourcc: str) -> bytes:
    """Grey digital numbers (H, W) in the bytes of a format; colour formats become grey."""
    if full_scale_dn(fourcc) > 255:
        return levels.astype("<u2").tobytes()
    grey = levels.astype(np.uint8)
    if fourcc == "YUYV":
        return np.stack([grey, np.full_like(grey, _NEUTRAL_CHROMA)], axis=-1).tobytes()
    if fourcc == "MJPG":
        return cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1].tobytes()
    return grey.tobytes()


def mean_share(frame: bytes, fourcc: str) -> float:
    """Mean of a frame's grey as a share of full scale, of about every hundredth pixel; not of compressed frames."""
    if full_scale_dn(fourcc) > 255:
        return float(np.frombuffer(frame, "<u2")[::97].mean()) / full_scale_dn(fourcc)
    step = 2 * 47 if fourcc == "YUYV" else 97
    return float(np.frombuffer(frame, np.uint8)[::step].mean()) / full_scale_dn(fourcc)
