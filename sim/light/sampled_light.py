"""Rays where the light needs them: a sample grows row by row until the radiosity is within an error.

Light is solved by reciprocal factors. What a patch receives, H_k, is then known twice: by its own rays, and by a row of
the reciprocal factors, which hold others' rays that met it, too. Both share the row's sum s, but of what is met, b =
H / s, a share o of the reciprocal is told by others' rays. With the noise of own rays dH = b ds + q, seen in the two
halves of a row, that which both share is b ds + (1 - o) q, and of

    H_k = own + w (reciprocal - own),   var = dH² - 2 w o dH q + w² (reciprocal - own)²

the w of the least error is taken, from 0 to 1/2. A reciprocal that is noisier than rows tell differs more from them, so
that it counts for less, and the error says so.

The error reaches the radiosity of all patches by (I - rho F)^-1, so that the mean square over the surface is

    sum_k w_k rho_k^2 var(H_k) / sum_i A_i,   w_k = sum_i A_i [(I - rho F)^-1]_ik^2.

w_k is estimated by one adjoint solution for light of random signs. To n times as many rays var falls as n^-GAIN, and
rows get the numbers that reach the goal with the fewest rays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from sim.arrays import FloatArray, IntArray
from sim.form_factors.sampled import MOST_RAYS, RaySample, SampledFormFactors, sampled_form_factors
from sim.geometry.surface import Surface
from sim.light.radiosity import Radiosity
from sim.progress import OnProgress, unheard

GAIN = 1.4
"""Variance falls as rays^-GAIN: 1.43 from 64 to 1,024 rays in the corner with a ball, 1.3 in random corners."""
NEIGHBOURS = 12
"""Patches that a row's variance is averaged over: two halves tell little of one row alone."""
CURVE_CELLS = 1023
"""Of the curve along which patches are neighbours, each way."""
MOST_AT_ONCE = 8
"""Times as many rays at most before the error is looked at again."""
AIM = 0.95
"""Share of the wanted error that a round aims at, so that few end just above it."""
MOST_RECIPROCAL = 0.5
"""Share of the reciprocal factors: more would be better by 3 % at the most."""
SOLVER_SHARE = 0.01
"""Of the goal, that the solver of a round may leave."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledLight:
    """Form factors by rays, and how well they know the light that they were made for."""

    sample: RaySample
    factors: SampledFormFactors
    B: FloatArray
    """(P,) radiosity, in the unit of the emission: what is emitted, and of the irradiance by rays what is sent back."""
    error: float
    """RMS over the surface of B, estimated from the halves of the rays; in the unit of the emission."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Received:
    """Irradiance that rays bring, by the best mean of each patch's own and of the reciprocal factors."""

    H: FloatArray
    """(P,) in the unit of the radiosity."""
    variance: FloatArray
    """(P,) of it: noisy in one row, right in the mean of many."""
    own_variance: FloatArray
    """(P,) of own rays alone."""
    share: float
    """Of the reciprocal factors in H, 0 to 1/2."""


def received(sample: RaySample, factors: SampledFormFactors, B: FloatArray, weights: FloatArray) -> Received:
    """Return what patches receive from radiosities by their own rays and by reciprocal factors.

    Parameters
    ----------
    sample : RaySample
    factors : SampledFormFactors
        Of the sample.
    B : (P,) array
        Radiosities.
    weights : (P,) array
        What the squared error of each patch counts.

    Returns
    -------
    Received
    """
    own, sums = sample.halves(B), sample.row_sums
    met = np.divide(own.mean, sums.mean, out=np.zeros_like(own.mean), where=sums.mean > 0)
    noise = (own.first - own.second) / 2
    # What own rays miss by in the light that they meet, but not in how many meet something, others' rays do not share.
    gain = factors.by_others * noise * (noise - met * (sums.first - sums.second) / 2)
    apart = factors.apply(B) - own.mean
    differ = float(weights @ apart**2)
    share = float(np.clip(weights @ gain / differ, 0.0, MOST_RECIPROCAL)) if differ > 0 else 0.0
    return Received(
        H=own.mean + share * apart,
        variance=np.maximum(noise**2 - 2 * share * gain + share**2 * apart**2, 0.0),
        own_variance=noise**2,
        share=share,
    )


