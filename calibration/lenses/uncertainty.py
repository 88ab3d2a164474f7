"""How well a calibrated device knows where a point is seen: noise carried through the fit, per pixel and distance.

After mrcal (D. Kogan, mrcal.secretsauce.net, "Projection uncertainty"): what counts is not the scatter of a focal
length but that of the pixel at which a fixed point is seen. A small turn and shift of the whole rig is no error of
its lenses, so the motion that brings the observed points back is taken off first; the same for two calibrations
that are compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.lenses.bundle import (
    CAMERA,
    PROJECTOR,
    RELATIVE,
    SHARED,
    NormalEquations,
    camera_points,
    cross_matrices,
    projector_points,
    weights_of,
)
from calibration.lenses.lens import ideal_coordinates, project_points, projection
from calibration.lenses.records import POSE, BoardSightings, RigState

FAR_M = 1e6
"""Distance that stands for infinity."""
_VIEWS_PER_UNKNOWN = 5
"""From so many views on, the scatter between views is known in every direction; below, as one factor."""
_NO_EXCESS = 1.3
"""Views scatter so much more than their corners by chance alone."""
_ALIGNMENTS = 12
_NOTHING = 1e-60
"""Information on an unknown that is none; its inverse, times what directions may gain by, is still a number."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Confidence:
    """What a fit says of its shared unknowns."""

    covariance: FloatArray
    """(S, S)"""
    information: FloatArray
    """(S, S) poses eliminated, in units of the noise."""
    excess: float
    """Scatter between views over what corner noise explains (variance). [1]"""


def confidence_of(equations: NormalEquations, free: BoolArray) -> Confidence:
    """Return the covariance of the shared unknowns.

    Corner noise gives the inverse of the information. If the views pull apart by more than that (a lens model that
    does not fit, a board that is not flat), the scatter between them counts instead: H. White, Econometrica 50 (1982);
    K.-Y. Liang and S. Zeger, Biometrika 73 (1986).

    Parameters
    ----------
    equations : NormalEquations
        At the solution, in units of the noise.
    free : (S,) bool
        Which unknowns these are.

    Returns
    -------
    Confidence
    """
    of_views, slopes, _ = equations.reduced()
    information = of_views.sum(axis=0) + np.diag(equations.prior)
    inverse = safe_inverse(information)
    expected = of_views - of_views @ inverse @ of_views
    freedom = float(np.einsum("ij,vji->", inverse, expected))
    excess = float(np.einsum("vi,ij,vj->", slopes, inverse, slopes)) / max(freedom, 1e-9)
    p, views = len(information), len(of_views)
    if excess > _NO_EXCESS and views >= _VIEWS_PER_UNKNOWN * p:
        covariance = inverse @ (slopes.T @ slopes) @ inverse * (p / freedom)
    else:
        covariance = inverse * max(1.0, excess)
    return Confidence(covariance=_spread(covariance, free), information=_spread(information, free), excess=excess)


def safe_inverse(information: FloatArray) -> FloatArray:
    """Return the inverse; directions that nothing determines get a huge variance, not none."""
    scale = 1 / np.sqrt(np.maximum(np.diag(information), _NOTHING))
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    whole = (vectors / np.maximum(values, 1e-15)) @ vectors.T
    return np.asarray(whole * np.outer(scale, scale))


def _spread(matrix: FloatArray, free: BoolArray) -> FloatArray:
    whole = np.zeros((SHARED, SHARED))
    whole[np.ix_(free, free)] = matrix
    return whole


@dataclass(frozen=True, eq=False)
class PointSlopes:
    """How pixels of fixed points move with the shared unknowns, and with a motion of the world."""

    by_shared: FloatArray
    """(N, 2, S)"""
    by_motion: FloatArray
    """(N, 2, 6) a turn about the camera's centre, and a shift."""


def point_slopes(state: RigState, points_m: FloatArray, *, in_projector: bool) -> PointSlopes:
    """Slopes of the pixels at which the camera or the projector has points of the camera's frame."""
    motion = np.concatenate([-cross_matrices(points_m), np.broadcast_to(np.eye(3), (len(points_m), 3, 3))], axis=2)
    shared = np.zeros((len(points_m), 2, SHARED))
    if not in_projector:
        seen = projection(state.camera, points_m)
        shared[..., CAMERA] = seen.by_lens
        return PointSlopes(shared, seen.by_point @ motion)
    lit = projection(state.projector, projector_points(points_m, state))
    shared[..., PROJECTOR] = lit.by_lens
    shared[..., RELATIVE][..., :3] = -lit.by_point @ cross_matrices(points_m @ state.projector_rotation.T)
    shared[..., RELATIVE][..., 3:] = lit.by_point
    return PointSlopes(shared, lit.by_point @ state.projector_rotation @ motion)


