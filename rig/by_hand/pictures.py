"""Pictures to aim, focus and measure by: made in the projector's size, or read from a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.files.pictures import PictureCodes, cover, read_shown
from rig.profile.schema import Profile
from rig.profile.tables import ProjectorProfile

Codes = NDArray[np.uint8]

_SQUARES = 8
"""Squares, and lines of the grid, along the shorter side: each is large enough to be judged from where one stands."""
_STAR_SPOKES = 36
"""Bright spokes of a star: near its rim wide for any lens, at its middle finer than any pixel."""
_ARM_PX = 6
"""Half a cross: seen from a metre, and its middle is one pixel."""
_SPOTS_AT = ((0.15, 0.4), (0.85, 0.4))
"""Where spots are offered in a profile that has none: far apart, away from the edges; shares of width and height."""


def white(shape: tuple[int, int]) -> Codes:
    """Return all pixels at their brightest, (height, width)."""
    return np.full(shape, 255, np.uint8)


def black(shape: tuple[int, int]) -> Codes:
    """Return all pixels at their darkest, (height, width)."""
    return np.zeros(shape, np.uint8)


def grid(shape: tuple[int, int]) -> Codes:
    """Return lines one pixel wide, a frame around the picture, and a cross in its middle: for aim and shape."""
    height, width = shape
    side = max(2, min(shape) // _SQUARES)
    codes = black(shape)
    codes[height // 2 % side :: side] = 128
    codes[:, width // 2 % side :: side] = 128
    codes[[0, -1]] = codes[:, [0, -1]] = 255
    codes[height // 2] = codes[:, width // 2] = 255
    return codes


def checks(shape: tuple[int, int]) -> Codes:
    """Return squares of black and white: what lights up in the black ones is light of the white ones."""
    side = max(1, min(shape) // _SQUARES)
    y, x = np.indices(shape)
    return np.asarray(255 * ((y // side + x // side) % 2), np.uint8)


def stripes(shape: tuple[int, int]) -> Codes:
    """Return stripes of one, two, four and eight pixels, a band each, upright above and lying below."""
    height, width = shape
    y, x = np.indices(shape)
    period = 2 ** (1 + 4 * x // width)
    upright, lying = x // (period // 2) % 2, y // (period // 2) % 2
    return np.asarray(255 * np.where(y < height // 2, upright, lying), np.uint8)


def focus(shape: tuple[int, int]) -> Codes:
    """Return nine stars over the picture: the grey disk in the middle of each is as large as the blur."""
    height, width = shape
    y, x = np.indices(shape, dtype=np.float64)
    rows, columns = (3 * y // height + 0.5) * height / 3, (3 * x // width + 0.5) * width / 3
    spokes = np.sin(_STAR_SPOKES * np.arctan2(y + 0.5 - rows, x + 0.5 - columns)) > 0
    return np.asarray(255 * spokes, np.uint8)


PATTERNS: Mapping[str, Callable[[tuple[int, int]], Codes]] = {
    "white": white,
    "black": black,
    "grid": grid,
    "checks": checks,
    "stripes": stripes,
    "focus": focus,
}
"""Pictures by name, each from (height, width) in pixels; ``spots`` is one more, which the profile places."""
SPOTS = "spots"


def spots(projector: ProjectorProfile, spots_px: tuple[tuple[float, float], ...]) -> Codes:
    """Return crosses on black whose middles are the pixels (x, y) between which a tape is held.

    Raises
    ------
    UsageError
        One lies outside the picture.
    """
    codes = black(projector.shape)
    for x, y in spots_px:
        column, row = round(x), round(y)
        if not (0 <= column < projector.width_px and 0 <= row < projector.height_px):
            raise UsageError(
                f"spot ({x:g}, {y:g}) is outside the picture of {projector.width_px} x {projector.height_px} px; "
                "correct scale.spots_px in the profile"
            )
        top, left = max(row - _ARM_PX, 0), max(column - _ARM_PX, 0)
        codes[top : row + _ARM_PX + 1, column] = 255
        codes[row, left : column + _ARM_PX + 1] = 255
    return codes


def spots_of(profile: Profile) -> tuple[tuple[float, float], ...]:
    """Return the pixels (x, y) of the profile's tape step, or two to begin with where it names none."""
    named = next((scale.spots_px for scale in profile.scales if scale.spots_px is not None), None)
    if named is not None:
        return named
    projector = profile.projector
    return tuple((float(round(x * projector.width_px)), float(round(y * projector.height_px))) for x, y in _SPOTS_AT)


def picture_named(name: str, profile: Profile, *, fit: bool = False) -> PictureCodes:
    """Return what a projector is to show: a picture of :data:`PATTERNS`, the spots of the tape step, or a file's.

    Parameters
    ----------
    name
        Of a pattern, or path of a file; its codes are shown as they are, as any program would, of sRGB.
    profile
        Of the rig.
    fit
        Scale and crop a file of another size.

    Returns
    -------
    PictureCodes
        (H, W) or (H, W, 3) of the projector's shape.

    Raises
    ------
    UsageError
        There is no such pattern and no such file; the file cannot be read, or has another size.
    """
    projector = profile.projector
    if name == SPOTS:
        return PictureCodes(codes=spots(projector, spots_of(profile)))
    if name in PATTERNS:
        return PictureCodes(codes=PATTERNS[name](projector.shape))
    path = Path(name)
    if not path.is_file():
        known = ", ".join((*PATTERNS, SPOTS))
        raise UsageError(f"{name}: neither a picture's file nor a pattern; the patterns are {known}")
    read = read_shown(path)
    codes = read.codes
    if codes.shape[:2] != projector.shape and not fit:
        raise UsageError(
            f"{path}: {codes.shape[1]} x {codes.shape[0]} px, but the projector has {projector.width_px} x "
            f"{projector.height_px} px; resize the picture, or add --fit to crop and scale it"
        )
    return replace(read, codes=np.ascontiguousarray(cover(codes, projector.shape, cv2.INTER_CUBIC)))