def sampled_light(
    surface: Surface,
    E: FloatArray,
    reflectance: FloatArray,
    *,
    error: float,
    seed: int = 0,
    sample: RaySample | None = None,
    most_rays: int = MOST_RAYS,
    on_progress: OnProgress = unheard,
) -> SampledLight:
    """Return form factors by as many rays as the radiosity of an emission asks for.

    Parameters
    ----------
    surface : Surface
    E : (P,) array
        Emission.
    reflectance : (P,) array
        In [0, 1].
    error : float
        Wanted RMS over the surface of the radiosity, in the unit of E.
    seed : int
        Another one for other rays.
    sample : RaySample, optional
        Of the surface, to go on with.
    most_rays : int
        Of a patch; where they are not enough, ``error`` of the result says so.
    on_progress : callable
        Is told the share of the rays that are sent, after each round.

    Returns
    -------
    SampledLight

    Raises
    ------
    SimulationError
        As :class:`sim.light.radiosity.Radiosity` does.
    """
    sample = RaySample.first(surface, seed) if sample is None else sample
    order = along_curve(surface)
    goal = error**2 * float(surface.areas.sum())
    while True:
        light, weights, seen = _solved(sample, E, reflectance, error)
        # As many rays as bring the error that is left to the wanted one.
        on_progress(min(1.0, (error / max(light.error, error)) ** (2 / GAIN)))
        squared = float(weights @ seen.variance)
        if squared <= goal or (sample.rays >= most_rays).all():
            return light
        variance = seen.variance
        less = squared / max(float(weights @ seen.own_variance), np.finfo(float).tiny)
        # The light of few rays tells well enough where more are needed; the next solution confirms it.
        while float(weights @ variance) > goal and not (sample.rays >= most_rays).all():
            _lengthen(sample, weights, variance, order, goal=goal, most_rays=most_rays)
            # Reciprocal factors of the longer sample are made in the next solution: until then they gain as much.
            variance = less * sample.halves(light.B).standard_error ** 2


def lengthened(sample: RaySample, squared: FloatArray, *, goal: float) -> RaySample:
    """Return the sample with more rays where squared errors of patches, averaged over neighbours, are large.

    Parameters
    ----------
    sample : RaySample
        It is lengthened in place.
    squared : (P,) array
        Mean square over each patch of an error that falls as its rays' does; may be negative for one patch, but not on
        average.
    goal : float
        Wanted RMS over the surface, in the unit of the error.

    Returns
    -------
    RaySample
    """
    areas, order = np.asarray(sample.surface.areas), along_curve(sample.surface)
    _lengthen(sample, areas, squared, order, goal=goal**2 * float(areas.sum()), most_rays=MOST_RAYS)
    return sample


def _lengthen(
    sample: RaySample, weights: FloatArray, squared: FloatArray, order: IntArray, *, goal: float, most_rays: int
) -> None:
    """Send more rays where squared errors are large on average, until their weighted sum should be within the goal."""
    smooth = weights * _smooth(squared, order)
    each = smooth * float(weights @ squared) / smooth.sum()
    sample.lengthen(_wanted(sample.rays, each, AIM**2 * goal, most_rays))


def _solved(
    sample: RaySample, E: FloatArray, reflectance: FloatArray, error: float
) -> tuple[SampledLight, FloatArray, Received]:
    """The light of a sample, (P,) what each row's squared error of the irradiance weighs, and the irradiance."""
    factors = sampled_form_factors(sample)
    scale = max(float(np.sqrt((E**2).mean())), np.finfo(float).tiny)
    system = Radiosity(factors, reflectance, tolerance=float(np.clip(SOLVER_SHARE * error / scale, 1e-12, 1e-3)))
    weights = reflectance**2 * _weights(system, sample.seed)
    seen = received(sample, factors, system.solve(E), weights)
    rms = float(np.sqrt(weights @ seen.variance / factors.areas.sum()))
    light = SampledLight(sample=sample, factors=factors, B=E + reflectance * seen.H, error=rms)
    return light, weights, seen


