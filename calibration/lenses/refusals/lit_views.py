"""Whether what the projector is said to light on the boards can be boards at all, before a lens is fitted to it."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.lenses.bundle import row_slices
from calibration.lenses.records import BoardSightings

_LEAST_CORNERS = 8
"""Of a view that is judged: four say nothing of whether they are a board's."""
_STILL_PX = 1.0
"""Thinnest extent of a board in the projector's picture (rms): one that is lit edge on has more."""
_UNLIKE = 0.1
"""Of a board's extent, median miss of the best plane: a lens of 100 degrees and a bent board leave 0.03."""
_NAMED = 3
"""Views that a message names."""
_STILL, _OTHER, _MIRRORED = "still", "other", "mirrored"
_WORDS = {
    _STILL: (
        "all corners have nearly one projector pixel, or lie on a line of its picture: it showed the same picture "
        "throughout, or stripes of one direction only"
    ),
    _OTHER: (
        "the projector's pixels do not lie as a board does: photographs are in another order than the list says, show "
        "other patterns, or the board moved between them"
    ),
    _MIRRORED: (
        "the projector's pixels run the other way round than the camera's: one of the pictures is mirrored, by rear "
        "projection, by the projector's menu or by whoever saved the photographs"
    ),
}


def refuse_unlike_boards(sightings: BoardSightings, names: tuple[str, ...]) -> None:
    """Refuse sightings most of whose views have projector pixels that no lens could give to a board.

    Parameters
    ----------
    sightings : BoardSightings
        Rows in the order of their views.
    names : tuple of str
        Of the views, for the message; may be empty.

    Raises
    ------
    CalibrationError
        With the views and the cause.
    """
    judged = dict(_judged(sightings))
    for kind, words in _WORDS.items():
        bad = [view for view, found in judged.items() if found == kind]
        if bad and 2 * len(bad) > len(judged):
            which = ", ".join(names[view] if names else str(view + 1) for view in bad[:_NAMED])
            more = ", ..." if len(bad) > _NAMED else ""
            raise CalibrationError(
                f"in {len(bad)} of {len(judged)} views ({which}{more}) {words}; put that right and take these views "
                "again, or mend the list of photographs"
            )


def _judged(sightings: BoardSightings) -> Iterator[tuple[int, str | None]]:
    """Views with enough corners, and what is wrong with them."""
    for view, rows in row_slices(sightings.view, sightings.views):
        lit = sightings.projector_weight[rows] > 0
        if lit.sum() >= _LEAST_CORNERS:
            board, seen = sightings.board_m[rows][lit], sightings.camera_xy_px[rows][lit]
            yield view, _wrong_with(board, seen, sightings.projector_xy_px[rows][lit])


def _wrong_with(board_m: FloatArray, seen_px: FloatArray, lit_px: FloatArray) -> str | None:
    extent = np.linalg.svd(lit_px - lit_px.mean(axis=0), compute_uv=False) / np.sqrt(len(lit_px))
    if extent[1] < _STILL_PX:
        return _STILL
    plane = cv2.findHomography(board_m, lit_px, cv2.LMEDS)[0]  # a few misread corners do not matter
    if np.shape(plane) != (3, 3):  # nothing was found
        return _OTHER
    mapped = np.column_stack([board_m, np.ones(len(board_m))]) @ plane.T
    miss = np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - lit_px, axis=1)
    if np.median(miss) > _UNLIKE * extent[0]:
        return _OTHER
    return _MIRRORED if handedness(board_m, seen_px) * handedness(board_m, lit_px) < 0 else None


def handedness(board_m: FloatArray, xy_px: FloatArray) -> float:
    """Sign of the area that a picture gives to the board's; 0 where corners are too few, or on a line.

    Parameters
    ----------
    board_m, xy_px : (N, 2)
        Corners on the board and in the picture.
    """
    if len(board_m) < 4:
        return 0.0
    terms = np.column_stack([board_m, np.ones(len(board_m))])
    return float(np.sign(np.linalg.det(np.linalg.lstsq(terms, xy_px, rcond=None)[0][:2])))
