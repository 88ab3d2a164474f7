"""Which wall a projector pixel lights, by the correspondences around it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calibration.arrays import BoolArray, FloatArray, IntArray

_REACH_SHARE, _NEIGHBOURS, _LEAST_NEIGHBOURS = 0.03, 12, 3
"""How far from a projector pixel points tell its wall, as a share of the lit width; how many, and how few."""
_AGREED, _STRAYS = 0.5, 0.2
"""Share of them that have to lie on one wall; and that may lie on none, beside a spot that nobody saw: more are another
wall's. Of random rig 6021, whose camera saw a strip of it 5 pixels wide, all lengths were 14 % off."""
_FAR_REACH_SHARE = 0.1
"""Further away, a spot that the camera does not see is taken for the wall of the nearest points only if all agree. From
0.15 of the width on, a spot on a ceiling that nobody saw was once taken for the wall below it: all lengths 21 % off."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ExplainedPixels:
    """Projector pixels of correspondences that a plane explains."""

    projector_xy_px: FloatArray
    """(M, 2) [px]"""
    plane: IntArray
    """(M,) plane of each."""
    others_xy_px: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    """(L, 2) projector pixels of correspondences that no plane explains. [px]"""

    def plane_at(self, xy_px: FloatArray) -> IntArray:
        """(N,) plane of most points around projector pixels (N, 2); -1 where there are none, or most lie on none."""
        on_none = self._on_none(xy_px, _REACH_SHARE, _AGREED)
        return np.where(on_none, -1, self._voted(xy_px, _REACH_SHARE, agreed=_AGREED))

    def are_among(self, xy_px: FloatArray) -> BoolArray:
        """(N,) pixels on all sides of which points on planes are near: beyond the last of them, another wall may be."""
        every, reach_px = self.projector_xy_px, _REACH_SHARE * self._width_px
        return np.array([_is_among(every[_nearest(every, pixel, reach_px)], pixel) for pixel in xy_px], bool)

    def plane_beside(self, xy_px: FloatArray) -> IntArray:
        """(N,) plane of all nearest points on planes, not further than a tenth of what is lit; -1 where they differ.

        -1, too, where some of the nearest points lie on no plane: a strip of a wall that the camera hardly sees, say.
        """
        on_none = self._on_none(xy_px, _FAR_REACH_SHARE, _STRAYS)
        return np.where(on_none, -1, self._voted(xy_px, _FAR_REACH_SHARE, agreed=1.0))

    def with_others(self, xy_px: FloatArray) -> ExplainedPixels:
        """Return the same with more pixels (N, 2) of correspondences that no plane explains."""
        return replace(self, others_xy_px=np.concatenate([self.others_xy_px, xy_px]))

    def _on_none(self, xy_px: FloatArray, reach_share: float, most: float) -> BoolArray:
        """(N,) pixels around which points were measured, too many of them on no plane: furniture, or a wall left."""
        both = np.concatenate([self.projector_xy_px, self.others_xy_px])
        is_other = np.arange(len(both)) >= len(self.plane)
        near = [_nearest(both, pixel, reach_share * self._width_px) for pixel in xy_px]
        return np.array([len(rows) >= _LEAST_NEIGHBOURS and is_other[rows].mean() > most for rows in near], bool)

    @property
    def _width_px(self) -> float:
        return float(np.ptp(self.projector_xy_px[:, 0])) if len(self.plane) else 0.0

    def _voted(self, xy_px: FloatArray, reach_share: float, *, agreed: float) -> IntArray:
        found = np.full(len(xy_px), -1, dtype=np.int64)
        for k, pixel in enumerate(xy_px):
            near = _nearest(self.projector_xy_px, pixel, reach_share * self._width_px)
            if len(near) >= _LEAST_NEIGHBOURS:
                votes = np.bincount(self.plane[near])
                found[k] = votes.argmax() if votes.max() >= agreed * len(near) else -1
        return found


def _is_among(xy_px: FloatArray, pixel: FloatArray) -> bool:
    """Tell whether a pixel has others (N, 2) to its left and right, above and below."""
    return bool(((xy_px >= pixel).any(axis=0) & (xy_px <= pixel).any(axis=0)).all())


def _nearest(xy_px: FloatArray, pixel: FloatArray, reach_px: float) -> IntArray:
    """Rows of the pixels nearest to one, within a square around it."""
    away = np.maximum(*np.abs(xy_px - pixel).T)
    near = np.flatnonzero(away <= reach_px)
    return np.asarray(near[np.argsort(away[near], kind="stable")[:_NEIGHBOURS]])
