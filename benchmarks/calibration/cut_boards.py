"""Chessboards that all four sides of the picture cut: corners found, how far off, and whether numbered as a board.

    python benchmarks/calibration/cut_boards.py

Rendered views (those of the tests) of boards of 13 x 10 and 20 x 15 corners, cut within their first, second and third
square. Status 1 if one is numbered otherwise than as the board or a turn of it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[2]))

from calibration.lenses.boards import Board
from calibration.lenses.detection import Detection, detect_board
from calibration.lenses.lens import project_points
from tests.calibration.lenses.board_world import CAMERA, photograph, printed, stand, truth

BOARDS = (
    Board(kind="chessboard", columns=13, rows=10, square_m=0.02),
    Board(kind="chessboard", columns=20, rows=15, square_m=0.0125),
)
TURNS = ([[1, 0], [0, 1]], [[0, 1], [-1, 0]], [[-1, 0], [0, -1]], [[0, -1], [1, 0]])
VIEWS = 6
FloatArray = NDArray[np.float64]


def main() -> int:
    """Print a row for each view."""
    print("board    view  square  found  of  worst off  numbered")
    wrong = 0
    for board in BOARDS:
        state = truth(VIEWS, board=board)
        rendered = printed(board)
        for view in range(VIEWS):
            whole = photograph(stand(state, view, rendered))
            xy = project_points(CAMERA, board.points_m @ state.rotations[view][:, :2].T + state.translations_m[view])
            for square in (1, 2, 3):
                left, top, right, bottom = cut(xy.reshape(board.rows, board.columns, 2), square)
                found = detect_board(np.ascontiguousarray(whole[top:bottom, left:right]), board, 255)
                there = ((xy > (left + 6, top + 6)) & (xy < (right - 6, bottom - 6))).all(axis=1).sum()
                off_px, right_one = judged(found, xy - (left, top), board)
                wrong += not right_one
                row = f"{board.columns:3d} x {board.rows:2d} {view:4d} {square:7d} {len(found.ids):6d} {there:3d}"
                print(f"{row} {off_px:7.2f} px  {'right' if right_one else found.problem or 'WRONG'}", flush=True)
    print(f"\nnumbered wrong: {wrong}")
    return int(wrong > 0)


def cut(grid: FloatArray, square: int) -> tuple[int, int, int, int]:
    """Left, top, right, bottom within the so many-th square from each side."""
    ends = (square - 1, square), (-square - 1, -square)
    columns = [int(grid[:, list(k), 0].mean()) for k in ends]
    rows = [int(grid[list(k), :, 1].mean()) for k in ends]
    return max(columns[0], 0), max(rows[0], 0), columns[1], rows[1]


def judged(found: Detection, xy_px: FloatArray, board: Board) -> tuple[float, bool]:
    """Largest distance of a corner from a true one, and whether all are numbered as the board or a turn of it."""
    if not len(found.ids):
        return float("nan"), False
    apart = np.linalg.norm(found.xy_px[:, None] - xy_px, axis=2)
    true = np.stack(np.divmod(apart.argmin(axis=1), board.columns))
    said = np.stack(np.divmod(found.ids, board.columns))
    turned = (said - np.array(turn) @ true for turn in TURNS)
    return float(apart.min(axis=1).max()), any(bool((np.ptp(steps, axis=1) == 0).all()) for steps in turned)


if __name__ == "__main__":
    sys.exit(main())
