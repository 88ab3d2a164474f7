"""Boards whose corners are known: chessboards, ChArUco boards, grids of circles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError

BoardKind = Literal["chessboard", "charuco", "circles", "asymmetric-circles"]
LEAST_SQUARE_M, LARGEST_SQUARE_M = 0.0005, 0.5
"""Squares of a board that people print: outside, the unit is mistaken."""


@dataclass(frozen=True, kw_only=True)
class Board:
    """A flat board with corners, or centres of circles, at known places."""

    kind: BoardKind
    columns: int
    """Chessboard: inner corners in a row; ChArUco: squares in a row; circles: circles in a row."""
    rows: int
    square_m: float
    """Side of a square; of circles the distance of neighbours in a row (asymmetric: half of it)."""
    marker_m: float = 0.0
    """Side of a ChArUco board's markers."""
    dictionary: str = "DICT_4X4_50"
    """OpenCV's name of a ChArUco board's markers."""
    legacy: bool = False
    """A ChArUco board with an even number of rows as OpenCV printed it before 4.6."""

    @property
    def points_m(self) -> FloatArray:
        """(M, 2) places of the corners on the board, in the order in which they are numbered."""
        columns, rows = (self.columns, self.rows) if self.kind != "charuco" else (self.columns - 1, self.rows - 1)
        row, column = np.divmod(np.arange(columns * rows), columns)
        if self.kind == "asymmetric-circles":
            column = 2 * column + row % 2
        return np.column_stack([column, row]) * float(self.square_m)

    @property
    def half_size_m(self) -> tuple[float, float]:
        """Half of the distance between the outermost corners, along columns and rows."""
        half = self.points_m.max(axis=0) / 2
        return float(half[0]), float(half[1])

    @property
    def words(self) -> str:
        """What it is, for messages."""
        what = {"chessboard": "inner corners", "charuco": "squares (ChArUco)"}.get(self.kind, "circles")
        return f"{self.columns} × {self.rows} {what}"

    def check(self) -> None:
        """Refuse a board that nobody prints.

        Raises
        ------
        CalibrationError
            Too few corners, or a size that is off by a unit.
        """
        if min(self.columns, self.rows) < 3:
            raise CalibrationError(f"a board of {self.words} is too small: it needs at least 3 in both directions")
        if not LEAST_SQUARE_M <= self.square_m <= LARGEST_SQUARE_M:
            factor = 1e-3 if self.square_m > LARGEST_SQUARE_M else 1e3
            raise CalibrationError(
                f"square_m = {self.square_m:g} metres, the limits are {LEAST_SQUARE_M:g} and {LARGEST_SQUARE_M:g}: "
                f"a unit is mistaken by 1000; write square_m = {self.square_m * factor:g} if the board was measured "
                f"in {'millimetres' if factor < 1 else 'kilometres'}"
            )
        if self.kind == "charuco" and not 0 < self.marker_m < self.square_m:
            raise CalibrationError(
                f"marker_m = {self.marker_m:g} has to lie between 0 and square_m = {self.square_m:g}; measure a marker"
            )

    def charuco(self) -> cv2.aruco.CharucoBoard:
        """Return OpenCV's board.

        Raises
        ------
        CalibrationError
            There is no such dictionary.
        """
        number = getattr(cv2.aruco, self.dictionary, None)
        if not isinstance(number, int) or not self.dictionary.startswith("DICT_"):
            known = sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))
            raise CalibrationError(f"dictionary {self.dictionary!r}: there are {', '.join(known)}")
        markers = cv2.aruco.getPredefinedDictionary(number)
        board = cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, self.marker_m, markers)
        board.setLegacyPattern(self.legacy)
        return board
