"""The colour space that a picture's file tells."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813 - the library's own documentation calls it so

from rig.errors import UsageError
from rig.files.colour import spaces
from rig.files.colour.icc import UnknownProfile, colour_space_of
from rig.files.colour.png_chunks import colour_chunks, profile_of_chunk
from rig.files.colour.spaces import ColourSpace
from rig.files.colour.srgb import linear_of_srgb

_GAMMA_OF_SRGB = (0.44, 0.47)
"""Of a PNG's gAMA chunk: writers put 1/2.2 there for sRGB."""
_REMEDY = "convert the picture to sRGB in an image editor, and export it again"
_UNCALIBRATED, _ADOBE = 0xFFFF, 2
"""Of Exif's ColorSpace: neither sRGB nor told; Adobe RGB, as some cameras put it."""
_WHITE = 1 + 1e-4
"""And what a conversion rounds."""
_PRIMARIES = {1: spaces.SRGB_PRIMARIES, 12: spaces.P3_PRIMARIES}
"""By code points of ITU-T H.273; curves are taken of 8, linear, and 13, sRGB."""


def told_space(path: Path, spec: oiio.ImageSpec, channels: int) -> ColourSpace | None:
    """Return the colour space of a picture; None where the file says nothing.

    In this order: a PNG's cICP, a profile (ICC), a PNG's sRGB, gAMA and cHRM; Adobe RGB noted by a camera (Exif);
    chromaticities of an EXR.

    Parameters
    ----------
    path
        Of the file.
    spec
        What OpenImageIO read of it.
    channels
        1 or 3: those of the picture.

    Raises
    ------
    UsageError
        It says something that cannot be followed; the message names the remedy.
    """
    chunks = colour_chunks(path)
    try:
        space = _of_png(chunks, spec) if chunks else _of_file(spec)
    except UnknownProfile as error:
        raise UsageError(f"{path}: its colour profile {error}; {_REMEDY}") from error
    except ValueError as error:
        raise UsageError(f"{path}: what it says of its colours makes no sense here ({error}); {_REMEDY}") from error
    if space is None:
        return None
    if len(space.curves) == channels:
        return space
    if channels == 1:
        return ColourSpace(name=space.name, curves=space.curves[1:2], to_srgb=space.to_srgb)
    raise UsageError(f"{path}: its colour profile {space.name} is for grey pictures, but it has colours; {_REMEDY}")


def check_linear(path: Path, space: ColourSpace) -> None:
    """Refuse a picture that was said to be linear light, and whose own colour space says that it is not.

    Raises
    ------
    UsageError
        It is not.
    """
    if not space.is_linear:
        raise UsageError(
            f"{path}: its colour profile {space.name} says that its numbers are no linear light; leave --linear out, "
            "or export it without a profile"
        )


def check_white(path: Path, space: ColourSpace, highest: float) -> None:
    """Refuse numbers with a point that lie above the white of a colour space that is no linear light.

    Raises
    ------
    UsageError
        They do.
    """
    if not space.is_linear and highest > _WHITE:
        raise UsageError(
            f"{path}: numbers up to {highest:.4g}, but 1 is white in its colour profile {space.name}; scale it, or "
            "export linear light without a profile"
        )


def in_words(space: ColourSpace, beyond: float) -> str:
    """Return what a person has to know of a picture that was made sRGB, of whose pixels a share has other colours.

    Empty of one that is sRGB already.
    """
    if space.is_srgb:
        return ""
    lost = f" ({beyond:.1%} of its pixels have colours that sRGB lacks: they are less vivid)" if beyond else ""
    return f"{space.name}{lost}"


def _description(spec: oiio.ImageSpec) -> str:
    return str(spec.get_string_attribute("ICCProfile:profile_description")).strip()


def _of_file(spec: oiio.ImageSpec) -> ColourSpace | None:
    profile = spec.getattribute("ICCProfile")
    if profile is not None:
        return colour_space_of(np.asarray(profile, dtype=np.uint8).tobytes(), _description(spec) or "its own profile")
    noted = spec.get_int_attribute("Exif:ColorSpace", 1)
    if noted == _UNCALIBRATED:
        raise UnknownProfile("is missing, and its camera notes that its colours are not sRGB (Adobe RGB, most likely)")
    if noted == _ADOBE:
        curve = spaces.gamma_curve(spaces.ADOBE_GAMMA)
        return spaces.from_chromaticities("Adobe RGB", spaces.ADOBE_PRIMARIES, curve)
    primaries = spec.getattribute("chromaticities")
    if primaries is None:
        return None
    return spaces.from_chromaticities("its own primaries", tuple(map(float, primaries)), np.asarray)


def _of_png(chunks: dict[bytes, bytes], spec: oiio.ImageSpec) -> ColourSpace | None:
    if b"cICP" in chunks:
        return _of_code_points(*struct.unpack_from(">4B", chunks[b"cICP"].ljust(4, b"\0")))
    if b"iCCP" in chunks:  # as it stands there: the decoder drops profiles that it does not like without a word
        return colour_space_of(profile_of_chunk(chunks[b"iCCP"]), _description(spec) or "its own profile")
    if b"sRGB" in chunks:
        return None
    primaries, name = spaces.SRGB_PRIMARIES, "its own gamma"
    if b"cHRM" in chunks:
        told = [value / 100000 for value in struct.unpack(">8I", chunks[b"cHRM"].ljust(32, b"\0")[:32])]
        primaries, name = (*told[2:], *told[:2]), "its own primaries"
    curve: spaces.Curve = linear_of_srgb
    if b"gAMA" in chunks:
        gamma = int.from_bytes(chunks[b"gAMA"][:4], "big") / 100000
        if not 0.2 <= gamma <= 2:
            raise ValueError(f"gAMA {gamma:.4g}")
        is_srgb = _GAMMA_OF_SRGB[0] <= gamma <= _GAMMA_OF_SRGB[1]
        curve = linear_of_srgb if is_srgb else spaces.gamma_curve(1 / gamma)
    return spaces.from_chromaticities(name, primaries, curve)


def _of_code_points(primaries: int, curve: int, matrix: int, whole: int) -> ColourSpace:
    if primaries not in _PRIMARIES or curve not in (8, 13) or matrix != 0 or whole != 1:
        raise ValueError(f"cICP {primaries}, {curve}, {matrix}, {whole}")
    name = "Display P3" if primaries == 12 else "BT.709"
    return spaces.from_chromaticities(name, _PRIMARIES[primaries], np.asarray if curve == 8 else linear_of_srgb)
