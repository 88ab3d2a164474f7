"""Pictures that tell of a light transport: lit blocks, halves, least certain directions; and those that people show."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.stages.transport.prior import LitPatches

FloatArray = NDArray[np.float64]

_BLOCKS = (6, 8)
"""Rows and columns of blocks that are lit one at a time."""
_HALVES = 8
"""Steps of the halves along each axis, as many as there are Walsh functions."""
_ORDERS = 4
"""Of them, those that are shown: finer ones tell of less than a patch."""
_USUAL, _SEED = 24, 5
"""Pictures as people show them, drawn by chance: soft ones, and such with edges."""


@dataclass(frozen=True, eq=False, kw_only=True)
class KnownPicture:
    """A picture of black and white that can be shown."""

    kind: str
    """`block`, `halves` or `least certain`."""
    image: NDArray[np.bool_]
    """(height, width)"""


def fixed_pictures(shape: tuple[int, int]) -> list[KnownPicture]:
    """Return blocks and halves of a projector's picture."""
    blocks = [KnownPicture(kind="block", image=image) for image in _blocks(shape)]
    return blocks + [KnownPicture(kind="halves", image=image) for image in _halves(shape)]


def _blocks(shape: tuple[int, int]) -> Iterator[NDArray[np.bool_]]:
    rows, columns = (np.arange(size) * count // size for size, count in zip(shape, _BLOCKS, strict=True))
    for row in range(_BLOCKS[0]):
        for column in range(_BLOCKS[1]):
            yield (rows[:, None] == row) & (columns == column)


def _halves(shape: tuple[int, int]) -> Iterator[NDArray[np.bool_]]:
    """Products of Walsh functions along both axes, where they are above 0."""
    walsh = _walsh(_HALVES)
    down, along = (walsh[:, np.arange(size) * _HALVES // size] for size in shape)
    for i in range(_ORDERS):
        for k in range(_ORDERS):
            if i or k:
                yield np.outer(down[i], along[k]) > 0


def _walsh(count: int) -> FloatArray:
    """(count, count) Hadamard's matrix, its rows by how often their sign changes."""
    matrix = np.ones((1, 1))
    while len(matrix) < count:
        matrix = np.block([[matrix, matrix], [matrix, -matrix]])
    return np.asarray(matrix[np.argsort((np.diff(matrix, axis=1) != 0).sum(axis=1))])


def of_patches(lit_shares: FloatArray, lit: LitPatches, shape: tuple[int, int]) -> list[KnownPicture]:
    """Return pictures (J, L) of patches, lit where a pixel falls on one that is."""
    images = ((each[lit.owner] > 0) & (lit.owner >= 0) for each in lit_shares)
    return [KnownPicture(kind="least certain", image=image.reshape(shape)) for image in images]


def usual_pictures(shape: tuple[int, int]) -> FloatArray:
    """Return (n pixels, J) linear light of pictures as people show them."""
    generator = np.random.default_rng(_SEED)
    pictures = []
    for nth in range(_USUAL):
        few = generator.uniform(size=((2, 3), (4, 5), (9, 12))[nth % 3]).astype(np.float32)
        smooth = cv2.resize(few, shape[::-1], interpolation=cv2.INTER_CUBIC)
        picture = np.clip(smooth, 0, 1) ** 2 if nth % 2 else (smooth > 0.5).astype(np.float32)
        pictures.append(picture.ravel().astype(np.float64))
    return np.stack(pictures, axis=1)
