"""A calibration held to lengths by tape: points and tape are each believed as far as they are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calibration.arrays import FloatArray
from calibration.geometry.noise import slopes, standard_deviations
from calibration.geometry.stereo import StereoCalibration

Figures = Callable[[StereoCalibration, FloatArray], FloatArray]
"""What follows from a calibration whose baseline is 1, and from (T,) lengths by tape that are so many sigmas longer."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TapedCalibration:
    """A calibration beside lengths by tape, and what both leave open."""

    pair: StereoCalibration
    """Its baseline is 1."""
    tape_errors: FloatArray
    """(T,) by how many of its standard deviations each length is longer than the tape says."""
    covariance: FloatArray
    """(n + T, n + T) of the calibration's unknowns and of these; n is 0 of one that was not fitted."""
    askew: FloatArray
    """(n + T, n + T) beside it, were each wall that is taken to be square off by 0.3 degrees."""

    @classmethod
    def apart(cls, pair: StereoCalibration, tapes: int) -> TapedCalibration:
        """Return both as they are before one is held to the other."""
        known = pair.uncertainty
        n = 0 if known is None else len(known.unknowns)
        covariance, askew = np.eye(n + tapes), np.zeros((n + tapes, n + tapes))
        if known is not None:
            covariance[:n, :n], askew[:n, :n] = known.covariance, known.askew
        return cls(pair=pair, tape_errors=np.zeros(tapes), covariance=covariance, askew=askew)

    def sigmas_of(self, figures: Figures) -> FloatArray:
        """Return the (m,) standard deviations of any figures that follow from both."""
        return standard_deviations(lambda x: figures(*self._parts(x)), self._all, self.covariance)

    def askew_sigmas_of(self, figures: Figures) -> FloatArray:
        """Return by how much (m,) figures would be off, were each wall taken to be square off by 0.3 degrees."""
        return standard_deviations(lambda x: figures(*self._parts(x)), self._all, self.askew)

    def held_to(self, differences: Figures) -> TapedCalibration:
        """Make differences between what was measured and what the tape says zero.

        Parameters
        ----------
        differences : callable
            (m,) of lengths that the points and the tape both tell.

        Returns
        -------
        TapedCalibration
            Points and tapes changed by what each is likely to be off; the same where the differences are none.

        Notes
        -----
        Both are normally distributed about what they say, and differences are straight in both: then the likeliest is
        x - G d with G = C A' (A C A')^-1 and the slopes A of the differences d, and its covariance C - G A C. What
        walls that stand askew do to x, they do to d, too: (1 - G A) times that is left. Where differences are larger
        than both allow, the tape is taken to be as uncertain as they show: its standard deviations times the root of
        chi-squared over their number (R. T. Birge, The calculation of errors by the method of least squares, Phys.
        Rev. 40, 1932).
        """
        off, slope = slopes(lambda x: differences(*self._parts(x)), self._all)
        if not len(off):
            return self
        believed = self._with_tapes_times(_birge_ratio(off, slope @ self.covariance @ slope.T))
        along = believed @ slope.T
        gain = np.linalg.solve(slope @ along, along.T).T
        together, covariance = self._all - gain @ off, believed - gain @ along.T
        n = len(together) - len(self.tape_errors)
        left = np.eye(len(together)) - gain @ slope
        askew = left @ self.askew @ left.T
        pair = self.pair.known_to(together[:n], covariance[:n, :n], askew[:n, :n])
        return replace(self, pair=pair, tape_errors=together[n:], covariance=covariance, askew=askew)

    def _with_tapes_times(self, ratio: float) -> FloatArray:
        """(n + T, n + T) covariance, the tapes' standard deviations that many times as large."""
        n = len(self.covariance) - len(self.tape_errors)
        wider = np.append(np.ones(n), np.full(len(self.tape_errors), ratio))
        return np.asarray(self.covariance * np.outer(wider, wider))

    @property
    def _all(self) -> FloatArray:
        of_fit = np.zeros(0) if self.pair.uncertainty is None else self.pair.uncertainty.unknowns
        return np.concatenate([of_fit, self.tape_errors])

    def _parts(self, together: FloatArray) -> tuple[StereoCalibration, FloatArray]:
        n = len(together) - len(self.tape_errors)
        return (self.pair.at(together[:n]) if n else self.pair), together[n:]


def _birge_ratio(off: FloatArray, covariance: FloatArray) -> float:
    """Root of chi-squared over its degrees of freedom; not below 1: that lengths agree by chance makes none better."""
    chi_squared = float(off @ np.linalg.solve(covariance, off))
    return max(1.0, float(np.sqrt(chi_squared / len(off))))
