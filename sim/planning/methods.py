"""Which form factors are the cheapest for so many patches at a tolerance: exact ones, compressed ones, or rays.

Seconds are predicted from constants that were measured on two cores of a busy machine, so that the same scene always
gets the same plan. What rays take hardly depends on what stands in the way; exact shadows take ever longer.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim.form_factors.sampled import FIRST_RAYS, MOST_RAYS

PAIR_S = {"closed_form": 1e-7, "polygon": 2e-7}
"""A pair without shadows: room-with-box, spheres and sloped rooms of 320 to 2,304 patches. [s]"""
SHADOW_S = {"none": 0.0, "fair": 4e-8, "exact": 1.5e-7}
"""And its shadow, for each occluder of the scene, if they are few: room-with-box, 700 and 1,800 patches. [s]"""
MOST_SHADOW_S = {"none": 0.0, "fair": 7e-6, "exact": 3e-5}
"""However many there are: corner with a ball, 134 to 614 patches. [s]"""
RAY_S = 2e-7
"""One ray with its count in the matrix, on two cores, 2,000 to 100,000 patches. [s]"""
RAY_PRODUCT_S = 4e-9
"""A ray's share of a product with the sparse matrix. [s]"""
SAMPLING_START_S = 0.005
"""Rounds of solving and of looking where rays are missing. [s]"""
USUAL_ERROR, USUAL_RAYS, ERROR_POWER = 0.013, 64, 1.4
"""RMS of the radiosity by so many rays a patch, and how their number grows with a smaller error: corners with a ball
and with other things, 64 to 1,024 rays."""
PLANNING_RAYS, LINEAR_PLANNING_RAYS = 500, 1300
"""Of a patch, to find patches by: where one number a patch is enough, and where it is not."""
FIRST_PROBE = 500
"""Patches of the first solution that a plan is made from."""
COMPARED = 3
"""A round of planning by exact factors solves once more on so many times fewer patches, to compare."""
ROUND_S, ROUND_PATCH_S = 0.02, 8e-5
"""And takes, beside the factors: box rooms of 166 to 500 patches and a sphere of 1,280, on one core. [s]"""
USUAL_PATCHES = 300
"""That rooms of reflectance 0.7 take for 1 % in light on the floor; their number falls as the tolerance's square."""
USUAL_GAIN = 0.7**2 / (1 - 0.7)
"""Of light between such walls; theirs is the variation within patches."""
EVEN_PATCHES = 3
"""Patches of equal size have to be so many times as many."""
PREFER_EXACT = 1.5
"""Exact factors that take at most so many times as long as rays are preferred: they leave no noise."""
LEAST_SAVED_S = 0.04
"""Rays that save less are not worth their noise either: nobody tells such methods apart. [s]"""
RAY_MB = 5.3e-5
"""Peak memory by ray that an error usually takes: what it meets, counts and matrix from both sides, 8e-6 to 2.4e-5 a
ray, of up to four times as many where slopes want to be known, too; 2.0e-5 to 5.3e-5 (random corners of 600 to 3,000
facets, rooms and a ball at 0.1 to 1 %)."""


def exact_s(patches: int, *, method: str, visibility: str, occluders: int) -> float:
    """Return what the whole matrix of exact form factors takes [s]."""
    shadow_s = min(SHADOW_S[visibility] * occluders, MOST_SHADOW_S[visibility])
    return patches**2 * (PAIR_S[method] + shadow_s)


def rays_needed(error: float) -> float:
    """Return the rays a patch that an RMS error of the radiosity usually takes; 1 = white."""
    return float(np.clip(USUAL_RAYS * (USUAL_ERROR / error) ** ERROR_POWER, FIRST_RAYS, MOST_RAYS))


def sampled_s(patches: int, error: float) -> float:
    """Return what form factors by rays take [s]."""
    return SAMPLING_START_S + patches * rays_needed(error) * RAY_S


def sampled_mb(patches: int, error: float) -> float:
    """Return the peak memory of form factors by rays."""
    return patches * rays_needed(error) * RAY_MB


def largest_sampled(memory_mb: float, error: float) -> int:
    """Return the most patches whose rays fit."""
    return int(memory_mb / (RAY_MB * rays_needed(error)))


def usual_patches(tolerance: float, reflectance: float) -> int:
    """Return the patches that rooms of a mean reflectance usually take by exact factors; tolerance: 1 = white."""
    gain = reflectance**2 / max(1 - reflectance, 0.01)
    return int(np.ceil(USUAL_PATCHES * (gain / USUAL_GAIN * 0.01 / tolerance) ** 2))


def planning_s(factors_s: Callable[[int], float], probe: int, needed: int, *, adapted: bool) -> float:
    """Return what planning on a solution takes by exact factors, with the solution on the patches that are needed [s].

    Parameters
    ----------
    factors_s : callable
        Seconds of the form factors of so many patches.
    probe, needed : int
        Patches of the next solution that is planned on, and of the plan.
    adapted : bool
        That solution's patches are small where they have to be: it is not followed by another one.

    Returns
    -------
    float
    """
    seconds = probe_s(factors_s, probe) + factors_s(needed)
    if 2 * needed <= probe:
        # A plan that is coarser than the solution is measured against it.
        return seconds + factors_s(needed)
    if adapted:
        return seconds
    return seconds + probe_s(factors_s, max(needed // COMPARED, FIRST_PROBE))


def probe_s(factors_s: Callable[[int], float], probe: int) -> float:
    """Return what a solution on so many patches takes that is planned on, and compared with a coarser one [s]."""
    return ROUND_S + ROUND_PATCH_S * probe + factors_s(probe) + factors_s(probe // COMPARED)


def rays_pay(patches: int, error: float, left_s: float, *, linear: bool) -> bool:
    """Tell if rays, and finding patches by them, are so much faster than exact factors that their noise is worth it.

    Parameters
    ----------
    patches : int
    error : float
        That the rays may leave; 1 = white.
    left_s : float
        What is left to do by exact factors. [s]
    linear : bool
        One number a patch will not be enough.

    Returns
    -------
    bool
    """
    seconds = rays_s(patches, error, linear=linear)
    return left_s > max(PREFER_EXACT * seconds, seconds + LEAST_SAVED_S)


def rays_s(patches: int, error: float, *, linear: bool) -> float:
    """Return what finding patches by rays takes, with the solution on them [s]; arguments as for :func:`rays_pay`."""
    planning = LINEAR_PLANNING_RAYS if linear else PLANNING_RAYS
    return sampled_s(patches, error) + planning * RAY_S * patches


def bounces_needed(spectral_radius: float, tolerance_percent: float) -> int:
    """Return the bounces after which what is left, r^(n + 1) / (1 - r), is below a tenth of the tolerance."""
    if spectral_radius <= 0:
        return 0
    left = tolerance_percent / 1000 * (1 - spectral_radius)
    return max(1, int(np.ceil(np.log(left) / np.log(spectral_radius))) - 1) if left < spectral_radius else 1
