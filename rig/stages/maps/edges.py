"""Which pixels of a correspondence map lie away from edges, where coordinates are biased."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.structured_light.correspondence import Correspondence

_EDGE_SHARE = 0.005
"""Pixels nearer than this to an edge do not enter the geometry, as a share of the picture's width."""
_LEAST_INSIDE = 0.2
"""Where fewer of the refined pixels lie inside than this share, all of them are used."""
_AROUND_SHARE, _HOLE_SHARE = 0.1, 0.014
"""Of the picture's width: what counts as around a pixel, and the widest hole that is no edge: a window of
:func:`calibration.structured_light.subpixel.refine_subpixel` reaches across it."""


def inside_and_beside(correspondence: Correspondence) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Pixels away from edges of the picture and of surfaces, and those beside: there coordinates are biased.

    At such edges the refinement keeps integer codes, so these tell where the edges are. But noise and glare leave
    holes and integer codes all over a dim wall or a strip of floor, of which then nothing would be inside. Around a
    pixel where hardly any is, only the rim of what was decoded is an edge.
    """
    refined = correspondence.valid & ~_is_whole(correspondence.projector_xy_px)
    inside = _away_from_edges(refined)
    if inside.any():
        scarce = _around(inside) <= _LEAST_INSIDE * _around(refined)
        inside |= refined & scarce & _away_from_edges(_without_holes(correspondence.valid))
    if inside.sum() <= _LEAST_INSIDE * refined.sum():
        return refined, np.zeros_like(inside)
    return inside, refined & ~inside


def _is_whole(xy_px: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) pixels whose code was not refined."""
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(xy_px * 2 - np.round(xy_px * 2)) < 1e-6).all(axis=-1))


def _away_from_edges(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    square = np.ones((2 * round(_EDGE_SHARE * mask.shape[1]) + 1,) * 2, np.uint8)
    return np.asarray(cv2.erode(mask.astype(np.uint8), square, borderValue=0) > 0)


def _without_holes(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    square = np.ones((2 * (round(_HOLE_SHARE * mask.shape[1]) // 2) + 1,) * 2, np.uint8)
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, square) > 0)


def _around(mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """How many pixels of a mask lie around each pixel."""
    side = 2 * (round(_AROUND_SHARE * mask.shape[1]) // 2) + 1
    return np.asarray(
        cv2.boxFilter(mask.astype(np.float32), -1, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT)
    )
