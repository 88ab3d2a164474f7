"""Monotone response curves by their local gamma: a parametrisation in which a curve cannot fail to rise.

With y the level as a share of full scale and g(y) the light that makes it, s(y) = d log g / d log y is the curve's
local gamma: 1 for a straight sensor, 2.2 everywhere for a power law, from 1 near black to 2.3 near white for sRGB. Any
s > 0 gives a curve that rises, so the logarithm of s is what is fitted, as straight pieces between knots. One curve
after another multiplies their s: log s of a camera that follows a standard is that of the standard plus what its sensor
and its maker add, which is little and smooth.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibration.arrays import FloatArray

KNOTS = np.concatenate([[0.0, 0.01, 0.02, 0.04, 0.07], np.linspace(0.1, 1.0, 19)])
"""Of log s over y: close together near black, where tone curves bend most."""
_BENDS = ((1e-3, 1e-3), (1e-3, 0.01), (3e-3, 0.05), (1e-2, 0.2), (3e-2, 0.3), (0.1, 0.3), (0.3, 0.3), (1.0, 0.3))
"""Candidates: change of log local gamma over a factor e of level, and from black to full scale in proportion to it."""
_SMOOTH = 10.0
"""How much faster than a rough curve a smooth one of the same bend changes: its slope differs by that many times the
bend over a factor e. With 30 the scores of ``benchmarks/calibration/tone_curves.py`` differ by about a tenth."""
_SHOULDER, _UNSEEN = 2.0, 0.05
"""By how much the slope of log local gamma is off beyond the brightest level that was measured: times the slope there,
and where none is seen. S curves, whose slope doubles on the way to white, are 1.5 standard errors off with it (rms),
2.4 with 1; a sensor that saturates by a tenth has a slope of 0.05 in the middle of its levels and 0.09 at white."""
_SLOPE_OVER = 0.8
"""Share of the brightest level that was measured, from which on the slope there is taken."""
_GAMMA_SPREAD = {True: 1e-3, False: 1.0}
"""Of log local gamma at black: 1 for a sensor (a finite slope there), anything for a power law."""
_FINE = 512
"""Points of the table, closer near black: straight pieces between them are right to 1e-5 of full scale."""
_BEND = 0.05
"""Distances between knots are those of log(y + 0.05): tone curves bend by as much in each doubling above that."""


@dataclass(frozen=True, eq=False)
class ToneCurve:
    """A curve from level to light, with its derivatives by the parameters; both are 1 at full scale."""

    y: FloatArray
    """(P,) levels, from 0 to 1."""
    log_light: FloatArray
    """(P,) log g; the first, at level 0, is that of the smallest number."""
    local_gamma: FloatArray
    """(P,) d log g / d log y."""

    @cached_property
    def by_knots(self) -> FloatArray:
        """(P, J) derivative of log g by the logarithm of the local gamma at each knot."""
        part = -_summed_from_the_end(self.local_gamma[1:, None] * _SHAPES[1:])
        return np.concatenate([part[:1], part])

    @property
    def light(self) -> FloatArray:
        """(P,) g, from 0 to 1."""
        return np.concatenate([[0.0], np.exp(self.log_light[1:])])

    def log_light_of(self, y: FloatArray) -> FloatArray:
        """Log g at levels above 0, any shape; beyond full scale it goes on straight."""
        log_y = np.log(np.maximum(y, self.y[1]))
        beyond = np.maximum(log_y, 0) * self.local_gamma[-1]
        return np.asarray(np.interp(log_y, self._log_y, self.log_light[1:]) + beyond)

    def log_level_of(self, log_light: FloatArray) -> FloatArray:
        """Log y of logarithms of light, any shape; beyond full scale it goes on straight."""
        inside = np.interp(log_light, self.log_light[1:], self._log_y)
        return np.asarray(inside + np.maximum(log_light, 0) / self.local_gamma[-1])

    def derivatives_at(self, log_y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Local gamma (...), and derivative of log g by each knot (..., J), at logarithms of levels."""
        place = np.clip(np.interp(log_y, self._log_y, np.arange(1.0, len(self.y))), 1, len(self.y) - 1)
        low = np.minimum(place.astype(int), len(self.y) - 2)
        share = (place - low)[..., None]
        by_knots = (1 - share) * self.by_knots[low] + share * self.by_knots[low + 1]
        return self.gamma_at(log_y), by_knots

    def gamma_at(self, log_y: FloatArray) -> FloatArray:
        """Local gamma at logarithms of levels, any shape."""
        return np.asarray(np.interp(log_y, self._log_y, self.local_gamma[1:]))

    @cached_property
    def _log_y(self) -> FloatArray:
        return np.asarray(np.log(self.y[1:]))


_Y = (np.arange(_FINE + 1) / _FINE) ** 2
_SHAPES = np.stack([np.interp(_Y, KNOTS, one) for one in np.eye(len(KNOTS))], axis=-1)
_STEPS = np.diff(np.log(_Y[1:]))


def _srgb_light(y: FloatArray) -> FloatArray:
    """IEC 61966-2-1."""
    return np.where(y <= 0.04045, y / 12.92, ((y + 0.055) / 1.055) ** 2.4)


def _rec709_light(y: FloatArray) -> FloatArray:
    """ITU-R BT.709, with the step of 0.3 % that its rounded numbers make where the two parts meet."""
    return np.where(y < 0.081, y / 4.5, ((y + 0.099) / 1.099) ** (1 / 0.45))


