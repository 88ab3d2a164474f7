"""What a model expects of light transport, and by what unknowns it may be wrong.

The model's row T₀ of a place is wrong by

    Δ(l) = s b(l) k(l)·z + s Σ g(l) z' + Σ λ ρ(l) z"  ,  z, z', z" of variance 1,

relative errors that are alike for neighbouring patches (k, a factor of their covariance), ways of light that the model
leaves out (g: gloss), and what the model's own parameters leave open (λ ρ, directions times their standard deviations).
Direct light may be off, too: by h times the picture's share of white's direct light, less its share of white's global
light, for white itself was measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False, kw_only=True)
class TransportPrior:
    """What a model expects of N places' global light by L lit patches, and where it may be wrong."""

    transport: FloatArray
    """(N, L) T₀: light by each patch as white lights it."""
    base: FloatArray
    """(N, L) light that relative errors are of: T₀, but nowhere nothing."""
    kernel: FloatArray
    """(L, R) factor of the covariance of relative errors."""
    spread: FloatArray
    """(N,) their standard deviation."""
    lobes: NDArray[np.floating[Any]]
    """(N, M, L) light by ways that the model leaves out, of as much as `spread` of each."""
    left: FloatArray
    """(N, Q) light by the model's own open parameters, a standard deviation of each ..."""
    right: FloatArray
    """(Q, L) ... and by which patches."""
    own: FloatArray
    """(N,) standard deviation of white's direct light that is taken for global light."""

    @property
    def white(self) -> FloatArray:
        """(N,) global light of white."""
        return np.asarray(self.transport.sum(axis=1))

    def at(self, places: IntArray | slice) -> TransportPrior:
        """Return some of the places."""
        names = ("transport", "base", "spread", "lobes", "left", "own")
        return replace(self, **{name: getattr(self, name)[places] for name in names})

    def features(self, lit: FloatArray, own: FloatArray) -> FloatArray:
        """Return (N, J, D) by what each unknown changes the light of J pictures.

        Parameters
        ----------
        lit : (J, L)
            Light on each patch, as a share of white's.
        own : (J, N)
            Direct light at each place, as a share of white's.
        """
        return self.spread_over(self.of_one(lit, own))

    def of_one(self, lit: FloatArray, own: FloatArray) -> FloatArray:
        """Return what `features` does for a spread of 1: it stays as it is while the spread is looked for."""
        n_places, n_kernel, n_lobes = len(self.spread), self.kernel.shape[1], self.lobes.shape[1]
        found = np.empty((n_places, len(lit), n_kernel + n_lobes + self.left.shape[1] + 1))
        relative, left_out, open_ones, _ = np.split(found, np.cumsum([n_kernel, n_lobes, self.left.shape[1]]), axis=2)
        # One product of matrices for all pictures, and none of places x pictures x patches.
        by_picture = lit.T[:, :, None] * self.kernel[:, None, :]
        relative[:] = (self.base @ by_picture.reshape(len(by_picture), -1)).reshape(relative.shape)
        by_lobe = self.lobes.reshape(-1, self.lobes.shape[2]) @ lit.T.astype(self.lobes.dtype)
        left_out[:] = by_lobe.reshape(n_places, n_lobes, len(lit)).transpose(0, 2, 1)
        open_ones[:] = self.left[:, None, :] * (lit @ self.right.T)[None]
        share = self.transport @ lit.T / np.maximum(self.white, np.finfo(float).tiny)[:, None]
        found[..., -1] = self.own[:, None] * (own.T - share)
        return found

    def spread_over(self, of_one: FloatArray) -> FloatArray:
        """Return the features (N, J, D) of what `of_one` has found."""
        scale = np.ones((len(of_one), 1, of_one.shape[2]))
        scale[:, 0, : self.kernel.shape[1] + self.lobes.shape[1]] = self.spread[:, None]
        return np.asarray(of_one * scale)
