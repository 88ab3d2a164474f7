"""Patches on their way to pieces within which light is linear enough, judged by rays that leave their sixteenths.

Few patches hold most of what is left, and others most of the measurement's noise. The first are cut: along the lines
where others pass through them, for there light steps, and in quarters where nothing does. From the second more rays
leave, until their noise no longer hides whether the goal is met.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.arrays import BoolArray, FloatArray, IntArray
from sim.geometry.adaptive_patches import AdaptivePatches, joined
from sim.geometry.crossings import cut_where_crossed
from sim.light.lighting import Emission, Lighting, emission, remember_emission
from sim.planning.adapt import gradients, squared_light_edges
from sim.planning.linear_light import Senders, Variation, variance_of_product, variation_within
from sim.planning.sampled.bounces import Bounces
from sim.planning.sampled.uneven_senders import UnevenSenders

QUARTERS = 4
SAFETY = 1.15
"""The error that is expected over the one measured."""
TOTAL_SURE = 2.0
"""Standard deviations that are added to the sum of all."""
MEASURED = (1024, 4096)
"""Of more patches a choice, even over the surface, tells whether one number a patch is enough: a small one where it
suffices to tell."""
FEWEST_RAYS, MOST_RAYS, MORE_RAYS = 8, 2048, 4
"""Of a sixteenth, to measure with, and times as many where noise hides whether the goal is met: in few patches."""
NOISE_SHARE, NOISE_SHARE_AT_MOST = 0.2, 0.35
"""Of the goal's square that the measurement's noise may take before there are more rays, and once rays are dear: what
noise takes is made up by cuts. A ball of 5,984 facets at 0.3 % is planned in 0.6 s, with 0.2 to the end in 1.2 s, into
as many patches; six random corners of 600 facets at 1 % take 7,481 patches, with 0.35 from the beginning 8,738."""
FEW_RAYS = 1 << 19
"""Are cheap: all that were sent to measure with."""
NOISE_POWER = 1.4
"""How noise falls with rays."""
SENDER_RAYS, FEWEST_SENDER_RAYS, MOST_SENDER_RAYS = 1 << 13, 8, 256
"""Of all patches together, to learn what senders of one number change, and limits of those from each."""
SENDER_NOISE, MORE_SENDER_RAYS = 0.25, 4
"""Of the goal's square that its noise may take before there are more rays, and how many times as many."""
BELOW = 0.4
"""Of the squared variation that may be left: a cut is expected to leave a quarter, and at an edge leaves half."""
LEAST_LEFT = 1 / 8
"""Of the squared variation within all patches, that one look at them cuts away at most."""
CUT_GAIN = 0.6
"""Of a patch's squared error, that quarters are expected to lose: 0.5 at a shadow's edge, 0.94 where light bends."""
AIM = 0.95
"""Share of the goal that cuts aim at."""
MUCH_LESS = 16.0
"""Patches of so many times less squared error than the worst wait for the next round."""


