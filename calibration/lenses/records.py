"""What was seen of boards, and what lenses and poses explain it: frozen records of arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.arrays import BoolArray, FloatArray, IntArray
from calibration.errors import CalibrationError
from calibration.lenses.lens import FittedLens

FLEX = 3
"""Parameters of a board's bend: how far its middle stands out along x and along y, and how far twist lifts its first
corner. A board bends along any direction, and one along its diagonal is the three together."""
POSE = 6
"""A rotation vector and a translation."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardSightings:
    """Corners of boards as a camera, and where it lights them a projector, sees them; one row a corner and view."""

    view: IntArray
    """(N,) number of the view, rising from 0."""
    board_m: FloatArray
    """(N, 2) place on the flat board."""
    camera_xy_px: FloatArray
    """(N, 2) where the camera sees it."""
    camera_weight: FloatArray
    """(N,) inverse of the relative standard deviation; 0: not seen."""
    projector_xy_px: FloatArray
    """(N, 2) projector pixel at ``camera_xy_px``."""
    projector_by_camera: FloatArray
    """(N, 2, 2) how the projector's pixel moves with the camera's; 0 where both were found independently."""
    projector_weight: FloatArray
    """(N,) inverse of the relative standard deviation; 0: no projector pixel."""
    half_size_m: tuple[float, float]
    """Half of the board's width and height, for its bend."""

    @classmethod
    def of_camera(
        cls,
        view: IntArray,
        board_m: FloatArray,
        xy_px: FloatArray,
        weight: FloatArray | None = None,
    ) -> BoardSightings:
        """Make them for a camera alone.

        Parameters
        ----------
        view : (N,)
            Number of the view of each corner.
        board_m : (N, 2)
            Place of each corner on the board. [m]
        xy_px : (N, 2)
            Where the camera sees it. [px]
        weight : (N,), optional
            Inverse of each corner's relative standard deviation.

        Returns
        -------
        BoardSightings
            The board's half size is that of its outermost corners seen.
        """
        n = len(view)
        return cls(
            view=np.asarray(view, dtype=np.int64),
            board_m=board_m,
            camera_xy_px=xy_px,
            camera_weight=np.ones(n) if weight is None else weight,
            projector_xy_px=np.zeros((n, 2)),
            projector_by_camera=np.zeros((n, 2, 2)),
            projector_weight=np.zeros(n),
            half_size_m=_half_size(board_m),
        )

    def __post_init__(self) -> None:
        if (np.diff(self.view) < 0).any():
            raise CalibrationError("rows of boards are not in the order of their views; sort them by view")

    @property
    def views(self) -> int:
        """Number of views."""
        return int(self.view.max()) + 1 if len(self.view) else 0

    @property
    def has_projector(self) -> bool:
        """Whether a projector was seen at all."""
        return bool((self.projector_weight > 0).any())

    @property
    def centred_m(self) -> FloatArray:
        """(N, 2) places on the board from its middle."""
        return np.asarray(self.board_m - np.array(self.half_size_m))

    def rows(self, chosen: BoolArray | IntArray) -> BoardSightings:
        """Return some rows, their views renumbered without gaps.

        Parameters
        ----------
        chosen : (N,) bool, or int
            Which rows.

        Returns
        -------
        BoardSightings
        """
        _, view = np.unique(self.view[chosen], return_inverse=True)
        return replace(
            self,
            view=view.astype(np.int64),
            board_m=self.board_m[chosen],
            camera_xy_px=self.camera_xy_px[chosen],
            camera_weight=self.camera_weight[chosen],
            projector_xy_px=self.projector_xy_px[chosen],
            projector_by_camera=self.projector_by_camera[chosen],
            projector_weight=self.projector_weight[chosen],
        )

    def of_views(self, views: IntArray | list[int]) -> BoardSightings:
        """Return the rows of some views.

        Parameters
        ----------
        views : array or list of int
            Their numbers.

        Returns
        -------
        BoardSightings
        """
        return self.rows(np.isin(self.view, np.asarray(views)))

    def camera_only(self) -> BoardSightings:
        """Return the same without the projector.

        Returns
        -------
        BoardSightings
        """
        return replace(self, projector_weight=np.zeros(len(self.view)))


def _half_size(board_m: FloatArray) -> tuple[float, float]:
    half = np.abs(board_m).max(axis=0) / 2 if len(board_m) else np.ones(2)
    return float(half[0]), float(half[1])


@dataclass(frozen=True, eq=False, kw_only=True)
class RigState:
    """Lenses, poses and bend: all unknowns of a bundle adjustment."""

    camera: FloatArray
    """(12,) parameters of its lens."""
    projector: FloatArray
    """(12,); those of any lens when there is no projector."""
    projector_rotation: FloatArray
    """(3, 3) projector_from_camera."""
    projector_translation_m: FloatArray
    """(3,) projector_from_camera."""
    flex_m: FloatArray
    """(3,) how far the board stands out towards its z: its middle along x and along y, its first corner by twist."""
    rotations: FloatArray
    """(V, 3, 3) camera_from_board."""
    translations_m: FloatArray
    """(V, 3) camera_from_board, the board's origin at its first corner, were it flat."""
    stretch: float = 0.0
    """By what share the board's squares are longer down than across, about its middle: paper is fed unevenly. [1]"""

    def of_views(self, views: IntArray) -> RigState:
        """Return the same with the poses of some views only."""
        return replace(self, rotations=self.rotations[views], translations_m=self.translations_m[views])


@dataclass(frozen=True, eq=False, kw_only=True)
class LensCalibration:
    """Lenses from boards, with what is known of their errors."""

    camera: FittedLens
    projector: FittedLens | None
    state: RigState
    covariance: FloatArray
    """(S, S) of camera lens (12), projector lens (12), projector_from_camera (6: rotation vector on its left,
    translation), flex (3) and stretch (1); zero where a parameter was not free."""
    free: BoolArray
    """(S,) which of these were fitted."""
    information: FloatArray
    """(S, S) what the corners say of them, poses eliminated; its unit is one corner's variance."""
    sightings: BoardSightings
    used: BoolArray
    """(N, 2) rows that the fit rests on, for camera and projector."""
    residual_px: FloatArray
    """(N, 4) seen minus modelled: camera x, y, projector x, y; 0 where not seen."""
    noise_px: tuple[float, float]
    """Standard deviation of one coordinate of a corner, camera and projector."""
    excess: float
    """By what factor views scatter more than their corners' noise explains (variance); 1: the model fits. [1]"""

    def sigmas(self) -> FloatArray:
        """(S,) standard deviations."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))
