"""Pictures on disk and in their size: one reader with the camera's orientation, one PNG writer, one cover-and-crop."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
import OpenImageIO as oiio  # noqa: N813 - the library's own documentation calls it so
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.files.atomic import write_bytes
from rig.files.colour.spaces import ColourSpace, srgb_light
from rig.files.colour.srgb import linear_of_srgb, srgb_of_linear
from rig.files.colour.told import check_linear, check_white, in_words, told_space
from rig.files.colour.transparency import check_opaque

Float32Array = NDArray[np.float32]
Codes = NDArray[np.uint8]
Sample = TypeVar("Sample", np.uint8, np.float32, np.float64)

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Share of linear red, green and blue in luminance (ITU-R BT.709)."""
_PICTURE_CHANNELS = (("R", "G", "B"), ("Y",), ("I",))
_BRIGHTEST = 255.001
"""Grey level: 255, and the rounding of an EXR whose white is 1.0 in half precision."""
MOST_PX = 128 << 20
"""Pixels of a picture: the largest cameras have as many; three channels of numbers then take 1.6 GB."""
_MOST_CHANNELS = 32
_PICTURE_SUFFIXES = "PNG, JPEG, TIFF or EXR"


@dataclass(frozen=True, slots=True, eq=False)
class ImageFile:
    """What an image file holds."""

    pixels: NDArray[np.generic]
    """(H, W, C), upright: the orientation that a camera noted is applied."""
    channels: tuple[str, ...]
    """Names of the C channels."""
    header: oiio.ImageSpec
    """What the file says of itself."""


def read_pixels(path: Path, sample_format: str = "") -> ImageFile:
    """Read an image file, colours not multiplied by the transparency.

    Parameters
    ----------
    path
        Of a PNG, JPEG, TIFF, EXR, or whatever else OpenImageIO reads.
    sample_format
        OpenImageIO's name of the numbers wanted; default: the file's own.

    Raises
    ------
    UsageError
        The file is missing, unreadable, ends early, or has no pixels.
    """
    if not path.is_file():
        raise UsageError(f"{path}: no such file; check the name")
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)  # or the colours come multiplied by the transparency
    source = oiio.ImageInput.open(str(path), config)
    if source is None:
        raise UsageError(f"{path}: cannot be read ({_first_line(oiio.geterror())}); use {_PICTURE_SUFFIXES}")
    try:
        spec, pixels, problem = _decoded(path, source, sample_format)
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: its header has names that are no text (UTF-8); export it again") from error
    finally:
        source.close()
    if pixels is None or problem:
        raise UsageError(f"{path}: is damaged ({_first_line(problem)}); copy or export it again")
    if math.prod(pixels.shape) == 0:
        raise UsageError(f"{path}: has no pixels; export it again")
    upright = _upright(pixels, spec.get_int_attribute("Orientation", 1))
    return ImageFile(upright, tuple(_printable(name) for name in spec.channelnames), spec)


def _decoded(
    path: Path, source: oiio.ImageInput, sample_format: str
) -> tuple[oiio.ImageSpec, NDArray[np.generic] | None, str]:
    """Return what a file says of itself, its pixels, and what was wrong; held to limits before memory is asked for."""
    spec = source.spec()
    pixels_px = spec.width * spec.height * max(spec.depth, 1)
    if pixels_px > MOST_PX or spec.nchannels > _MOST_CHANNELS:
        raise UsageError(
            f"{path}: says that it has {spec.width} x {spec.height} px in {spec.nchannels} channels; the limits are "
            f"{MOST_PX >> 20} megapixels and {_MOST_CHANNELS} channels: make it smaller, or copy it again"
        )
    pixels = source.read_image(sample_format or spec.format)
    return spec, pixels, source.geterror()


