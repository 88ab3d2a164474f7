"""Which pose of the board would help most: tried out in the normal matrix before anybody holds it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import cv2
import numpy as np

from calibration.arrays import FloatArray
from calibration.lenses.bundle import (
    SHARED,
    camera_points,
    linearise,
    normal_equations,
    only,
    projector_points,
)
from calibration.lenses.fit import Settled
from calibration.lenses.lens import FittedLens, ideal_coordinates, project_points
from calibration.lenses.records import BoardSightings, RigState
from calibration.lenses.uncertainty import FAR_M, Anchor, pixel_grid, point_slopes, points_at, safe_inverse

_PLACES = (0.15, 0.5, 0.85)
"""Of the board's middle in the picture, as shares of its width and height."""
_TILTS_DEG = (-35.0, 0.0, 35.0)
"""About the vertical and the horizontal axis: steeper, and corners are seen poorly."""
_DISTANCES = (0.7, 1.0, 1.6)
"""Of the board, as shares of the median so far."""
_MARGIN_PX = 4.0
_LEAST_INSIDE = 0.6
"""Of the corners in the picture: with fewer the pose is hardly held."""
_WORDS = (("upper", "middle", "lower"), ("left", "middle", "right"))


@dataclass(frozen=True, kw_only=True)
class NextPose:
    """A pose of the board, and what it would bring."""

    x_share: float
    """Of the board's middle in the camera's picture, as a share of its width."""
    y_share: float
    distance_m: float
    tilt_x_deg: float
    """About the horizontal axis; positive: its upper edge is nearer."""
    tilt_y_deg: float
    """About the vertical axis; positive: its left edge is farther."""
    sigma_before_px: float
    """RMS over the pictures of the projection's standard deviation, now ..."""
    sigma_after_px: float
    """... and with this view."""

    @property
    def words(self) -> str:
        """The pose in words."""
        row, column = (_WORDS[k][_PLACES.index(share)] for k, share in enumerate((self.y_share, self.x_share)))
        place = "middle" if row == column == "middle" else f"{row} {column}".replace("middle ", "")
        edges = [
            f"{name} edge {abs(tilt):.0f} degrees nearer"
            for tilt, names in ((self.tilt_x_deg, ("upper", "lower")), (self.tilt_y_deg, ("right", "left")))
            for name in [names[0] if tilt > 0 else names[1]]
            if tilt
        ]
        turned = " and ".join(edges) or "facing the camera"
        return f"board in the {place} of the camera's picture, {self.distance_m:.2f} m away, {turned}"


def suggest_pose(settled: Settled, camera: FittedLens, projector: FittedLens | None) -> NextPose | None:
    """Return the pose that lowers the uncertainty of projection most, both devices together.

    Parameters
    ----------
    settled : Settled
    camera, projector : FittedLens
        Its lenses.

    Returns
    -------
    NextPose or None
        None when no pose that was tried lies in the pictures.
    """
    information = settled.equations().reduced()[0].sum(axis=0)
    wanted = _wanted(settled, camera, projector)
    before = _sigma(information, wanted)
    best: NextPose | None = None
    for place, tilt, share in product(product(_PLACES, _PLACES), product(_TILTS_DEG, _TILTS_DEG), _DISTANCES):
        added = _information_of(settled, camera, projector, place=place, tilt=tilt, share=share)
        if added is None:
            continue
        after = _sigma(information + added[0], wanted)
        if best is None or after < best.sigma_after_px:
            best = NextPose(
                x_share=place[0],
                y_share=place[1],
                distance_m=added[1],
                tilt_x_deg=tilt[0],
                tilt_y_deg=tilt[1],
                sigma_before_px=before,
                sigma_after_px=after,
            )
    return best


