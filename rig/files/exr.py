"""Arrays on disk, exactly: float32 OpenEXR with a name for each channel."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813 - the library's own documentation calls it so
from numpy.typing import NDArray

from rig.files.atomic import write_atomic
from rig.files.pictures import read_pixels

Float32Array = NDArray[np.float32]

_EXACT_INTEGER_LIMIT = 2**24
"""float32 holds every integer up to here."""
_COMPRESSION = "zip:1"
"""Lossless; the fastest and smallest of those measured on noisy 12-bit frames (zips, zip, piz, none)."""


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
    for key, text in (attributes or {}).items():
        spec.attribute(key, text)
    write_atomic(path, lambda part: _write(part, spec, pixels), size_bytes=pixels.nbytes)


def _as_float32(name: str, array: NDArray[np.generic]) -> Float32Array:
    if array.ndim != 2:
        raise ValueError(f"channel {name!r} has shape {array.shape}, expected (height, width)")
    if array.dtype.kind in "iu" and array.size and int(np.abs(array).max()) > _EXACT_INTEGER_LIMIT:
        raise ValueError(f"channel {name!r} has {int(array.max())}: float32 is exact only up to 2^24")
    return array.astype(np.float32)


def _spec(pixels: Float32Array, names: list[str]) -> oiio.ImageSpec:
    height, width, count = pixels.shape
    spec = oiio.ImageSpec(width, height, count, "float")
    spec.channelnames = tuple(names)
    spec.attribute("DateTime", "")  # the library would store the time of writing: other bytes at each run
    spec.attribute("compression", _COMPRESSION)
    return spec


def _write(path: Path, spec: oiio.ImageSpec, pixels: Float32Array) -> None:
    output = oiio.ImageOutput.create("openexr")
    if output is None:
        raise OSError(errno.EINVAL, "this OpenImageIO cannot write OpenEXR")
    written = output.open(str(path), spec) and output.write_image(pixels)
    reason = output.geterror()
    if not output.close() or not written:
        full = shutil.disk_usage(path.parent).free < pixels.nbytes
        raise OSError(errno.ENOSPC if full else errno.EIO, reason or output.geterror() or "writing failed")


def read_exr(path: Path) -> dict[str, Float32Array]:
    """Read every channel of an EXR as (H, W) float32, by name.

    Raises
    ------
    UsageError
        The file is missing or unreadable.
    """
    image = read_pixels(path, "float")
    pixels = image.pixels.astype(np.float32, copy=False)
    return {name: np.ascontiguousarray(pixels[..., k]) for k, name in enumerate(image.channels)}
