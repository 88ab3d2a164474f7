"""Whether the points agree with lenses that boards measured."""

from __future__ import annotations

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.bundle_unknowns import LENS_TERMS, lens_units, wide_priors
from calibration.geometry.known.lenses import TERMS, KnownLenses
from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.noise import SIGMAS, normal_deviate
from calibration.geometry.plane_bundle import BundleSolution, refit

_IN_PX = 3
"""Terms that are lengths in the picture: f, cx, cy."""


class OtherLens(CalibrationError):
    """The points contradict a lens that boards measured."""


def hold_against_boards(solution: BundleSolution) -> None:
    """Refuse lenses by boards that the points contradict.

    The points are fitted once more with lenses that are known no better than by data sheets. What comes out and what
    the boards say may differ by what both leave open.

    Parameters
    ----------
    solution : BundleSolution
        A fit with all that is known.

    Raises
    ------
    OtherLens
        With the device, the term that is furthest off, both values and their sigmas.
    """
    nominal, variance = solution.error.nominal, solution.fit.priors.weight
    if nominal.known.both == (None, None):
        return
    free = refit(solution.error, solution, variance, priors=wide_priors(solution, nominal, variance))
    told = contradiction(free.fit.z, free.covariance, nominal, nominal.known)
    if told:
        raise OtherLens(told)


def contradiction(unknowns: FloatArray, covariance: FloatArray, nominal: NominalIntrinsics, known: KnownLenses) -> str:
    """Say which lens by boards a fit without it contradicts, by how much, and what to do; empty where none.

    Parameters
    ----------
    unknowns, covariance : (n,), (n, n)
        Of a fit that did not know the lenses.
    nominal : NominalIntrinsics
        In whose units its unknowns are.
    known : KnownLenses
        What boards say.
    """
    units = lens_units(nominal)
    found, own = unknowns[: len(units)] * units, covariance[: len(units), : len(units)] * np.outer(units, units)
    together = own + known.covariance()
    worst, most = "", SIGMAS
    for k, (device, lens) in enumerate(zip(("camera", "projector"), known.both, strict=True)):
        if lens is None:
            continue
        at = slice(k * TERMS, (k + 1) * TERMS)
        off = found[at] - lens.brown.values
        sigmas = normal_deviate(float(off @ np.linalg.solve(together[at, at], off)), TERMS)
        if sigmas > most:
            sigma = np.sqrt(np.diag(own)[at]), np.sqrt(np.diag(known.covariance())[at])
            worst, most = _told(device, found[at], lens.brown.values, sigma, sigmas=sigmas), sigmas
    return worst


def _told(
    device: str, found: FloatArray, expected: FloatArray, sigma: tuple[FloatArray, FloatArray], *, sigmas: float
) -> str:
    term = int(np.argmax(np.abs(found - expected) / np.hypot(*sigma)))
    unit, digits = (" px", 1) if term < _IN_PX else ("", 4)
    return (
        f"the points contradict the {device}'s lens file: without it {LENS_TERMS[term]} comes out "
        f"{found[term]:.{digits}f} +- {sigma[0][term]:.{digits}f}{unit}, the file says {expected[term]:.{digits}f} +- "
        f"{sigma[1][term]:.{digits}f}{unit}; all its terms together are {sigmas:.0f} sigma off, the limit is "
        f"{SIGMAS:g}. The file is of another lens, zoom, focus or picture size: calibrate this one with boards again "
        "(rig lenses), or leave the lens file out"
    )
