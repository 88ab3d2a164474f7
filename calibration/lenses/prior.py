"""What lenses and boards are like before any is measured: what counts where views are too few to tell their terms.

Without it a fit to three views takes terms that it lacks for zero, and is sure of what it does not know.
"""

from __future__ import annotations

import numpy as np

from calibration.arrays import FloatArray
from calibration.lenses.bundle import BEND, CAMERA, PROJECTOR, SHARED, STRETCH
from calibration.lenses.lens import PARAMETERS
from calibration.lenses.records import BoardSightings

_RADIAL = 0.5
"""Standard deviation of k1, k2 and k3, about zero: lenses of 60 to 100 degrees without correction come to 0.4."""
_TANGENTIAL = 0.003
"""Of p1 and p2: a glass that leans by 0.2 degrees, as consumer lenses' do."""
_BEND = 0.002
"""Of a board's bend, share of its longer side: a print on cardboard or foam of 0.3 m is bent by half a millimetre."""

_STRETCH = 0.003
"""By which squares are longer than wide: office printers feed paper to some tenths of a per cent."""


def no_prior() -> FloatArray:
    """(S,) zeros: nothing is known beforehand of any shared unknown."""
    return np.zeros(SHARED)


def prior_of(sightings: BoardSightings) -> FloatArray:
    """(S,) inverse variances of the shared unknowns about zero; 0 for those of which nothing is known.

    Parameters
    ----------
    sightings : BoardSightings
        Of a board, whose size counts.
    """
    sigma = np.full(SHARED, np.inf)
    for lens in (CAMERA, PROJECTOR):
        sigma[lens] = [_sigma_of(name) for name in PARAMETERS]
    sigma[BEND] = _BEND * 2 * max(sightings.half_size_m)
    sigma[STRETCH] = _STRETCH
    return np.asarray(1 / sigma**2)


def _sigma_of(name: str) -> float:
    if name in ("p1", "p2"):
        return _TANGENTIAL
    return _RADIAL if name.startswith("k") else np.inf
