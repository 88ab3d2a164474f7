"""Light that is linear within patches: its slopes, and what neither a number nor a slope a patch tells of it.

The rays that count a patch's form factors begin all over it: what each brings times where it began is the first moment
of the irradiance, and that over the patch's second moments its slope. Neighbours tell a slope as well, without noise,
and wrongly where light bends or shadows end; it is taken where the measured one does not contradict it.

For a plan, rays leave each sixteenth of a patch, in the same directions for all of them: their light then differs by
what they see, hardly by noise. Two streams of rays are independent: the product of what both show beside the slope has
no bias by noise, so that its sum over thousands of patches is known well where hardly one is. It also sees what no
gradient between neighbours tells: a patch that another one pierces or covers in part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.ndimage import uniform_filter1d

from sim.arrays import BoolArray, FloatArray, IntArray
from sim.form_factors.sampled import RaySample, tree_of
from sim.geometry.adaptive_patches import PIECES, AdaptivePatches, Sixteenths
from sim.geometry.rays import plane_axes
from sim.geometry.surface import Surface
from sim.light.sampled_light import GAIN, along_curve
from sim.planning.adapt import gradients

SEEN_OF_LINEAR = 15 / 16
"""Share of the squared variation of a linear field that shows between the sixteenths of a patch."""
SEEN_OF_BEND, SEEN_OF_STEP = 0.7, 0.47
"""Of what is left beside the slope, over lines in all directions through squares and triangles: 0.70 to 0.78 where a
field bends, 0.66 to 0.76 where it bends sharply, 0.42 to 0.50 where it steps."""
STEP_SHARE, STEP_HEIGHT = 0.1, 0.03
"""It is taken for a step where that is more than this share of the squared variation, and its root more than this share
of the light. Of all that steps along such lines leave, 98 to 100 % is left where the share is above 0.1, and 86 to 87 %
where it is above 0.15 (tests/sim/planning/test_steps_and_bends.py); lower steps are known 1.2 times too small at most,
the root of 0.70 / 0.47."""
STEP_SURE = 3.0
"""Standard deviations of noise beyond which it is: else sums over patches, whose noise cancels, would gain the noise of
those where it is positive, more with each patch."""
FREE = 3
"""Degrees of freedom that the noise of sixteenths has at least: they share their directions."""
PATCHES_AT_A_TIME = 1 << 12
"""Their sixteenths take 13 MB."""
SURE = 9.0
"""Squared difference of a measured slope from what neighbours tell, over its noise, from which they are wrong."""
ALL_NOISE, HALF_NOISE = 1 / (2**GAIN - 1), 1.25
"""Squared noise of a whole sequence, and of a half, over the square of half the difference of its halves. These
complement each other: if they did not, 1 and 2. By ``GAIN`` 0.61 and 1.61, as in random corners (0.64 measured); in the
corner with a ball the second is nearer to 1. With 1.25 squared errors come out 1.0 to 1.5 times too large by 256 rays a
patch (random corners 3 and 5, corner with a ball), 1.6 to 3.1 times by 64."""
ABOUT = 33
"""Patches whose noise and errors say what one may have, itself left out: 12 and 100 leave errors that differ by 5 %."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Senders:
    """Patches that send light, with radiosities that may be linear within each."""

    surface: Surface
    B: FloatArray
    """(P,) means; 1 = white."""
    slopes: FloatArray
    """(P, 3) gradients in each patch's plane [1/m]."""

    @classmethod
    def even(cls, surface: Surface, B: FloatArray) -> Senders:
        """Return senders of one number a patch."""
        return cls(surface=surface, B=B, slopes=np.zeros((surface.n_patches, 3)))

    @property
    def fields(self) -> FloatArray:
        """(P, 5) means, and of the linear fields their value at the origin and gradients."""
        at_origin = self.B - np.einsum("pk,pk->p", self.slopes, self.surface.centres)
        return np.concatenate([self.B[:, None], at_origin[:, None], self.slopes], axis=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Variation:
    """Of the irradiance within patches. Squares are means over each patch, without bias by noise."""

    beside_constant: FloatArray
    """(P,) squared, of what one number leaves."""
    beside_linear: FloatArray
    """(P,) squared, of what one number and the slopes leave."""
    noise: FloatArray
    """(P,) standard deviation of both."""
    pieces: tuple[FloatArray, FloatArray]
    """(16, P) irradiance of sixteenths over their patch's mean, by either stream of rays."""

    def chosen(self, patches: BoolArray | IntArray) -> Variation:
        """Return that of some patches."""
        return _each(lambda values: values[..., patches], self)

    def joined(self, others: Variation) -> Variation:
        """Return that of these patches and others after them."""
        return _each(lambda *both: np.concatenate(both, axis=-1), self, others)

    def replaced(self, patches: IntArray, by: Variation) -> Variation:
        """Return that of all patches, with others of some, in their order."""
        return _each(partial(_replaced, patches), self, by)


def _each(change: Callable[..., FloatArray], *variations: Variation) -> Variation:
    """What a change makes of each array, the patches along its last axis."""
    one, other = (change(*(variation.pieces[k] for variation in variations)) for k in (0, 1))
    return Variation(
        beside_constant=change(*(variation.beside_constant for variation in variations)),
        beside_linear=change(*(variation.beside_linear for variation in variations)),
        noise=change(*(variation.noise for variation in variations)),
        pieces=(one, other),
    )


def _replaced(patches: IntArray, values: FloatArray, by: FloatArray) -> FloatArray:
    changed = values.copy()
    changed[..., patches] = by
    return changed


def gathered(cells: AdaptivePatches, own: IntArray, senders: Senders, *, rays: int, stream: int) -> FloatArray:
    """Return what rays bring to the sixteenths of patches.

    Parameters
    ----------
    cells : AdaptivePatches
        P of them.
    own : (P,) int array
        The sender that each patch lies on.
    senders : Senders
    rays : int
        From each sixteenth.
    stream : int
        Another one for other rays.

    Returns
    -------
    (16, P, 2) array
        Irradiances by senders of one number, and by linear ones; pieces as ``cells.quarters().quarters()``.
    """
    return _gathered(_sixteenths(cells), own, senders, rays=rays, stream=stream)


def _gathered(cut: list[Sixteenths], own: IntArray, senders: Senders, *, rays: int, stream: int) -> FloatArray:
    """(16, P, 2) as :func:`gathered`, of the sixteenths' corners, some patches at a time."""
    tree, fields = tree_of(senders.surface), np.ascontiguousarray(senders.fields)
    parts, first = [], 0
    for some in cut:
        count = len(some.areas) // PIECES
        lies_on = np.tile(own[first : first + count], PIECES).astype(np.int64)
        means = np.empty((len(some.areas), 2))
        tree.gather(some.corners, lies_on, stream, rays, light=fields, means=means)
        parts.append(means.reshape(PIECES, count, 2))
        first += count
    return np.concatenate(parts, axis=1)


def _sixteenths(cells: AdaptivePatches) -> list[Sixteenths]:
    """Those of some patches at a time."""
    parts = []
    for first in range(0, cells.n_patches, PATCHES_AT_A_TIME):
        place = np.arange(first, min(first + PATCHES_AT_A_TIME, cells.n_patches))
        parts.append(cells.chosen(place).sixteenths())
    return parts


def variation_within(cells: AdaptivePatches, own: IntArray, senders: Senders, *, rays: int, stream: int) -> Variation:
    """Return how the irradiance varies within patches; arguments as for :func:`gathered`, of two streams of rays."""
    cut = _sixteenths(cells)
    offset, share = _pieces(cells, cut)
    both = [_gathered(cut, own, senders, rays=rays, stream=number) for number in (stream, stream + 1)]
    means = [np.einsum("np,npk->pk", share, light) for light in both]
    one, other = (light[..., 1] - mean[:, 1] for light, mean in zip(both, means, strict=True))
    left, right = (_beside_linear(light, offset, share) for light in (one, other))
    noise = (share * (left - right) ** 2).sum(axis=0) / 2 / np.sqrt(FREE)
    beside_constant = (share * one * other).sum(axis=0) / SEEN_OF_LINEAR
    beside_linear = (share * left * right).sum(axis=0)
    middle = (means[0][:, 1] + means[1][:, 1]) / 2
    step = (beside_linear > STEP_SHARE * beside_constant) & (beside_linear > (STEP_HEIGHT * middle) ** 2)
    step &= beside_linear > STEP_SURE * noise
    seen = np.where(step, SEEN_OF_STEP, SEEN_OF_BEND)
    return Variation(
        beside_constant=beside_constant,
        beside_linear=beside_linear / seen,
        noise=noise / seen,
        pieces=(one, other),
    )


def variance_of_product(product: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the variance of a product of two measurements of one thing, whose noise of a variance is independent."""
    return np.asarray(noise * (2 * np.maximum(product, 0.0) + noise))


def _beside_linear(light: FloatArray, offset: FloatArray, share: FloatArray) -> FloatArray:
    """(16, P) what is left of deviations from the mean, once their slope is taken out."""
    weighed = share[..., None] * offset
    moments = np.einsum("npa,npb->pab", weighed, offset)
    slope = np.einsum("pab,npb,np->pa", _inverse(moments), weighed, light, optimize=True)
    return np.asarray(light - np.einsum("npa,pa->np", offset, slope))


def _inverse(moments: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.pinv(moments, rcond=1e-9, hermitian=True))


def _pieces(cells: AdaptivePatches, cut: list[Sixteenths]) -> tuple[FloatArray, FloatArray]:
    """(16, P, 2) places of the sixteenths about each patch's centre [m], and (16, P) shares of its area."""
    place = np.concatenate([some.centres.reshape(PIECES, -1, 3) for some in cut], axis=1) - cells.centres
    areas = np.concatenate([some.areas.reshape(PIECES, -1) for some in cut], axis=1)
    return np.einsum("npk,pak->npa", place, plane_axes(cells)), areas / cells.areas


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearLight:
    """Slopes of the irradiance within patches, and how well they are known."""

    slopes: FloatArray
    """(P, 3) gradients in each patch's plane [1/m]; where they make light negative there is none."""
    squared_error: FloatArray
    """(P,) of the linear field that they make, mean over each patch, without bias: may be negative for one patch."""


def linear_light(sample: RaySample, cells: AdaptivePatches, B: FloatArray, irradiance: FloatArray) -> LinearLight:
    """Return the slopes of the irradiance that a sample's rays and neighbours tell.

    What neighbours tell is taken for nothing where one half of the rays contradicts it: the other half then says what
    error that leaves, rather too much than too little. The slope is the mean of both, each with the weight that it has
    by the errors of other patches beside: those of its own would make it look better than it is.

    Parameters
    ----------
    sample : RaySample
        Of the cells.
    cells : AdaptivePatches
    B, irradiance : (P,) array
        Means; 1 = white.

    Returns
    -------
    LinearLight
    """
    axes, moments = plane_axes(cells), _second_moments(cells)
    inverse = _inverse(moments)
    halves = sample.moment_halves(B)
    measured, *both = (
        np.einsum("pab,pbk,pk->pa", inverse, axes, moment, optimize=True)
        for moment in (halves.mean, halves.first, halves.second)
    )
    told = np.einsum("pak,pk->pa", axes, gradients(cells, irradiance, in_sight=True)[0])
    differ = _mean_square((both[0] - both[1]) / 2, moments)
    noise, order = ALL_NOISE * differ, along_curve(cells)
    usual_noise = _of_others(noise * cells.areas, order) / cells.areas
    kept = [_uncontradicted(told, half, moments, noise=2**GAIN * usual_noise) for half in both]
    beside = (kept[0] + kept[1]) / 2
    contradicted = [_mean_square(half - other, moments) for half, other in zip(both, kept[::-1], strict=True)]
    error = (contradicted[0] + contradicted[1]) / 2 - HALF_NOISE * differ
    usual_error = _of_others(error * cells.areas, order) / cells.areas
    both_errors = usual_error + usual_noise
    share = np.divide(usual_error, both_errors, out=np.zeros_like(both_errors), where=both_errors > 0)
    return LinearLight(
        slopes=np.einsum("pa,pak->pk", beside + share[:, None] * (measured - beside), axes),
        squared_error=share**2 * noise + (1 - share) ** 2 * error,
    )


def _uncontradicted(told: FloatArray, seen: FloatArray, moments: FloatArray, *, noise: FloatArray) -> FloatArray:
    """(P, 2) slopes that neighbours tell, 0 where what is seen is nearer to that, or further off than noise can be."""
    differs = _mean_square(seen - told, moments)
    wrong = (differs > SURE * noise) | (_mean_square(seen, moments) < differs)
    return np.where(wrong[:, None], 0.0, told)


def _of_others(values: FloatArray, order: IntArray) -> FloatArray:
    """(P,) means over the patches about each in the order, but without its own; none below 0. Of few, over all."""
    if len(order) <= ABOUT:
        return np.full_like(values, max(float(values.mean()), 0.0))
    others = np.empty_like(values)
    others[order] = uniform_filter1d(values[order], ABOUT, mode="nearest") * ABOUT - values[order]
    return np.maximum(others / (ABOUT - 1), 0.0)


def _mean_square(slopes: FloatArray, moments: FloatArray) -> FloatArray:
    """(P,) mean over each patch of the square of a linear field about its centroid."""
    return np.asarray(np.einsum("pa,pab,pb->p", slopes, moments, slopes))


def _second_moments(cells: AdaptivePatches) -> FloatArray:
    """(P, 2, 2) about the centroid, along the plane's axes [m²]."""
    u, v = np.moveaxis(plane_axes(cells), 1, 0)
    uu, vv, both = (cells.variation(direction) / cells.areas for direction in (u, v, u + v))
    uv = (both - uu - vv) / 2
    return np.stack([np.stack([uu, uv], axis=1), np.stack([uv, vv], axis=1)], axis=1)
