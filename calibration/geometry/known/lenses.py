"""A lens that boards measured, as a prior of the bundle on walls: its values, and all of its covariance.

The bundle's lens has one focal length and five terms of distortion. What a lens file says in twelve parameters is
carried into these by how both move pixels over the picture: to first order the two then say the same of every pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration.arrays import FloatArray
from calibration.geometry.pinhole import PinholeModel
from calibration.lenses.lens import N, distorted, ideal_coordinates, projection

TERMS = 8
"""Of a lens in the bundle: f, cx, cy, k1, k2, p1, p2, k3."""
_POWERS = (2, 4, 1, 1, 6)
"""Of the distance from the middle, by which a term of distortion moves a pixel."""
_BROWN = (4, 5, 6, 7, 8)
"""Where k1, k2, p1, p2, k3 stand among the twelve."""
_GRID = (18, 24)
_SIGMAS = 4.0
"""From square pixels: beyond, they are not."""
_SQUARE = np.concatenate([[-1.0, 1.0], np.zeros(N - 2)])


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredLens:
    """What was measured of a lens, in the order of :data:`calibration.lenses.lens.PARAMETERS`."""

    shape: tuple[int, int]
    """(height, width) of the picture. [px]"""
    vector: FloatArray
    """(12,) [px and 1]"""
    covariance: FloatArray
    """(12, 12); zero where a term was not fitted."""
    noise_px: float
    """Of a corner's coordinate: a term that left-out views did not ask for moves the picture's corner by no more."""

    @cached_property
    def aspect(self) -> float:
        """Focal length in y over that in x: 1 (square pixels) unless the boards speak clearly against it."""
        apart, sigma = self.vector[1] - self.vector[0], np.sqrt(_SQUARE @ self.covariance @ _SQUARE)
        return 1.0 if abs(apart) <= _SIGMAS * sigma else float(self.vector[1] / self.vector[0])

    @cached_property
    def at_aspect(self) -> tuple[FloatArray, FloatArray]:
        """(12,) parameters and (12, 12) covariance, given that aspect: the bundle has one focal length."""
        return np.asarray(self.keep @ self.vector), np.asarray(self.keep @ self.covariance @ self.keep.T)

    @cached_property
    def keep(self) -> FloatArray:
        """(12, 12) what the condition leaves of a change of the parameters."""
        return np.asarray(np.eye(N) - np.outer(self._gain, self._apart))

    @cached_property
    def _apart(self) -> FloatArray:
        return np.concatenate([[-self.aspect, 1.0], np.zeros(N - 2)])

    @cached_property
    def _gain(self) -> FloatArray:
        """(12,) by which the parameters follow when the condition is imposed (Gauss's conditional mean)."""
        variance = float(self._apart @ self.covariance @ self._apart)
        return np.asarray(self.covariance @ self._apart / variance) if variance > 0 else np.zeros(N)

    @cached_property
    def brown(self) -> BrownTerms:
        """The same lens in the bundle's terms."""
        return _brown(self)


@dataclass(frozen=True, eq=False, kw_only=True)
class BrownTerms:
    """A lens with one focal length (that in x) and Brown's five terms."""

    values: FloatArray
    """(8,) f, cx, cy, k1, k2, p1, p2, k3. [px and 1]"""
    by_vector: FloatArray
    """(8, 12) how they follow the parameters that were measured."""
    floor: FloatArray
    """(8,) variance that stands for what these terms cannot say, and for terms that were not fitted."""
    misfit_px: float
    """RMS over the picture by which the two lenses differ."""


@dataclass(frozen=True, eq=False, kw_only=True)
class KnownLenses:
    """Measured lenses of one camera and one projector; either may be missing."""

    camera: MeasuredLens | None = None
    projector: MeasuredLens | None = None
    between: FloatArray | None = None
    """(12, 12) covariance of the camera's (rows) and the projector's parameters: boards measure both together."""

    @property
    def both(self) -> tuple[MeasuredLens | None, MeasuredLens | None]:
        """Camera and projector."""
        return self.camera, self.projector

    def covariance(self) -> FloatArray:
        """(16, 16) of the bundle's terms of both lenses; zero rows of one that was not measured. [px and 1]."""
        whole = np.zeros((2 * TERMS, 2 * TERMS))
        for k, lens in enumerate(self.both):
            if lens is not None:
                own, at = lens.brown, slice(k * TERMS, (k + 1) * TERMS)
                whole[at, at] = own.by_vector @ lens.at_aspect[1] @ own.by_vector.T + np.diag(own.floor)
        if self.between is not None and self.camera is not None and self.projector is not None:
            given = self.camera.keep @ self.between @ self.projector.keep.T
            across = self.camera.brown.by_vector @ given @ self.projector.brown.by_vector.T
            whole[:TERMS, TERMS:], whole[TERMS:, :TERMS] = across, across.T
        return whole


def ideal_pixels(lens: MeasuredLens, xy_px: FloatArray, centre_px: tuple[float, float]) -> FloatArray:
    """(N, 2) where a lens of the same focal length sees pixels, without distortion and with its axis at a place.

    Parameters
    ----------
    lens : MeasuredLens
    xy_px : (N, 2)
        Pixels that it sees. [px]
    centre_px : (x, y)
        Principal point of the other lens. [px]
    """
    return np.asarray(ideal_coordinates(lens.at_aspect[0], xy_px)[0] * lens.at_aspect[0][0] + np.asarray(centre_px))


def _brown(lens: MeasuredLens) -> BrownTerms:
    """Brown's terms that come nearest over the picture, by Gauss and Newton's method from the measured ones."""
    (height, width), vector = lens.shape, lens.at_aspect[0]
    row, column = np.meshgrid(*(np.linspace(0, n - 1, k) for n, k in zip(lens.shape, _GRID, strict=True)))
    plane, found = ideal_coordinates(vector, np.column_stack([column.ravel(), row.ravel()]))
    plane = plane[found]
    points = np.column_stack([plane, np.ones(len(plane))])
    truth = distorted(vector, plane) * vector[:2] + vector[2:4]
    near = vector.copy()
    near[9:] = 0.0
    for _ in range(4 if vector[9:].any() else 1):
        seen = projection(near, points)
        own = _by_terms(seen.by_lens, lens.aspect)
        values = _values(near) + _least_squares(own, (truth - seen.xy_px).reshape(-1, 1))[:, 0]
        near = _vector(values, lens.aspect)
    misfit = truth - projection(near, points).xy_px
    by_vector = _least_squares(own, projection(vector, points).by_lens.reshape(-1, N))
    misfit_px = float(np.sqrt((misfit**2).mean()))
    corner = 0.5 * float(np.hypot(height, width)) / float(vector[0])
    return BrownTerms(values=values, by_vector=by_vector, floor=_floor(lens, corner, misfit_px), misfit_px=misfit_px)


def _floor(lens: MeasuredLens, corner: float, misfit_px: float) -> FloatArray:
    """(8,) variances: what is left over, and of terms that were not fitted also the corners' noise."""
    fitted = np.diag(lens.covariance)[list(_BROWN)] > 0
    apart_px = np.hypot(misfit_px, np.where(fitted, 0.0, lens.noise_px))
    terms = (apart_px / lens.vector[0] / corner ** np.array(_POWERS)) ** 2
    return np.concatenate([np.zeros(3), terms])


def _values(vector: FloatArray) -> FloatArray:
    return np.concatenate([vector[:1], vector[2:4], vector[list(_BROWN)]])


def _vector(values: FloatArray, aspect: float) -> FloatArray:
    return np.concatenate([[values[0], aspect * values[0]], values[1:], np.zeros(3)])


def _by_terms(by_lens: FloatArray, aspect: float) -> FloatArray:
    """(2 N, 8) how pixels follow the bundle's terms."""
    focal = by_lens[..., :1] + aspect * by_lens[..., 1:2]
    return np.asarray(np.concatenate([focal, by_lens[..., 2:9]], axis=-1).reshape(-1, TERMS))


def _least_squares(slopes: FloatArray, wanted: FloatArray) -> FloatArray:
    size = np.linalg.norm(slopes, axis=0)
    return np.asarray(np.linalg.lstsq(slopes / size, wanted, rcond=None)[0] / size[:, None])


def idealised(lens: MeasuredLens | None, xy_px: FloatArray, centre_px: tuple[float, float]) -> FloatArray:
    """Return pixels (N, 2) as :func:`ideal_pixels` does; of a lens that nobody measured, as they are."""
    return xy_px if lens is None else ideal_pixels(lens, xy_px, centre_px)


def real_device(lens: MeasuredLens | None, device: PinholeModel) -> PinholeModel:
    """Return a device with the lens that was measured; with its own where none was."""
    if lens is None:
        return device
    f, cx, cy, *terms = lens.brown.values.tolist()
    k1, k2, p1, p2, k3 = terms
    return replace(device, focal_px=(f, f * lens.aspect), principal_point_px=(cx, cy), distortion=(k1, k2, p1, p2, k3))