class Pieces:
    """Patches, the light that they send, and pieces of them, with what is left of the light within each."""

    def __init__(
        self, start: AdaptivePatches, light: Lighting, lit: Emission, *, bounces: Bounces, goal: float, stream: int
    ) -> None:
        self.start, self.light, self.lit, self.goal, self.stream = start, light, lit, goal, stream
        self.area = float(start.areas.sum())
        self.bounces = bounces
        self.senders = Senders.even(start, bounces.all_of(start.reflectance * lit.irradiance))
        self.spectral_radius = bounces.kept
        self.cells, self.own, self.lit_cells = start, np.arange(start.n_patches), lit
        self.bias = 0.0
        self._sent = 0

    def error_of_numbers(self) -> float:
        """Return the error that one number a patch leaves, from a choice of patches that is even over the surface."""
        error = np.inf
        for most in MEASURED:
            count = min(self.start.n_patches, most)
            least, error = self._errors_of_some(count)
            if error <= self.goal or least > self.goal or count == self.start.n_patches:
                break
        return error

    def _errors_of_some(self, count: int) -> tuple[float, float]:
        """The least and the greatest error that is likely."""
        chosen, weight = np.arange(count), np.ones(count)
        if count < self.start.n_patches:
            shares = np.cumsum(self.start.areas) / self.area
            chosen = np.searchsorted(shares, (np.arange(count) + 0.5) / count)
            weight = self.area / count / self.start.areas[chosen]
        cells = self.start.chosen(chosen)
        seen = self._measured(cells, chosen)
        scale = weight * cells.areas * cells.reflectance**2
        measured = scale * seen.beside_constant
        spread = float(np.sqrt(count) * measured.std()) if count < self.start.n_patches else 0.0
        doubt = TOTAL_SURE * float(np.hypot(np.sqrt(((scale * seen.noise) ** 2).sum()), spread))
        # What the lamp's edges change at receivers is guessed here; where light is linear it is measured.
        total = float(measured.sum()) + float(squared_light_edges(self.start, self.lit.variance, self.start).sum())
        return self._error(total - doubt), self._error(total + doubt)

    def measure_all(self) -> None:
        """Measure all patches beside linear light, by as many rays as it takes to tell if the goal is met."""
        B, rho = self.senders.B, self.start.reflectance
        received = np.divide(B, rho, out=np.zeros_like(B), where=rho > 0)
        received -= self.lit.irradiance
        slopes = rho[:, None] * gradients(self.start, received, in_sight=True)[0]
        self.senders = Senders(surface=self.start, B=B, slopes=_without_negative_light(self.start, B, slopes))
        self.seen, self.rays = self._measured(self.cells, self.own), np.full(self.cells.n_patches, FEWEST_RAYS)
        self._sharpen()
        self.varies = self.start.areas * rho**2 * (self.seen.beside_constant + self.lit.variance)
        senders = UnevenSenders(cells=self.start, light=self.light, lit=self.lit, pieces=self.seen.pieces)
        self.bias = self._bias_by(senders)

    def _bias_by(self, senders: UnevenSenders) -> float:
        """RMS over the surface of what senders of one number change, by as many rays as it takes to tell if it counts.

        Its own noise is added to its square.
        """
        each = int(np.clip(SENDER_RAYS // self.start.n_patches, FEWEST_SENDER_RAYS, MOST_SENDER_RAYS))
        rays = 1 << (each.bit_length() - 1)
        while True:
            # What reaches a pocket where light is trapped bounces there many times.
            one, other = (
                self.bounces.all_of(self.start.reflectance * shift) for shift in senders.shifts(rays, self.stream)
            )
            noise = (one - other) ** 2 / 2
            variance = self.start.areas**2 * variance_of_product(one * other, noise)
            doubt = TOTAL_SURE * float(np.sqrt(variance.sum()))
            sure = max(float(self.start.areas @ (one * other)), 0.0) + doubt
            known = doubt <= SENDER_NOISE * self.goal**2 * self.area
            if known or MORE_SENDER_RAYS * rays > MOST_SENDER_RAYS:
                return float(np.sqrt(sure / self.area))
            rays *= MORE_SENDER_RAYS

    @property
    def squared(self) -> FloatArray:
        """(pieces,) squared error times area beside linear light, without bias by noise [m²]."""
        return self.cells.areas * self.cells.reflectance**2 * self.seen.beside_linear

    @property
    def noise(self) -> FloatArray:
        """(pieces,) its standard deviation [m²]."""
        return self.cells.areas * self.cells.reflectance**2 * self.seen.noise

    @property
    def doubt(self) -> float:
        """What noise may hide of the sum of squared errors [m²]."""
        return TOTAL_SURE * float(np.sqrt((self.noise**2).sum()))

    @property
    def error(self) -> float:
        """Expected of light that is linear within the pieces, with safety; 1 = white."""
        return float(np.hypot(self._error(float(self.squared.sum()) + self.doubt), self.bias))

    def cut_senders(self, bias: float) -> None:
        """Cut patches, the most uneven twice, until what one number each leaves seems to change no more than `bias`."""
        levels = cuts_of(self.varies, BELOW * (bias / self.bias) ** 2)
        chosen = np.flatnonzero(levels)
        pieces, parents = _divided(self.cells.chosen(chosen))
        again = levels[chosen[parents]] > 1
        finer, _ = _divided(pieces.chosen(np.flatnonzero(again)))
        self._replace(levels == 0, joined(pieces.chosen(np.flatnonzero(~again)), finer))

    def cut(self) -> None:
        """Cut as many of the worst pieces as seem to be needed, and measure what they are cut into."""
        squared = np.maximum(self.squared - self.noise, 0.0)
        order = np.argsort(squared)[::-1]
        worst = squared[order]
        allowed = max(self.goal**2 - self.bias**2, 0.0) * (AIM / SAFETY) ** 2 * self.area
        excess = float(self.squared.sum()) + self.doubt - allowed
        enough = int(np.searchsorted(CUT_GAIN * np.cumsum(worst), excess)) + 1
        self._divide(order[: min(enough, int((worst > worst[0] / MUCH_LESS).sum()) + 1)])
        self._sharpen()

    def _divide(self, chosen: IntArray) -> None:
        kept = np.ones(self.cells.n_patches, dtype=bool)
        kept[chosen] = False
        pieces, parents = _divided(self.cells.chosen(chosen))
        own = self.own[chosen[parents]]
        self._replace(kept, pieces)
        self.seen = self.seen.chosen(kept).joined(self._measured(pieces, own))
        self.own = np.concatenate([self.own[kept], own])
        self.rays = np.concatenate([self.rays[kept], np.full(pieces.n_patches, FEWEST_RAYS)])

    def _replace(self, kept: BoolArray, pieces: AdaptivePatches) -> None:
        self.lit_cells = _joined_light(self.lit_cells, kept, emission(pieces, self.light))
        self.cells = joined(self.cells.chosen(kept), pieces)

    @property
    def settled(self) -> AdaptivePatches:
        """The pieces, from here on patches of their own."""
        if self.cells is self.start:
            return self.start
        cells = replace(self.cells, whole=np.arange(self.cells.n_patches))
        remember_emission(cells, self.light, self.lit_cells)
        return cells

    def _error(self, squared: float) -> float:
        return SAFETY * float(np.sqrt(max(squared, 0.0) / self.area))

    def _measured(self, cells: AdaptivePatches, own: IntArray, rays: int = FEWEST_RAYS) -> Variation:
        self._sent += QUARTERS**2 * rays * cells.n_patches
        return variation_within(cells, own, self.senders, rays=rays, stream=self.stream)

    def _sharpen(self) -> None:
        """Send more rays from the pieces that hold most of the noise, until it no longer hides if the goal is met."""
        while len(chosen := self._noisy()):
            for rays in np.unique(self.rays[chosen]):
                some = np.sort(chosen[self.rays[chosen] == rays])
                better = self._measured(self.cells.chosen(some), self.own[some], MORE_RAYS * int(rays))
                self.seen = self.seen.replaced(some, better)
            self.rays[chosen] *= MORE_RAYS

    def _noisy(self) -> IntArray:
        """Pieces whose noise has to fall: none where noise is small beside the goal, or beside a greater error."""
        may_be = max(self.goal**2 * self.area, float(self.squared.sum()))
        share = NOISE_SHARE if self._sent < FEW_RAYS else NOISE_SHARE_AT_MOST
        excess = float((self.noise**2).sum()) - (share * may_be / TOTAL_SURE) ** 2
        noise = np.where(self.rays < MOST_RAYS, self.noise, 0.0)
        order = np.argsort(noise)[::-1]
        gain = (1 - MORE_RAYS ** (-2 * NOISE_POWER)) * np.cumsum(noise[order] ** 2)
        count = int(np.searchsorted(gain, excess)) + 1 if excess > 0 else 0
        return order[:count][noise[order[:count]] > 0]


def cuts_of(varies: FloatArray, share: float) -> IntArray:
    """Return how often patches are cut in quarters, 0 to 2 times, for a share of their squared variation to be left.

    Each cut leaves a quarter of it, and makes of a patch four, of four sixteen: those come first that cut most away for
    each patch that they make.

    Parameters
    ----------
    varies : (P,)
        Squared variation of the light within each patch, times area; below 0 by noise alone.
    share : float
        Of their sum, which may be left.
    """
    squared = np.maximum(varies, 0.0)
    gains = np.concatenate([squared * 3 / 4, squared * 3 / 16])
    worth = np.concatenate([squared / 4, squared / 64])
    order = np.argsort(-worth, kind="stable")
    enough = (1 - max(share, LEAST_LEFT)) * squared.sum()
    chosen = order[: int(np.searchsorted(np.cumsum(gains[order]), enough)) + 1]
    return np.bincount(chosen % len(squared), minlength=len(squared))


def _without_negative_light(cells: AdaptivePatches, B: FloatArray, slopes: FloatArray) -> FloatArray:
    """Slopes, less steep where light would be below 0 in a patch: neighbours beyond a shadow's edge tell such."""
    heights = np.einsum("pck,pk->pc", cells.vertices - cells.centres[:, None], slopes)
    deepest, light = -heights.min(axis=1), np.maximum(B, 0.0)
    share = np.divide(light, deepest, out=np.ones_like(light), where=deepest > light)
    return np.asarray(slopes * share[:, None])


def _divided(cells: AdaptivePatches) -> tuple[AdaptivePatches, IntArray]:
    """Patches cut where others cross them, or else in quarters, and the patch that each piece was cut from."""
    pieces, parents = cut_where_crossed(cells)
    whole = np.bincount(parents, minlength=cells.n_patches) == 1
    quartered, crossed = np.flatnonzero(whole), ~whole[parents]
    return (
        joined(pieces.chosen(crossed), cells.chosen(quartered).quarters()),
        np.concatenate([parents[crossed], np.tile(quartered, QUARTERS)]),
    )


def _joined_light(before: Emission, kept: BoolArray, more: Emission) -> Emission:
    irradiance, variance = (
        np.concatenate([old[kept], new])
        for old, new in ((before.irradiance, more.irradiance), (before.variance, more.variance))
    )
    return Emission(irradiance, variance)
