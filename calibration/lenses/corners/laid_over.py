"""Corners of boards, and middles of circles, refined by laying the board's own print over the picture.

What is printed around a corner is known, so the picture of it, blurred as the photograph is and moved until it fits,
uses every pixel of the edges that meet there (B. D. Lucas and T. Kanade, An iterative image registration technique,
IJCAI 1981): corners scatter by 0.005 px where gradients alone leave 0.03, and 0.05 to 0.2 beside markers, whose edges
pull them aside; and a circle's middle is where it is, not that of the ellipse that is seen of a tilted one.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray, FloatArray, Frame, IntArray
from calibration.lenses.boards import Board
from calibration.lenses.corners.prints import Print, print_of

_HALF_SQUARE, _LEAST_PX, _LARGEST_PX = 0.45, 4.0, 30.0
"""Half of the window that is laid over the picture."""
_NEIGHBOURS = 9
"""Corners that say how the print lies around one of them: a lens bends little over so few squares."""
_SINGULAR = 1e12
"""Condition of a mapping that is none; of boards before a camera it is some thousands, for metres become pixels."""
_ROUNDS, _STEPS = 2, 12
_NEAR_PX = 1e-3
_FARTHEST = 0.3
"""Squares by which a corner is moved at most."""
_MISFIT, _LEAST_MISFIT = 3.0, 0.1
"""Of the median misfit, and share of the contrast: beyond both a finger, glare or the rim of a light lies there."""
_FITTING = 0.5


@dataclass(frozen=True, eq=False)
class _Window:
    """Part of a photograph around a corner."""

    seen: FloatArray
    x: FloatArray
    y: FloatArray


def refined_by_print(
    photograph: Frame, board: Board, ids: IntArray, xy_px: FloatArray, *, square_px: float, edge_px: float
) -> tuple[IntArray, FloatArray]:
    """Move corners to where the board's print fits best, and leave out those where it does not fit.

    Where it fits at fewer than half of them the board is printed in another way: all stay as they are.

    Parameters
    ----------
    photograph : (H, W)
        Levels that rise with light. [dn]
    board : Board
    ids : (N,)
        Numbers of the corners that were found.
    xy_px : (N, 2)
        Where; to a quarter of a square.
    square_px : float
        Side of a square in the photograph.
    edge_px : float
        Width of an edge from dark to bright.

    Returns
    -------
    (M,), (M, 2)
        Numbers and places of the corners that fit.
    """
    picture = photograph.astype(np.float32)
    printed = print_of(picture, board, xy_px, square_px=square_px, edge_px=edge_px)
    half = float(np.clip(_HALF_SQUARE * square_px, _LEAST_PX, _LARGEST_PX))
    found_px = xy_px
    places, fits = board.points_m[ids], np.ones(len(ids), dtype=bool)
    for _ in range(_ROUNDS):
        moved, misfit = xy_px.copy(), np.full(len(ids), np.inf)
        for k in np.flatnonzero(fits):
            around = _around(places, xy_px, int(k), fits)
            if around is not None:
                moved[k], misfit[k] = _laid_over(picture, printed, around, places[k], half_px=half)
        far = np.linalg.norm(moved - xy_px, axis=1) > _FARTHEST * square_px
        usual = float(np.median(misfit[fits])) if fits.any() else 0.0
        fits &= np.isfinite(misfit) & ~far & (misfit < max(_MISFIT * usual, _LEAST_MISFIT))
        xy_px = np.where(fits[:, None], moved, xy_px)
    if fits.mean() < _FITTING:
        return ids, found_px
    return ids[fits], xy_px[fits]


def _around(places: FloatArray, xy_px: FloatArray, k: int, fits: BoolArray) -> FloatArray | None:
    """(3, 3) from the board to pixels around a corner; None where its neighbours do not say it."""
    apart = np.where(fits, np.linalg.norm(places - places[k], axis=1), np.inf)
    near = np.argsort(apart, kind="stable")[: min(_NEIGHBOURS, int(fits.sum()))]
    if len(near) < 4 or np.linalg.matrix_rank(places[near] - places[near].mean(axis=0), tol=1e-6) < 2:
        return None
    found = np.asarray(cv2.findHomography(places[near], xy_px[near], 0)[0], dtype=np.float64)
    return found if found.shape == (3, 3) and np.linalg.cond(found) < _SINGULAR else None


def _laid_over(
    picture: NDArray[np.float32], printed: Print, pixel_from_board: FloatArray, place_m: FloatArray, *, half_px: float
) -> tuple[FloatArray, float]:
    """Where a corner of the board is in the picture, and how far the print is from it there, by its contrast."""
    start = np.array(_mapped(pixel_from_board, *place_m))
    window = _window(picture, start, half_px)
    texel_from_pixel = printed.texel_from_board @ np.linalg.inv(pixel_from_board)
    shift, misfit = np.zeros(2), np.inf
    if window is None:
        return start, misfit
    for _ in range(_STEPS):
        u, v = (
            texel.astype(np.float32) for texel in _mapped(texel_from_pixel, window.x - shift[0], window.y - shift[1])
        )
        model, asked = (
            cv2.remap(layer, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
            for layer in (printed.picture, printed.asked)
        )
        step, misfit = _step(window, model, asked)
        shift = shift + step
        if np.abs(shift).max() > half_px or np.abs(step).max() < _NEAR_PX:
            break
    return start + shift, misfit


def _mapped(matrix: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    across, down, far = (row[0] * x + row[1] * y + row[2] for row in matrix)
    return across / far, down / far


def _window(picture: NDArray[np.float32], middle: FloatArray, half: float) -> _Window | None:
    """Part of the picture around a pixel; None at its rim."""
    height, width = picture.shape
    left, top = np.maximum(np.rint(middle - half).astype(int), 0)
    right, bottom = np.minimum(np.rint(middle + half).astype(int) + 1, (width, height))
    if right - left < 1.5 * half or bottom - top < 1.5 * half:
        return None
    y, x = np.mgrid[top:bottom, left:right].astype(np.float64)
    return _Window(picture[top:bottom, left:right].astype(np.float64), x, y)


def _step(window: _Window, model: FloatArray, asked: FloatArray) -> tuple[FloatArray, float]:
    """Shift by which the print fits better, and how far off it is as it lies: rms as a share of its contrast.

    Contrast, and a light that rises across the window, are found beside the shift.
    """
    down, across = np.gradient(model)
    root = np.sqrt(asked.ravel())
    light = [model, np.ones_like(model), window.x - window.x.mean(), window.y - window.y.mean()]
    design = np.stack([column.ravel() for column in (*light, -across, -down)], axis=1) * root[:, None]
    wanted = window.seen.ravel() * root
    found = np.linalg.lstsq(design, wanted, rcond=None)[0]
    if not found[0]:
        return np.zeros(2), np.inf
    rest = wanted - design @ found
    # A chessboard's first square may be black or white: contrast has either sign.
    return found[4:] / found[0], float(np.sqrt((rest**2).sum() / max(root.sum(), 1.0)) / abs(found[0]))
