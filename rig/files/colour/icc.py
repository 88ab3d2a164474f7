"""Colour profiles (ICC.1:2022) that say what they mean by curves and a matrix: those of displays and editors."""

from __future__ import annotations

import struct

import numpy as np

from rig.files.colour.spaces import ColourSpace, Curve, FloatArray, gamma_curve, srgb_of_d50

_HEADER, _MOST_TAGS = 128, 200
_WHITE_OFF = 0.03
"""Of 1, in linear sRGB: rounded profiles stay below 0.002; one whose white was not adapted to D50 has 0.2 and more."""
_PARAMETERS = (1, 3, 4, 5, 7)
"""Numbers of a parametric curve of kinds 0 … 4 (table 68)."""


class UnknownProfile(ValueError):
    """A profile that is damaged, or of a kind that curves and a matrix do not describe; the message says which."""


def colour_space_of(profile: bytes, name: str) -> ColourSpace:
    """Return the colour space that a profile describes.

    Parameters
    ----------
    profile
        Its bytes.
    name
        Of the space, for people.

    Raises
    ------
    UnknownProfile
        See there.
    """
    try:
        return _checked(_space(profile, name))
    except (struct.error, IndexError, np.linalg.LinAlgError) as error:
        raise UnknownProfile("is damaged") from error


def _space(profile: bytes, name: str) -> ColourSpace:
    kind = profile[16:20]
    if profile[36:40] != b"acsp":
        raise UnknownProfile("is damaged")
    if kind not in (b"RGB ", b"GRAY"):
        raise UnknownProfile(f"is for {kind.decode('ascii', 'replace').strip()} colours")
    tags = _tags(profile)
    if kind == b"GRAY" and b"kTRC" in tags:
        return ColourSpace(name=name, curves=(_curve(tags[b"kTRC"]),), to_srgb=np.eye(3))
    wanted = [(one + b"XYZ", one + b"TRC") for one in (b"r", b"g", b"b")]
    if kind == b"GRAY" or profile[20:24] != b"XYZ " or not all(tag in tags for pair in wanted for tag in pair):
        raise UnknownProfile("describes its colours by tables")
    matrix = np.stack([_xyz(tags[place]) for place, _ in wanted], axis=1)
    curves = tuple(_curve(tags[curve]) for _, curve in wanted)
    return ColourSpace(name=name, curves=curves, to_srgb=srgb_of_d50(matrix))


def _checked(space: ColourSpace) -> ColourSpace:
    """Return a space whose white is white and whose curves are numbers."""
    white = space.to_srgb.sum(axis=1)
    share = np.linspace(0.0, 1.0, 256)
    if not np.isfinite([curve(share) for curve in space.curves]).all() or np.abs(white - 1).max() > _WHITE_OFF:
        raise UnknownProfile("is damaged: its white is not white")
    return space


def _tags(profile: bytes) -> dict[bytes, bytes]:
    """Data of each tag (7.3)."""
    (count,) = struct.unpack_from(">I", profile, _HEADER)
    if count > _MOST_TAGS:
        raise UnknownProfile("is damaged")
    entries = (struct.unpack_from(">4sII", profile, _HEADER + 4 + 12 * k) for k in range(count))
    return {name: profile[start : start + size] for name, start, size in entries}


def _xyz(data: bytes) -> FloatArray:
    return np.array(struct.unpack_from(">3i", data, 8)) / 65536


def _curve(data: bytes) -> Curve:
    if data[:4] == b"para":
        return _parametric(data)
    if data[:4] != b"curv":
        raise UnknownProfile("has a curve of an unknown kind")
    (count,) = struct.unpack_from(">I", data, 8)
    if count > (len(data) - 12) // 2:
        raise UnknownProfile("is damaged")
    values = np.array(struct.unpack_from(f">{count}H", data, 12), dtype=np.float64)
    if count <= 1:
        return gamma_curve(float(values[0]) / 256 if count else 1.0)
    places = np.linspace(0.0, 1.0, count)
    return lambda share: np.interp(share, places, values / 65535)


def _parametric(data: bytes) -> Curve:
    """(a·x + b) ** g + e where x >= d, else c·x + f (10.18)."""
    (kind,) = struct.unpack_from(">H", data, 8)
    if kind >= len(_PARAMETERS):
        raise UnknownProfile("has a curve of an unknown kind")
    given = [value / 65536 for value in struct.unpack_from(f">{_PARAMETERS[kind]}i", data, 12)]
    g, a, b, c, d, e, f = (given + [1.0, 0.0, 0.0, 0.0, 0.0, 0.0][len(given) - 1 :])[:7]
    if kind in (1, 2):  # the third numbers are offsets there, and the border is where the power begins
        e = f = c if kind == 2 else 0.0
        c, d = 0.0, -b / a if a else 0.0
    return lambda share: np.where(share >= d, np.maximum(a * share + b, 0.0) ** g + e, c * share + f)