@dataclass(frozen=True, eq=False)
class Anchor:
    """The observed points, which say what motion of the rig goes along with a change of its lenses."""

    points_m: FloatArray
    """(N, 3) in the camera's frame."""
    weight: FloatArray
    """(N, devices)"""
    state: RigState

    @classmethod
    def of(cls, sightings: BoardSightings, state: RigState) -> Anchor:
        """Take the corners of a fit."""
        return cls(camera_points(sightings, state), weights_of(sightings), state)

    def motion_by_shared(self) -> FloatArray:
        """(6, S) turn and shift that bring the points back to their pixels, per change of each unknown."""
        normal, mixed = np.zeros((POSE, POSE)), np.zeros((POSE, SHARED))
        for device in range(self.weight.shape[1]):
            slopes = point_slopes(self.state, self.points_m, in_projector=bool(device))
            weighed = slopes.by_motion * self.weight[:, device, None, None]
            normal += np.einsum("nij,nik->jk", weighed, slopes.by_motion)
            mixed += np.einsum("nij,nik->jk", weighed, slopes.by_shared)
        return np.asarray(-np.linalg.solve(normal, mixed))

    def aligned(self, other: RigState, rounds: int = _ALIGNMENTS) -> tuple[FloatArray, FloatArray]:
        """Rotation and translation after which another rig has these points at the same pixels."""
        rotation, translation = np.eye(3), np.zeros(3)
        wanted = [
            pixels_of(self.state, self.points_m, in_projector=bool(device)) for device in range(self.weight.shape[1])
        ]
        for _ in range(rounds):
            there = self.points_m @ rotation.T + translation
            normal, slope = np.zeros((POSE, POSE)), np.zeros(POSE)
            for device, pixels in enumerate(wanted):
                by_motion = point_slopes(other, there, in_projector=bool(device)).by_motion
                gap = pixels_of(other, there, in_projector=bool(device)) - pixels
                weighed = by_motion * self.weight[:, device, None, None]
                normal += np.einsum("nij,nik->jk", weighed, by_motion)
                slope += np.einsum("nij,ni->j", weighed, gap)
            step = -np.linalg.solve(normal, slope)
            turn = np.asarray(cv2.Rodrigues(step[:3].reshape(3, 1))[0])
            rotation, translation = turn @ rotation, turn @ translation + step[3:]
        return rotation, translation


def pixels_of(state: RigState, points_m: FloatArray, *, in_projector: bool) -> FloatArray:
    """(N, 2) pixels at which the camera or the projector has points of the camera's frame."""
    if in_projector:
        return project_points(state.projector, projector_points(points_m, state))
    return project_points(state.camera, points_m)


def points_at(state: RigState, xy_px: FloatArray, distance_m: float, *, in_projector: bool) -> FloatArray:
    """(N, 3) points of the camera's frame that pixels of a device meet at a distance from it; NaN where none."""
    vector = state.projector if in_projector else state.camera
    plane, there = ideal_coordinates(vector, xy_px)
    ray = np.column_stack([plane, np.ones(len(plane))])
    points = np.where(there[:, None], ray / np.linalg.norm(ray, axis=1, keepdims=True) * distance_m, np.nan)
    if in_projector:
        points = (points - state.projector_translation_m) @ state.projector_rotation
    return np.asarray(points)


def projection_covariance(
    anchor: Anchor, covariance: FloatArray, xy_px: FloatArray, distance_m: float, *, in_projector: bool
) -> FloatArray:
    """Covariance of the pixel at which a fixed point is seen.

    Parameters
    ----------
    anchor : Anchor
        Of the calibration.
    covariance : (S, S)
        Of its shared unknowns.
    xy_px : (N, 2)
        Pixels of the device.
    distance_m : float
        Of the points that these pixels see; infinity: ``FAR_M``.
    in_projector : bool
        Whether the device is the projector.

    Returns
    -------
    (N, 2, 2)
        NaN where a pixel sees nothing. [px²]
    """
    points = points_at(anchor.state, xy_px, distance_m, in_projector=in_projector)
    there = np.isfinite(points).all(axis=1)
    slopes = point_slopes(anchor.state, points[there], in_projector=in_projector)
    moves = slopes.by_shared + slopes.by_motion @ anchor.motion_by_shared()
    found = np.full((len(xy_px), 2, 2), np.nan)
    found[there] = moves @ covariance @ np.swapaxes(moves, 1, 2)
    return found


def worst_sigma(covariance: FloatArray) -> FloatArray:
    """(N,) standard deviation in the worst direction, of (N, 2, 2)."""
    half = (covariance[:, 0, 0] + covariance[:, 1, 1]) / 2
    apart = np.hypot((covariance[:, 0, 0] - covariance[:, 1, 1]) / 2, covariance[:, 0, 1])
    return np.asarray(np.sqrt(half + apart))


def pixel_grid(width_px: int, height_px: int, columns: int = 24) -> tuple[FloatArray, tuple[int, int]]:
    """(N, 2) pixels on a regular grid over a picture, and the grid's (rows, columns)."""
    rows = max(2, round(columns * height_px / width_px))
    x, y = np.meshgrid(np.linspace(0, width_px - 1, columns), np.linspace(0, height_px - 1, rows))
    return np.column_stack([x.ravel(), y.ravel()]), (rows, columns)