def _printable(name: str) -> str:
    """Return a name whose bytes may be no text so that it can be printed."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def _first_line(text: str) -> str:
    return _printable(text.strip().splitlines()[0]) if text.strip() else "no reason given"


def _upright(pixels: NDArray[np.generic], orientation: int) -> NDArray[np.generic]:
    """Undo the Exif orientation 1 … 8."""
    if orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return pixels


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PictureLevels:
    """A target picture as it was read."""

    levels: Float32Array
    """(H, W, C) grey levels, 0 … 255, linear in light."""
    is_linear: bool
    """Whether the file's numbers were taken as linear light; else as sRGB, or as the file's colour profile says."""
    profile: str = ""
    """In words: the colour space that the file tells and that was made sRGB; empty: none but sRGB."""
    lost_colours: bool = False
    """Whether colours became grey."""


def read_picture(path: str | os.PathLike[str], *, is_linear: bool = False) -> PictureLevels:
    """Read a target picture of C = 1 or 3 channels.

    Codes of 8 and 16 bits are sRGB, as everywhere, unless they are said to be linear light as in the paper (8-bit codes
    are then the levels, 16-bit codes are divided by 257); numbers with a point (0 … 1; EXR, some TIFF) are linear
    light, unless a profile in the file says otherwise. Another colour space that the file tells (a profile, a PNG's
    chunks, an EXR's chromaticities) is made sRGB. The orientation that a camera noted is applied.

    Parameters
    ----------
    path
        Of the file.
    is_linear
        Codes of 8 and 16 bits are linear light.

    Raises
    ------
    UsageError
        The file is missing, unreadable or partly transparent, has NaN, infinite or negative values, or tells a colour
        space that cannot be followed.
    """
    path = Path(path)
    colours, space = _colours(path)
    is_told_linear = is_linear
    is_linear |= colours.dtype.kind == "f" and (space is None or space.is_linear)
    if colours.dtype not in (np.uint8, np.uint16) and colours.dtype.kind != "f":
        raise UsageError(f"{path}: has numbers of the type {colours.dtype}; export it with 8 or 16 bits, or as EXR")
    if space is None:
        levels, words = _grey_levels(colours, is_linear=is_linear), ""
    else:
        if is_told_linear:
            check_linear(path, space)
        if colours.dtype.kind == "f":
            check_white(path, space, float(colours.max()))
        light, beyond = srgb_light(colours, space)
        levels, words = light * np.float32(255), in_words(space, beyond)
    _check_levels(path, levels if space is None else np.asarray(colours, dtype=np.float32))
    return PictureLevels(levels=levels, is_linear=is_linear, profile=words)


def _colours(path: Path) -> tuple[NDArray[np.generic], ColourSpace | None]:
    """(H, W, 3) red, green, blue, or (H, W, 1) grey, as the file has it; its colour space, None for codes of sRGB."""
    image = read_pixels(path)
    known = next((names for names in _PICTURE_CHANNELS if set(names) <= set(image.channels)), None)
    if known is None:
        there = ", ".join(image.channels)
        raise UsageError(f"{path}: has channels {there}; a picture needs R, G, B or Y: export it as such")
    if "A" in image.channels:
        check_opaque(path, image.pixels[..., image.channels.index("A")])
    colours = image.pixels[..., [image.channels.index(name) for name in known]]
    space = told_space(path, image.header, len(known))
    is_usual = space is not None and space.is_srgb and colours.dtype.kind != "f"
    return colours, None if is_usual else space


def _grey_levels(picture: NDArray[np.generic], *, is_linear: bool) -> Float32Array:
    full_scale = int(256**picture.dtype.itemsize) - 1 if picture.dtype.kind == "u" else 1
    if is_linear or picture.dtype.kind != "u":
        return (picture.astype(np.float64) * (255.0 / full_scale)).astype(np.float32)
    table = (255.0 * linear_of_srgb(np.arange(full_scale + 1) / full_scale)).astype(np.float32)
    levels: Float32Array = np.take(table, picture.astype(np.intp))
    return levels


def _check_levels(path: Path, levels: Float32Array) -> None:
    bad = int(np.count_nonzero(~np.isfinite(levels)))
    if bad:
        raise UsageError(f"{path}: {bad} of {levels.size} values are NaN or infinite; replace them by numbers")
    negative = int(np.count_nonzero(levels < 0))
    if negative:
        raise UsageError(
            f"{path}: {negative} of {levels.size} values are negative (lowest {levels.min() / 255:.4g}); "
            "light cannot be: set them to 0"
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PictureCodes:
    """A picture as a display takes it."""

    codes: Codes
    """(H, W, 3) of sRGB, red first; of a pattern also (H, W)."""
    profile: str = ""
    """In words: the colour space that the file tells and that was made sRGB; empty: none but sRGB."""


def read_codes(path: Path) -> Codes:
    """Return the codes of :func:`read_shown` alone, and raise as it does."""
    return read_shown(path).codes


def read_shown(path: Path) -> PictureCodes:
    """Read a picture as a display takes it: codes of sRGB; of 16 bits the upper eight.

    A colour space that the file tells is made sRGB, as by :func:`read_picture`.

    Raises
    ------
    UsageError
        The file is missing, unreadable or partly transparent, has no codes of 8 or 16 bits, or tells a colour space
        that cannot be followed.
    """
    colours, space = _colours(path)
    if colours.dtype not in (np.uint8, np.uint16):
        raise UsageError(f"{path}: has values of {colours.dtype}; export it with 8 or 16 bits")
    words = ""
    if space is not None:
        light, beyond = srgb_light(colours, space)
        words = in_words(space, beyond)
        colours = np.rint(255 * srgb_of_linear(light.astype(np.float64))).astype(np.uint8)
    eight = colours.astype(np.uint8) if colours.dtype == np.uint8 else (colours >> 8).astype(np.uint8)  # type: ignore[operator]
    codes = np.ascontiguousarray(np.broadcast_to(eight, (*eight.shape[:2], 3)))
    return PictureCodes(codes=codes, profile=words)


def png_of(codes: Codes, compression: int | None = None) -> bytes:
    """Return a picture as the bytes of a PNG.

    Parameters
    ----------
    codes
        (H, W) or (H, W, 1) grey, or (H, W, 3), red first.
    compression
        0 … 9, from quick to small; None: the library's choice.

    Raises
    ------
    ValueError
        Another shape or type.
    """
    if codes.dtype != np.uint8 or codes.ndim not in (2, 3) or codes.shape[2:] not in ((), (1,), (3,)):
        raise ValueError(f"PNG takes uint8 of 1 or 3 channels, not {codes.dtype} of shape {codes.shape}")
    effort = [] if compression is None else [cv2.IMWRITE_PNG_COMPRESSION, compression]
    coded, data = cv2.imencode(".png", codes[..., ::-1] if codes.ndim == 3 else codes, effort)
    if not coded:
        raise ValueError(f"a picture of shape {codes.shape} could not be coded as PNG")
    return data.tobytes()


def write_png(path: Path, codes: Codes, compression: int | None = None) -> None:
    """Write a picture as PNG; parameters and ValueError as for :func:`png_of`.

    Raises
    ------
    SessionError
        The disk is full or refuses.
    """
    write_bytes(path, png_of(codes, compression))


def covering_shape(shape: tuple[int, ...], wanted: tuple[int, int]) -> tuple[int, int]:
    """Return (height, width), in pixels, of a picture that is scaled until it covers the wanted (height, width)."""
    factor = max(wanted[0] / shape[0], wanted[1] / shape[1])
    return max(wanted[0], round(shape[0] * factor)), max(wanted[1], round(shape[1] * factor))


def centre_crop(picture: NDArray[Sample], shape: tuple[int, int]) -> NDArray[Sample]:
    """Return the middle (height, width) pixels of a picture (H, W) or (H, W, C), a view."""
    top, left = (picture.shape[0] - shape[0]) // 2, (picture.shape[1] - shape[1]) // 2
    return picture[top : top + shape[0], left : left + shape[1]]


def cover(
    picture: NDArray[Sample], shape: tuple[int, int], enlarging: int, scaled: NDArray[Sample] | None = None
) -> NDArray[Sample]:
    """Return a picture (H, W, C) scaled to cover a shape, and cropped to it; itself where it has the shape.

    Parameters
    ----------
    picture
        Of any size.
    shape
        (height, width) wanted. [px]
    enlarging
        OpenCV's interpolation where the picture is too small; where it is too large, areas are averaged.
    scaled
        Memory of :func:`covering_shape` to scale into; default: new memory.

    Raises
    ------
    UsageError
        The picture is so long or so high that it would be huge.
    """
    if picture.shape[:2] == shape:
        return picture
    height, width = covering_shape(picture.shape, shape)
    if height * width > MOST_PX:
        raise UsageError(
            f"a picture of {picture.shape[1]} x {picture.shape[0]} px would have to be scaled to {width} x {height} px "
            f"to cover {shape[1]} x {shape[0]} px; crop it to a similar shape"
        )
    shrinks = max(shape[0] / picture.shape[0], shape[1] / picture.shape[1]) < 1
    method = cv2.INTER_AREA if shrinks else enlarging
    data: NDArray[Any] = cv2.resize(picture, (width, height), dst=scaled, interpolation=method)
    return centre_crop(data.reshape(height, width, -1), shape)


def fitted(picture: Float32Array, shape: tuple[int, int]) -> Float32Array:
    """Return grey levels (H, W, C) scaled to cover a shape, and cropped to it, within 0 … 255."""
    covering = cover(picture, shape, cv2.INTER_CUBIC)
    return np.clip(covering, 0, 255, out=covering)  # smooth curves overshoot


def in_channels(picture: Float32Array, channels: int) -> Float32Array:
    """Return a picture (H, W, 1 or 3) in one channel, its luminance, or in several, grey being a colour, too."""
    if picture.shape[2] == channels:
        return picture
    if channels > 1:
        return np.repeat(picture, channels, axis=2)
    return np.asarray((picture @ LUMINANCE.astype(np.float32))[..., None])


def read_picture_of_shape(
    path: str | os.PathLike[str], shape: tuple[int, int], *, channels: int, fit: bool, is_linear: bool = False
) -> PictureLevels:
    """Read a target picture as a projector takes it: its grey levels are (height, width, channels).

    Parameters
    ----------
    path
        As for :func:`read_picture`.
    shape
        (height, width) of the projector.
    channels
        1 or 3.
    fit
        Scale and crop a picture of another size.
    is_linear
        As for :func:`read_picture`.

    Raises
    ------
    UsageError
        The file is missing, unreadable, of another size (unless `fit`), too bright, or not finite.
    """
    read = read_picture_in_channels(path, channels=channels, is_linear=is_linear)
    picture = read.levels
    if picture.shape[:2] != shape and not fit:
        raise UsageError(
            f"{path}: {picture.shape[1]} x {picture.shape[0]} px, but the projector has {shape[1]} x {shape[0]} px; "
            "resize the picture, or add --fit to crop and scale it"
        )
    picture = picture if picture.shape[:2] == shape else fitted(picture, shape)
    return replace(read, levels=np.ascontiguousarray(picture, dtype=np.float32))


def read_picture_in_channels(path: str | os.PathLike[str], *, channels: int, is_linear: bool = False) -> PictureLevels:
    """Read a target picture of any size; its grey levels are (H, W, channels).

    Raises
    ------
    UsageError
        The file is missing, unreadable, too bright, or not finite.
    """
    read = read_picture(path, is_linear=is_linear)
    levels = read.levels
    lost_colours = channels == 1 and bool((levels != levels[..., :1]).any())
    if levels.max() > _BRIGHTEST:
        raise UsageError(f"{path}: grey levels up to {levels.max():.4g}, the limit is 255 (1.0 in an EXR); scale it")
    own = np.ascontiguousarray(in_channels(levels, channels), dtype=np.float32)
    return replace(read, levels=own, lost_colours=lost_colours)