def _wanted(settled: Settled, camera: FittedLens, projector: FittedLens | None) -> FloatArray:
    """(M, p) how the pixels of both pictures move with the free unknowns."""
    anchor = Anchor.of(settled.sightings, settled.state)
    motion = anchor.motion_by_shared()
    rows = []
    for lens, in_projector in ((camera, False), (projector, True)):
        if lens is None:
            continue
        grid, _ = pixel_grid(lens.width_px, lens.height_px, columns=8)
        points = points_at(settled.state, grid, FAR_M, in_projector=in_projector)
        slopes = point_slopes(settled.state, points[np.isfinite(points).all(axis=1)], in_projector=in_projector)
        rows.append((slopes.by_shared + slopes.by_motion @ motion).reshape(-1, SHARED))
    return np.concatenate(rows)[:, settled.free]


def _sigma(information: FloatArray, wanted: FloatArray) -> float:
    return float(np.sqrt(2 * np.einsum("mi,ij,mj->m", wanted, safe_inverse(information), wanted).mean()))


def _information_of(
    settled: Settled,
    camera: FittedLens,
    projector: FittedLens | None,
    *,
    place: tuple[float, float],
    tilt: tuple[float, float],
    share: float,
) -> tuple[FloatArray, float] | None:
    """(p, p) information of a view that is not there yet, and its distance; None when it is not in the picture."""
    distance_m = share * float(np.median(np.linalg.norm(settled.state.translations_m, axis=1)))
    board = _whole_board(settled.sightings)
    pixel = np.array([[place[0] * (camera.width_px - 1), place[1] * (camera.height_px - 1)]])
    ideal, there = ideal_coordinates(camera.vector, pixel)
    if not there[0]:
        return None
    about_x, about_y = (cv2.Rodrigues(np.radians(v))[0] for v in ([tilt[0], 0.0, 0.0], [0.0, tilt[1], 0.0]))
    turn: FloatArray = np.asarray(about_y @ about_x, dtype=np.float64)
    ray = np.array([*ideal[0], 1.0])
    centre = np.array([*board.half_size_m, 0.0])
    state = replace(
        settled.state,
        rotations=turn[None],
        translations_m=(ray / np.linalg.norm(ray) * distance_m - turn @ centre)[None],
    )
    return _of_view(settled, board, state, camera=camera, projector=projector), distance_m


def _of_view(
    settled: Settled, board: BoardSightings, state: RigState, *, camera: FittedLens, projector: FittedLens | None
) -> FloatArray:
    points = camera_points(board, state)
    inside = _inside(project_points(camera.vector, points), points, camera)
    p = int(settled.free.sum())
    if inside.mean() < _LEAST_INSIDE:
        return np.zeros((p, p))
    lit = np.zeros(len(points))
    if projector is not None:
        in_projector = projector_points(points, state)
        lit = 1.0 * _inside(project_points(projector.vector, in_projector), in_projector, projector)
    devices = np.column_stack([inside / settled.noise_px[0] ** 2, inside * lit / settled.noise_px[-1] ** 2])
    shown = replace(board, projector_weight=lit)
    lines = only(linearise(shown, state), settled.free)
    weight = devices[:, : lines.residual.shape[1] // 2]
    return np.asarray(normal_equations(lines, weight, shown.view, 1).reduced()[0][0])


def _inside(xy_px: FloatArray, points: FloatArray, lens: FittedLens) -> np.ndarray:
    size = np.array([lens.width_px, lens.height_px]) - 1 - _MARGIN_PX
    return np.asarray(((xy_px > _MARGIN_PX) & (xy_px < size)).all(axis=1) & (points[:, 2] > 0))


def _whole_board(sightings: BoardSightings) -> BoardSightings:
    """One view of all corners that were seen in any."""
    corners = np.unique(sightings.board_m.round(9), axis=0)
    whole = BoardSightings.of_camera(np.zeros(len(corners), dtype=np.int64), corners, np.zeros((len(corners), 2)))
    return replace(whole, half_size_m=sightings.half_size_m)
