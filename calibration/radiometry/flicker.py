"""Room light on the mains: whether it is seen in frames of darkness, what it adds, which exposures are blind to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.arrays import FloatArray, Frame

MAINS_LIGHT_HZ = (100.0, 120.0)
"""Lamps swell with the square of the mains' 50 or 60 Hz."""
SWELL = 0.1
"""Of room light: by what share of its mean it is held to swell (standard deviation)."""
_SIGMAS, _LEAST_SHARE = 5.0, 5e-5
"""A swell is seen from so many of the noise of a frame's mean on; below that share of full scale it matters to none."""
_EXPLAINED = 0.8
"""Of what the frames vary by: less is no swell of that frequency."""
_LEAST_APART = 1e-3
"""Of a swell's sine and cosine at the frames' times: with less, all frames are at one phase and show nothing."""
PHASES = 3
"""Photographs whose mean is blind to a swell that is faster than they end: a third of its period apart, they see none
of it nor of its double."""
_OFF_PHASE = 0.07
"""Of a period, by which a photograph may miss its third: what the mean keeps of the swell is then below a fifth."""
_BRIGHTER = 1.03
"""By which an exposure may grow to hold one period more; by more and white clips."""


@dataclass(frozen=True, kw_only=True, eq=False)
class InStep:
    """What frames of darkness tell of a swell in step with the frames, and of black, which it passes for.

    A swell has a sine and a cosine at each of :data:`MAINS_LIGHT_HZ`, in units of what :data:`SWELL` makes likely:
    the unknowns of :func:`swell_in_step`.
    """

    swell: FloatArray
    """(4,)"""
    covariance: FloatArray
    """(5, 5) of the black level, in digital numbers, and of these four."""

    @classmethod
    def unknown(cls, black_sigma_dn: float) -> InStep:
        """Where no frame tells: none, give or take what is likely."""
        return cls(swell=np.zeros(4), covariance=np.diag([black_sigma_dn**2, 1.0, 1.0, 1.0, 1.0]))

    def precision(self, full_scale_dn: float) -> FloatArray:
        """(5, 5) of the black level, as a share of full scale, and of the four."""
        unit = np.array([1 / full_scale_dn, 1.0, 1.0, 1.0, 1.0])
        covariance = unit[:, None] * self.covariance * unit
        return np.asarray(np.linalg.inv(covariance + np.diag([1e-14, 0.0, 0.0, 0.0, 0.0])))


def swell_in_step(exposures_s: FloatArray) -> FloatArray:
    """Return what a swell in step with the frames adds to an exposure, for each of its four unknowns.

    Parameters
    ----------
    exposures_s : (F,)
        Of frames that begin at one phase of the swell. [s]

    Returns
    -------
    (F, 4)
        How much longer a steady room light would have to shine. [s]

    Notes
    -----
    Light that swells by a share m at a frequency f adds m / (2 pi f) (cos p - cos(p + 2 pi f t)) to an exposure t that
    begins at phase p.
    """
    turns = 2 * np.pi * np.array(MAINS_LIGHT_HZ)
    size_s = SWELL / turns / np.sqrt(len(turns))
    angle = turns * exposures_s[:, None]
    return np.concatenate([size_s * (1 - np.cos(angle)), size_s * np.sin(angle)], axis=1)


def room_light_hz(frames: Sequence[Frame], middles_s: FloatArray, full_scale_dn: float) -> float | None:
    """Find the frequency with which frames of darkness swell.

    Parameters
    ----------
    frames : (N of) (H, W, C)
        Of one scene that the projector does not light. [dn]
    middles_s : (N,)
        Middles of their exposures. [s]
    full_scale_dn : float
        Largest digital number.

    Returns
    -------
    float or None
        100 or 120; None where nothing swells, or not as lamps on the mains do. [Hz]
    """
    means = np.array([float(frame.mean(dtype=np.float64)) for frame in frames])
    spread = means - means.mean()
    if float(np.sqrt(np.mean(spread**2))) < max(_SIGMAS * _noise_of_mean(frames), _LEAST_SHARE * full_scale_dn):
        return None
    explained = {hz: _explained(spread, 2 * np.pi * hz * (middles_s - middles_s[0])) for hz in MAINS_LIGHT_HZ}
    best = max(explained, key=lambda hz: explained[hz])
    return best if explained[best] > _EXPLAINED else None


def _noise_of_mean(frames: Sequence[Frame]) -> float:
    """Standard deviation of a frame's mean that its pixels' noise makes. [dn]."""
    change = np.subtract(frames[1], frames[0], dtype=np.float64)
    return float(change.std() / np.sqrt(2 * change.size))


def _explained(spread: FloatArray, phase: FloatArray) -> float:
    """Share of the variance about the mean that a swell of these phases takes away, for the unknowns it spends."""
    waves = np.stack([np.sin(phase), np.cos(phase)], axis=1)
    waves -= waves.mean(axis=0)
    if np.linalg.norm(waves) < _LEAST_APART * len(phase):
        return 0.0
    basis, values, _ = np.linalg.svd(waves, full_matrices=False)
    told = basis[:, values > _LEAST_APART * len(phase)]
    left = spread - told @ (told.T @ spread)
    free = len(spread) - 1 - told.shape[1]
    return float(1 - (left @ left / max(free, 1)) / (spread @ spread / (len(spread) - 1)))


def whole_periods(exposure_s: float, light_hz: float, range_s: tuple[float, float]) -> float | None:
    """Choose the exposure nearest to one that is wanted, and not much longer, that holds whole periods of a light.

    Its multiples hold whole periods, too.

    Parameters
    ----------
    exposure_s : float
        That is wanted. [s]
    light_hz : float
        Of the light's swell. [Hz]
    range_s : (shortest, longest)
        What the camera can do. [s]

    Returns
    -------
    float or None
        None where even one period is too long. [s]
    """
    chosen_s = int(exposure_s * _BRIGHTER * light_hz) / light_hz
    return chosen_s if chosen_s > 0 and range_s[0] <= chosen_s <= range_s[1] else None


def is_third(middle_s: float, first_s: float, nth: int, light_hz: float) -> bool:
    """Tell whether a photograph sees a swell the wanted part of its period after the first of its set.

    Parameters
    ----------
    middle_s, first_s : float
        Middles of its exposure and of the first one's. [s]
    nth : int
        Number in the set: every third one sees the same.
    light_hz : float
        Of the swell. [Hz]

    Returns
    -------
    bool
    """
    off = ((middle_s - first_s) * light_hz - nth / PHASES) % 1.0
    return min(off, 1.0 - off) < _OFF_PHASE


def swell_of_means(means: FloatArray) -> float:
    """Return by how much means over the thirds of a period still swell.

    Parameters
    ----------
    means : (N,)
        Of photographs of one scene in darkness, each a third of a period after the one before; more than three.

    Returns
    -------
    float
        Largest minus smallest mean of three that follow each other. [unit of the means]
    """
    return float(np.ptp(np.convolve(means, np.full(PHASES, 1 / PHASES), mode="valid")))