def _weights(system: Radiosity, seed: int) -> FloatArray:
    """(P,) w_k, its diagonal part known and the rest from one random adjoint solution [m²]."""
    areas = system.form_factors.areas
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(areas))
    light = signs * np.sqrt(areas)
    return np.asarray(areas + (system.solve_adjoint(light) - light) ** 2)


def along_curve(surface: Surface) -> IntArray:
    """Return (P,) patches along Morton's curve through their centres: most of those that come together lie together."""
    centres = np.asarray(surface.centres)
    low = centres.min(axis=0)
    size = max(float((centres.max(axis=0) - low).max()), np.finfo(float).tiny)
    code = np.zeros(len(centres), dtype=np.int64)
    cells = ((centres - low) * (CURVE_CELLS / size)).astype(np.int64)
    for bit in range(CURVE_CELLS.bit_length()):
        for axis in range(3):
            code |= (cells[:, axis] >> bit & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


def _smooth(variance: FloatArray, order: IntArray) -> FloatArray:
    """(P,) means over the patches about each in the order."""
    smooth = np.empty_like(variance)
    smooth[order] = uniform_filter1d(variance[order], min(NEIGHBOURS, len(order)), mode="nearest")
    return np.maximum(smooth, 0.0)  # a running sum leaves -1e-20 of zeros


def _wanted(rays: IntArray, squared: FloatArray, goal: float, most_rays: int) -> IntArray:
    """(P,) powers of 2 that bring the sum of the rows' squared errors to the goal, or nearer."""
    need = (squared * rays.astype(np.float64) ** GAIN) ** (1 / (1 + GAIN))
    highest = np.minimum(MOST_AT_ONCE * rays, most_rays)
    # Rows whose halves agree wait; where all of them do, all go on.
    need = np.maximum(need, 1e-6 * need.max()) if need.any() else np.ones(len(rays))
    matters = squared >= 1e-3 * squared.max()
    scale = _least_scale(squared, rays / need, np.log2(highest / rays), goal)
    high = min(scale, float((highest / need)[matters].max()))
    wanted = _rounded(rays, high * need, highest)
    # The worst rows at least, so that every round adds some.
    least = np.where(squared >= squared.max(), np.minimum(2 * rays, most_rays), rays)
    return np.asarray(np.maximum(wanted, least))


def _least_scale(squared: FloatArray, begin: FloatArray, most: FloatArray, goal: float) -> float:
    """Return the least scale of needs at which rows, doubled at most ``most`` (P,) times, are within the goal; or inf.

    ``begin``: (P,) scale at which each row has what it needs; it is doubled where its need is nearer to twice as many.
    """
    doublings = np.arange(1, MOST_AT_ONCE.bit_length())[:, None]
    at = np.where(doublings <= most, begin * 2.0 ** (doublings - 0.5), np.inf).ravel()
    gained = (squared * (2.0 ** (GAIN - GAIN * doublings) - 2.0 ** (-GAIN * doublings))).ravel()
    order = np.argsort(at)
    left = float(squared.sum()) - np.cumsum(gained[order])
    enough = int(np.searchsorted(-left, -goal))
    return float(at[order[enough]]) * (1 + 1e-9) if enough < len(order) else np.inf


def _rounded(rays: IntArray, wanted: FloatArray, highest: IntArray) -> IntArray:
    """Powers of 2 times what there is, up to the highest."""
    doublings = np.round(np.log2(np.clip(wanted / rays, 1.0, MOST_AT_ONCE)))
    return np.asarray(np.minimum(rays * 2 ** doublings.astype(np.intp), highest))
