"""Light along the faces of a room: smoothed within each, taken away from their edges, averaged over patches."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, FloatArray
from calibration.errors import CalibrationError

EDGE_PX = 3
"""Camera pixels beside the edge of a wall that do not tell its reflectance: a blur of 1.2 px reaches so far."""
_BESIDE = np.ones((2 * EDGE_PX + 1,) * 2, dtype=np.uint8)

_NEAR = 1e-6
"""Weight of a Gaussian's sum beyond which there are pixels near: five standard deviations away there are none."""
_LEAST_ON_MODEL = 0.3
"""Of the lit pixels: random rooms of which only two walls were seen had 0.58 and more."""


class PatchCounts(NamedTuple):
    """How many patches there are, and how many pixels one needs before its mean counts."""

    n_patches: int
    least_pixels: int | NDArray[np.integer]


def away_from_edges(face: NDArray[np.integer]) -> BoolArray:
    """Return (H, W) pixels into which the lens mixes no light of another face, of the face (H, W) that each sees."""
    numbers = face.astype(np.float32)
    return np.asarray(cv2.dilate(numbers, _BESIDE) == cv2.erode(numbers, _BESIDE))


def beside_edges(face: NDArray[np.integer], whole: BoolArray) -> BoolArray:
    """Return (H, W) pixels as near to an edge of a wall, or to pixels that are not `whole`, as the lens mixes light."""
    near = cv2.erode(whole.astype(np.uint8), _BESIDE, borderValue=1) == 0
    return np.asarray(near | ~away_from_edges(face))


def beside_things(face: NDArray[np.integer], n_walls: int) -> BoolArray:
    """Return (H, W) pixels beside an edge of what stands before the walls, or of nothing, on either side of it.

    Parameters
    ----------
    face : (H, W)
        That each pixel sees: walls first, -1 for none.
    n_walls : int
        How many of them are walls.
    """
    thing = cv2.dilate(((face < 0) | (face >= n_walls)).astype(np.uint8), _BESIDE) > 0
    return np.asarray(thing & ~away_from_edges(face))


def on_model_of(lit: BoolArray, on_model: BoolArray) -> BoolArray:
    """Return the lit pixels (H, W) that see in the model what their code says; a model with few of them is refused.

    Raises
    ------
    CalibrationError
        With their share, and what may be wrong.
    """
    share = float(on_model[lit].mean()) if lit.any() else 0.0
    if not share >= _LEAST_ON_MODEL:
        raise CalibrationError(
            f"only {100 * share:.0f} % of the lit pixels see in the model of the room what their code says, at least "
            f"{100 * _LEAST_ON_MODEL:.0f} % are needed: walls stand in it where no wall is; check surface.size_m, "
            "remove what stands before the walls, or show more of them"
        )
    return np.asarray(lit & on_model)


def smoothed_along_faces(
    values: FloatArray, lit: BoolArray, face: NDArray[np.integer], share_of_width: float, told: BoolArray | None = None
) -> FloatArray:
    """Return (H, W) means of values around each lit pixel over the lit pixels of its face; 0 where not lit.

    Parameters
    ----------
    values, lit, face : (H, W)
    share_of_width : float
        Spread of the smoothing, of the picture's width.
    told : (H, W), optional
        Pixels whose values count, where a face has any; default: all that are lit. Far from them a pixel keeps its own.
    """
    smooth, sigma_px = np.zeros(lit.shape), share_of_width * lit.shape[1]
    for k in np.unique(face[lit]):
        on = lit & (face == k)
        of = on if told is None or not (on & told).any() else on & told
        weight = cv2.GaussianBlur(of.astype(np.float64), (0, 0), sigma_px)
        total = cv2.GaussianBlur(np.where(of, values, 0.0), (0, 0), sigma_px)
        mean = np.where(weight > _NEAR, total / np.maximum(weight, _NEAR), values)
        smooth = np.where(on, mean, smooth)
    return smooth


def patch_means(values: FloatArray, patch: NDArray[np.integer], chosen: BoolArray, counts: PatchCounts) -> FloatArray:
    """Return (P,) means over each patch's chosen pixels, of values, patches and choice (N,); NaN where too few."""
    index = patch[chosen]
    count = np.bincount(index, minlength=counts.n_patches)
    total = np.bincount(index, values[chosen], minlength=counts.n_patches)
    return np.where(count >= counts.least_pixels, total / np.maximum(count, 1), np.nan)
