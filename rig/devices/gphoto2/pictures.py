"""Pictures of still cameras: raw files as the sensor counted, and JPEG as the camera developed them."""

from __future__ import annotations

import io
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.mosaic import Mosaic, MosaicPattern
from rig.errors import DeviceError, SettingRefused

Pixels = NDArray[np.uint16]
_START_OF_SCAN, _END_OF_IMAGE = b"\xff\xda", b"\xff\xd9"
"""Markers of JPEG (ITU-T T.81, B.1.1.3), which never stand within a scan's data."""


class WantedPicture(NamedTuple):
    """What the profile says of the picture."""

    shape: tuple[int, int, int]
    full_scale_dn: int
    mosaic: MosaicPattern | None


def from_jpeg(data: bytes, wanted: WantedPicture) -> Pixels:
    """Return a JPEG's numbers, (H, W, 1 or 3), not turned. Raises DeviceError when it holds no picture of the size."""
    grey = wanted.shape[2] == 1
    flags = (cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR) | cv2.IMREAD_IGNORE_ORIENTATION
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    if picture is None:
        raise DeviceError("the camera sent no JPEG; set its quality to JPEG alone, or pixel_format to RAW")
    if data.find(_END_OF_IMAGE, data.rfind(_START_OF_SCAN)) < 0:  # the decoder makes grey of what is missing
        raise DeviceError("the camera's JPEG breaks off before its end; try again, or change the cable or the card")
    _check_size(picture.shape[:2], wanted)
    return picture.astype(np.uint16)[..., None] if grey else np.ascontiguousarray(picture[..., ::-1]).astype(np.uint16)


def from_raw(data: bytes, wanted: WantedPicture) -> Pixels:
    """Return a raw file's numbers in linear light, with one black level for all filters, white at full scale.

    The file's black levels are brought to the highest of them, and not to zero, where noise would be cut off: what it
    is, a session measures.

    Parameters
    ----------
    data
        Of a file that LibRaw reads.
    wanted
        With a mosaic the pixels are left as they are; without one they are interpolated to three channels.

    Raises
    ------
    DeviceError
        It is no raw file, or its reader is missing.
    SettingRefused
        Its filters or its size are not the profile's.
    """
    try:
        import rawpy
    except ImportError as error:
        raise DeviceError(
            'rawpy is missing, which reads raw files; install it: pip install "procam-rig[still]"'
        ) from error
    try:
        with rawpy.imread(io.BytesIO(data)) as raw:
            pattern, white = _pattern(raw), int(raw.white_level)
            pixels = raw.raw_image_visible.astype(np.float32) + _missing_black(raw)
    except rawpy.LibRawError as error:
        raise DeviceError(f"the camera sent no raw file ({error}); set its quality to raw alone") from error
    if wanted.mosaic is not None and wanted.mosaic != pattern:
        raise SettingRefused(f"the raw file's filters are {pattern}, not {wanted.mosaic}; change camera.mosaic")
    _check_size(pixels.shape[:2], wanted)
    # What is white in the file, and not what fits into its bits, is where the sensor clips.
    scaled = np.minimum(pixels * (wanted.full_scale_dn / white), wanted.full_scale_dn)[..., None]
    if wanted.mosaic is None:
        scaled = Mosaic(pattern).interpolated(scaled)
    return np.asarray(np.rint(scaled), dtype=np.uint16)


def _pattern(raw: Any) -> MosaicPattern:
    """The filters of the first two rows of what is visible."""
    letters = raw.color_desc.decode()
    if raw.raw_pattern is None or raw.raw_pattern.shape != (2, 2):
        raise SettingRefused("the sensor has no mosaic of two by two filters; use JPEG")
    cell = "".join(letters[k] for k in np.asarray(raw.raw_pattern).ravel())
    known: tuple[MosaicPattern, ...] = ("RGGB", "GRBG", "GBRG", "BGGR")
    found = next((one for one in known if one == cell), None)
    if found is None:
        raise SettingRefused(f"the sensor's filters are {cell}, not those of a Bayer mosaic; use JPEG")
    return found


def _missing_black(raw: Any) -> NDArray[np.float32]:
    """(H, W) by how much the black level of each pixel's filter is below the highest, by the file."""
    levels = np.asarray(raw.black_level_per_channel, np.float32)[np.asarray(raw.raw_pattern)]
    height, width = raw.raw_image_visible.shape
    return np.tile(levels.max() - levels, (height // 2 + 1, width // 2 + 1))[:height, :width]


def _check_size(size: tuple[int, ...], wanted: WantedPicture) -> None:
    if size != wanted.shape[:2]:
        raise SettingRefused(
            f"the camera's pictures have {size[1]} x {size[0]} px, not {wanted.shape[1]} x {wanted.shape[0]}; "
            "change camera.width_px and height_px, or the camera's image size"
        )
