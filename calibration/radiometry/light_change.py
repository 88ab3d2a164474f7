"""How much light changes between frames that should show the same: within an exposure, and from one to another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import FloatArray, IntArray
from calibration.errors import CalibrationError

MOST_CHANGE = 0.10
"""Of light between frames, rms; flicker of the brightest room lights stays below."""
_MOST_REPEATED = 0.03
"""Of light between exposures, rms, beyond what repeats of one exposure differ by: auto tone mapping that bends by a
gamma of 1.5 from the shortest exposure to the longest gives 0.04, mains light at most 0.015."""
_LEAST, _FIRST_GUESS = 1e-5, 3e-3
"""Of the standard deviation of a change: a steady lamp's is found to be 5e-5."""


@dataclass(frozen=True)
class ChangeSpread:
    """Standard deviations of changes of log light: of what all frames of an exposure share, and of a frame's own.

    Frames of one exposure share what it is off by, and the phase of a room light that runs in step with the projector:
    a repeat tells nothing new about them.
    """

    shared: float = 0.0
    own: float = _FIRST_GUESS

    def precision(self, exposure_of: IntArray) -> FloatArray:
        """(F, F) of the frames' changes; `exposure_of` (F,) numbers each frame's exposure from 0."""
        alike = (exposure_of[:, None] == exposure_of).astype(np.float64)
        return np.asarray(np.linalg.inv(self.own**2 * np.eye(len(exposure_of)) + self.shared**2 * alike))

    @property
    def total(self) -> float:
        """Of a frame."""
        return float(np.hypot(self.shared, self.own))


def likeliest_change(moments: FloatArray, exposure_of: IntArray) -> ChangeSpread:
    """Return the variances that second moments of changes are likeliest under: a step of expectation maximisation.

    Parameters
    ----------
    moments : (F, F)
        Of the frames' changes of log light: what was found, times itself, and its covariance.
    exposure_of : (F,)
        Number of each frame's exposure, from 0.

    Returns
    -------
    ChangeSpread
        All of it a frame's own where no exposure is repeated.

    References
    ----------
    S. R. Searle, G. Casella and C. E. McCulloch, Variance Components, 1992: one way, random effects.
    """
    members = np.eye(exposure_of.max() + 1)[:, exposure_of]
    counts = members.sum(axis=1)
    of_means = np.einsum("ef,fg,eg->e", members, moments, members) / counts**2
    repeats = len(exposure_of) - len(counts)
    if repeats == 0:
        return ChangeSpread(own=max(float(np.sqrt(of_means.mean())), _LEAST))
    own = max(float(np.trace(moments) - counts @ of_means) / repeats, _LEAST**2)
    shared = max(float(np.mean(of_means - own / counts)), 0.0)
    return ChangeSpread(shared=float(np.sqrt(shared)), own=float(np.sqrt(own)))


def rms_change(change: FloatArray) -> float:
    """Return the root mean square of changes of log light (F,)."""
    return float(np.sqrt(np.mean(change**2)))


def repeated_change(change: FloatArray, log_time: FloatArray) -> float:
    """Return what of the changes (F,) comes again with each repeat of an exposure, rms; 0 without repeats."""
    times, which, counts = np.unique(log_time, return_inverse=True, return_counts=True)
    if len(times) == len(log_time):
        return 0.0
    means = np.bincount(which, change) / counts
    scatter = float(((change - means[which]) ** 2).sum() / (len(log_time) - len(times)))
    return float(np.sqrt(max(float(np.mean(means**2)) - scatter / counts.mean(), 0.0)))


def refuse_changes(change: FloatArray, log_time: FloatArray, *, left: float, most_left: float) -> None:
    """Refuse frames of one picture that no one curve explains.

    Parameters
    ----------
    change : (F,)
        Of log light in each frame.
    log_time : (F,)
        Logarithm of its exposure.
    left : float
        What the curve leaves, share of full scale.
    most_left : float
        What it may leave.

    Raises
    ------
    CalibrationError
        If the curve moves from frame to frame, or the light does.
    """
    repeated = repeated_change(change, log_time)
    if left > most_left or _MOST_REPEATED < repeated < MOST_CHANGE:
        raise CalibrationError(
            f"camera response: no one curve fits all exposures: {100 * left:.1f} % of full scale is left (rms), "
            f"the limit is {100 * most_left:g} %, and light seems to be {100 * repeated:.1f} % (rms) off the "
            f"exposures, the limit is {100 * _MOST_REPEATED:g} %: the camera's tone curve moves from frame to frame "
            "(auto tone mapping, dynamic contrast, backlight compensation): switch it off; or dark levels differ from "
            "column to column or row to row: switch the camera's black-level or fixed-pattern correction on"
        )
    changed = rms_change(change)
    if changed > MOST_CHANGE:
        raise CalibrationError(
            f"camera response: light changes by {100 * changed:.0f} % (rms) between frames of one picture, "
            f"the limit is {100 * MOST_CHANGE:g} %: the camera's automatic exposure or gain is on, exposures that it "
            "tells are wrong, a lamp flickers, or light in the room was switched meanwhile; switch it off"
        )
