"""How much light changes between frames that should show the same: within an exposure, and from one to another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import FloatArray, IntArray

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
