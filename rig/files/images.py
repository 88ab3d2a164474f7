"""Images on disk: EXR by channel name, 8-bit PNG, and pictures that users hand in as targets."""

from __future__ import annotations

import errno
import math
import os
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813 - the library's own documentation calls it so
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.files.atomic import write_atomic

Float32Array = NDArray[np.float32]

_EXACT_INTEGER_LIMIT = 2**24
"""float32 holds every integer up to here."""
_EXR_COMPRESSION = "zip:1"
"""Lossless; the fastest and smallest of those measured on noisy 12-bit frames (zips, zip, piz, none)."""
_PICTURE_CHANNELS = (("R", "G", "B"), ("Y",), ("I",))
_PICTURE_SUFFIXES = "PNG, JPEG, TIFF or EXR"


def write_exr(
    path: Path, channels: Mapping[str, NDArray[np.generic]], attributes: Mapping[str, str] | None = None
) -> None:
    """Write (H, W) arrays as the named channels of one float32 EXR; the same input gives the same bytes.

    Unsigned integers up to 2²⁴ and float32 (NaN included) come back exactly; float64 is rounded to float32.
    Numbers that matter belong into JSON: EXR attributes are text for viewers.

    Raises
    ------
    ValueError
        No channel, unequal shapes, or integers that float32 cannot hold.
    SessionError
        The disk is full or refuses.
    """
    names = sorted(channels)
    pixels = np.dstack([_as_float32(name, channels[name]) for name in names])
    spec = _spec(pixels, names)
    spec.attribute("compression", _EXR_COMPRESSION)
    for key, text in (attributes or {}).items():
        spec.attribute(key, text)
    write_atomic(path, lambda part: _write(part, "openexr", spec, pixels), size_bytes=pixels.nbytes)


def _as_float32(name: str, array: NDArray[np.generic]) -> Float32Array:
    if array.ndim != 2:
        raise ValueError(f"channel {name!r} has shape {array.shape}, expected (height, width)")
    if array.dtype.kind in "iu" and array.size and int(np.abs(array).max()) > _EXACT_INTEGER_LIMIT:
        raise ValueError(f"channel {name!r} has {int(array.max())}: float32 is exact only up to 2^24")
    return array.astype(np.float32)


def _spec(pixels: NDArray[np.generic], names: list[str]) -> oiio.ImageSpec:
    height, width, count = pixels.shape
    spec = oiio.ImageSpec(width, height, count, "float" if pixels.dtype == np.float32 else "uint8")
    spec.channelnames = tuple(names)
    spec.attribute("DateTime", "")  # the library would store the time of writing: other bytes at each run
    return spec


def _write(path: Path, file_format: str, spec: oiio.ImageSpec, pixels: NDArray[np.generic]) -> None:
    output = oiio.ImageOutput.create(file_format)
    if output is None:
        raise OSError(errno.EINVAL, f"this OpenImageIO cannot write {file_format}")
    written = output.open(str(path), spec) and output.write_image(pixels)
    reason = output.geterror()
    if not output.close() or not written:
        full = shutil.disk_usage(path.parent).free < pixels.nbytes
        raise OSError(errno.ENOSPC if full else errno.EIO, reason or output.geterror() or "writing failed")


def read_exr(path: Path) -> dict[str, Float32Array]:
    """Read every channel of an EXR as (H, W) float32, by name.

    Raises UsageError when the file is missing or unreadable.
    """
    pixels, names, _ = _read(path, "float")
    return {name: np.ascontiguousarray(pixels[..., k]) for k, name in enumerate(names)}


def write_png(path: Path, pixels: NDArray[np.uint8]) -> None:
    """Write (H, W) or (H, W, C) uint8, C = 1 or 3, as PNG.

    Raises ValueError for other arrays, SessionError when the disk is full or refuses.
    """
    image = pixels[..., None] if pixels.ndim == 2 else pixels
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] not in (1, 3):
        raise ValueError(f"PNG takes uint8 of 1 or 3 channels, not {pixels.dtype} of shape {pixels.shape}")
    spec = _spec(image, ["Y"] if image.shape[2] == 1 else ["R", "G", "B"])
    contiguous = np.ascontiguousarray(image)
    write_atomic(path, lambda part: _write(part, "png", spec, contiguous), size_bytes=image.nbytes)


def read_picture(path: str | os.PathLike[str]) -> Float32Array:
    """Read a target picture: (H, W, C) float32, C = 1 or 3, grey levels 0 … 255 that are linear in light.

    The numbers in the file are taken as they are, as in the paper: 8-bit codes are the levels, 16-bit codes
    are divided by 257, EXR values (0 … 1) are multiplied by 255. No display gamma is undone; transparency
    is ignored; the orientation that a camera noted is applied.

    Raises
    ------
    UsageError
        The file is missing or unreadable, or has NaN, infinite or negative values.
    """
    path = Path(path)
    pixels, names, orientation = _read(path, "")
    picture = _upright(pixels, orientation)[..., _picture_channels(path, names)]
    levels = _grey_levels(picture)
    _check_levels(path, levels)
    return levels


def _picture_channels(path: Path, names: list[str]) -> list[int]:
    known = next((c for c in _PICTURE_CHANNELS if set(c) <= set(names)), None)
    if known is None:
        raise UsageError(f"{path}: has channels {', '.join(names)}; a picture needs R, G, B or Y: export it as such")
    return [names.index(c) for c in known]


def _grey_levels(picture: NDArray[np.generic]) -> Float32Array:
    full_scale = 256**picture.dtype.itemsize - 1 if picture.dtype.kind == "u" else 1
    return (picture.astype(np.float64) * (255.0 / full_scale)).astype(np.float32)


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


def _read(path: Path, sample_format: str) -> tuple[NDArray[np.generic], list[str], int]:
    """Pixels (H, W, C) in the file's own format (or the given one), channel names, Exif orientation."""
    if not path.is_file():
        raise UsageError(f"{path}: no such file; check the name")
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)  # or the colours come multiplied by the transparency
    source = oiio.ImageInput.open(str(path), config)
    if source is None:
        raise UsageError(f"{path}: cannot be read ({_first_line(oiio.geterror())}); use {_PICTURE_SUFFIXES}")
    spec = source.spec()
    pixels = source.read_image(sample_format or spec.format)
    problem = source.geterror()
    source.close()
    if pixels is None or problem:
        raise UsageError(f"{path}: is damaged ({_first_line(problem)}); copy or export it again")
    if math.prod(pixels.shape) == 0:
        raise UsageError(f"{path}: has no pixels")
    return pixels, list(spec.channelnames), spec.get_int_attribute("Orientation", 1)


def _first_line(text: str) -> str:
    return text.strip().splitlines()[0] if text.strip() else "no reason given"


def _upright(pixels: NDArray[np.generic], orientation: int) -> NDArray[np.generic]:
    """Undo the Exif orientation 1 … 8."""
    if orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return pixels


def linear_of_srgb(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Linear light of sRGB codes, both 0 … 1 (IEC 61966-2-1)."""
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
