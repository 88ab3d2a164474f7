"""Two calibrations from two halves of the views: they should differ by what both say of their errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import BoolArray, FloatArray
from calibration.errors import CalibrationError
from calibration.lenses.bundle import adjust_bundle
from calibration.lenses.fit import Settled
from calibration.lenses.records import BoardSightings, RigState
from calibration.lenses.uncertainty import (
    FAR_M,
    Anchor,
    confidence_of,
    pixels_of,
    points_at,
    projection_covariance,
)

_OPEN = 0.5
"""Of a picture's width: a half that knows its pixels no nearer, for lack of lit views, agrees with any other."""
LEAST_VIEWS = 6
"""Of which a half still determines a lens."""


@dataclass(frozen=True, eq=False, kw_only=True)
class HalvesDifference:
    """How far the lenses of two halves are apart, pixel by pixel, and how far they should be."""

    difference_px: FloatArray
    """(N, 2) of the second half minus the first, a motion of the rig taken off; NaN where a lens sees nothing."""
    expected_px: FloatArray
    """(N,) root of the sum of both halves' variances in x and y."""

    def rows(self, chosen: BoolArray) -> HalvesDifference:
        """Return some of the pixels."""
        return HalvesDifference(difference_px=self.difference_px[chosen], expected_px=self.expected_px[chosen])

    def tells(self, width_px: int) -> bool:
        """Whether both halves know anything of the lens."""
        return bool(np.nanmedian(self.expected_px) < _OPEN * width_px)

    @property
    def rms_px(self) -> float:
        """Root mean square of the difference."""
        return float(np.sqrt(np.nanmean((self.difference_px**2).sum(axis=1))))

    @property
    def ratio(self) -> float:
        """Difference over what the uncertainties of both halves say, root mean square; about 1 when they are true."""
        share = (self.difference_px**2).sum(axis=1) / self.expected_px**2
        return float(np.sqrt(np.nanmean(share)))


@dataclass(frozen=True, eq=False)
class _Half:
    state: RigState
    anchor: Anchor
    covariance: FloatArray


def halves_of(settled: Settled) -> tuple[Anchor, RigState, FloatArray, FloatArray] | None:
    """Fit both halves of the views; None when there are too few.

    Returns
    -------
    Anchor, RigState, (S, S), (S, S)
        The first half's observed points and lenses, the second's lenses, and both covariances.
    """
    if settled.sightings.views < LEAST_VIEWS:
        return None
    order = np.random.default_rng(0).permutation(settled.sightings.views)
    middle = len(order) // 2
    try:
        first, second = (_half(settled, np.sort(part)) for part in (order[:middle], order[middle:]))
    except (np.linalg.LinAlgError, CalibrationError):
        return None
    return first.anchor, second.state, first.covariance, second.covariance


def _half(settled: Settled, views: np.ndarray) -> _Half:
    part: BoardSightings = settled.sightings.of_views(views)
    state = adjust_bundle(part, settled.state.of_views(views), settled.free, prior=settled.prior).state
    equations = settled.equations_of(part, state)
    return _Half(state, Anchor.of(part, state), confidence_of(equations, settled.free).covariance)


def compare_halves(
    halves: tuple[Anchor, RigState, FloatArray, FloatArray],
    xy_px: FloatArray,
    distance_m: float = FAR_M,
    *,
    in_projector: bool,
) -> HalvesDifference:
    """Compare where two halves' lenses see what the pixels of one of them see.

    Parameters
    ----------
    halves
        As :func:`halves_of` gives them.
    xy_px : (N, 2)
        Pixels of the device.
    distance_m : float
        Of the points that these pixels see.
    in_projector : bool
        Whether the device is the projector.

    Returns
    -------
    HalvesDifference
    """
    anchor, other, *covariances = halves
    rotation, translation = anchor.aligned(other)
    points = points_at(anchor.state, xy_px, distance_m, in_projector=in_projector)
    moved = points @ rotation.T + translation
    there = np.isfinite(points).all(axis=1)
    difference = np.full(xy_px.shape, np.nan)
    difference[there] = pixels_of(other, moved[there], in_projector=in_projector) - xy_px[there]
    both = projection_covariance(anchor, covariances[0] + covariances[1], xy_px, distance_m, in_projector=in_projector)
    return HalvesDifference(difference_px=difference, expected_px=np.sqrt(both[:, 0, 0] + both[:, 1, 1]))