def _log_gamma_of(light: FloatArray) -> FloatArray:
    """(P,) log local gamma that :func:`tone_curve` sums up to a light at all levels."""
    between = np.diff(np.log(light[1:])) / _STEPS
    inside = (between[1:] + between[:-1]) / 2
    last = 1.5 * between[-1] - 0.5 * between[-2]
    return np.asarray(np.log(np.concatenate([between[:1], between[:1], inside, [last]])))


STRAIGHT = np.zeros(_FINE + 1)
"""Log local gamma of what no standard bends."""
STANDARDS = (_log_gamma_of(_srgb_light(_Y)), _log_gamma_of(_rec709_light(_Y)))
"""(P,) log local gamma over y of the curves that cameras follow."""


def tone_curve(log_gamma: FloatArray, standard: FloatArray = STRAIGHT) -> ToneCurve:
    """Make the curve of a local gamma.

    Parameters
    ----------
    log_gamma : (J,)
        Logarithm of the local gamma at each of :data:`KNOTS`, beside the standard's.
    standard : (P,)
        One of :data:`STANDARDS`, or :data:`STRAIGHT`.

    Returns
    -------
    ToneCurve
        1 at full scale.
    """
    gamma = np.exp(standard + _SHAPES @ log_gamma)
    log_light = -_summed_from_the_end(gamma[1:])
    return ToneCurve(_Y, np.concatenate([log_light[:1], log_light]), gamma)


def _summed_from_the_end(values: FloatArray) -> FloatArray:
    """Integral over log y from each point to full scale, by trapezoids; (P - 1, ...)."""
    steps = _STEPS.reshape(-1, *(1,) * (values.ndim - 1))
    areas = (values[1:] + values[:-1]) / 2 * steps
    return np.concatenate([np.cumsum(areas[::-1], axis=0)[::-1], np.zeros((1, *values.shape[1:]))])


def knot_distances() -> FloatArray:
    """Return (J - 1,) distances of neighbouring knots, by which a local gamma may change alike."""
    return np.asarray(np.diff(np.log(KNOTS + _BEND)))


@dataclass(frozen=True, eq=False, kw_only=True)
class CurveBend:
    """How much a curve may bend beside a standard, whether smoothly, and whether it has a finite slope at black."""

    standard: FloatArray
    """(P,)"""
    is_sensor: bool
    is_smooth: bool
    """Whether it goes on as it bent before; else each part may bend anew."""
    bend: float
    slope: float

    @cached_property
    def precision(self) -> FloatArray:
        """(J, J) of log local gamma at the knots: any at black, a straight line, and random steps from knot to knot.

        Of a smooth curve the steps of the slope are random, not those of the curve: an integrated random walk.
        """
        if self.is_smooth:
            place = np.concatenate([[0.0], np.cumsum(knot_distances())])
            low, high = np.minimum(place[:, None], place), np.maximum(place[:, None], place)
            bending = (_SMOOTH * self.bend) ** 2 * low**2 * (3 * high - low) / 6
            bending += self.slope**2 * np.outer(place, place)
        else:
            place = np.concatenate([[0.0], np.cumsum(self.bend**2 * knot_distances())])
            bending = np.minimum(place[:, None], place)
        covariance = bending + self.slope**2 * np.outer(KNOTS, KNOTS) + _GAMMA_SPREAD[self.is_sensor] ** 2
        # A smooth curve of straight pieces differs from a straight line by less than a number's last digits tell.
        return np.asarray(np.linalg.inv(covariance + (1e-9 if self.is_smooth else 1e-12) * np.eye(len(KNOTS))))


Family = tuple[CurveBend, ...]
"""Candidates from straight to bent."""


def _family(standard: FloatArray, *, is_sensor: bool, is_smooth: bool) -> Family:
    return tuple(
        CurveBend(standard=standard, is_sensor=is_sensor, is_smooth=is_smooth, bend=bend, slope=slope)
        for bend, slope in _BENDS
    )


FAMILIES: tuple[Family, ...] = (
    *(
        _family(STRAIGHT, is_sensor=is_sensor, is_smooth=is_smooth)
        for is_sensor in (True, False)
        for is_smooth in (True, False)
    ),
    *(_family(standard, is_sensor=True, is_smooth=True) for standard in STANDARDS),
)
"""Sensors and others, smooth and rough; and sensors behind a standard, whose makers' bends are smooth."""


def shoulder(log_gamma: FloatArray, covariance: FloatArray, measured: float) -> FloatArray:
    """Find how far off a curve may be where it was not measured: it may bend there by more than it has begun to.

    Parameters
    ----------
    log_gamma : (J,)
        As found, at :data:`KNOTS`.
    covariance : (J, J)
        Of it.
    measured : float
        Share of full scale up to which levels were measured.

    Returns
    -------
    (J,)
        One standard deviation of log local gamma at the knots, all in common: 0 up to `measured`.
    """
    place, (begin, end) = np.log(KNOTS + _BEND), np.log(np.array([_SLOPE_OVER, 1.0]) * measured + _BEND)
    weights = (np.diff([_hats(place, begin), _hats(place, end)], axis=0) / (end - begin))[0]
    slope_squared = (weights @ log_gamma) ** 2 - weights @ covariance @ weights
    off = np.sqrt(_SHOULDER**2 * max(slope_squared, 0.0) + _UNSEEN**2)
    return np.asarray(off * np.maximum(place - end, 0.0))


def _hats(knots: FloatArray, at: float) -> FloatArray:
    """(J,) what each knot weighs at a place between two of them."""
    return np.array([np.interp(at, knots, one) for one in np.eye(len(knots))])
