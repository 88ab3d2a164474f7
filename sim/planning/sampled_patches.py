"""Patches for form factors by rays: judged by rays that leave their sixteenths, cut until those agree.

Light between the surfaces first bounces along a few rays of each patch; that is good enough to see how the irradiance
varies *within* patches (``sim.planning.linear_light``), which is measured, not guessed from neighbours. Where one
number a patch is enough, that is all. Otherwise light is taken as linear within each patch, and those are cut where it
bends, or where a shadow ends: the pieces' light is gathered from the patches as they were, so that only new pieces cost
rays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import BoolArray, FloatArray, IntArray
from sim.errors import SimulationError
from sim.form_factors.sampled import FIRST_RAYS, RaySample
from sim.geometry.adaptive_patches import AdaptivePatches, joined
from sim.light.lighting import Emission, Lighting, emission, remember_emission
from sim.planning.adapt import gradients, squared_light_edges
from sim.planning.linear_light import Senders, Variation, variation_within
from sim.planning.uneven_senders import UnevenSenders
from sim.progress import OnProgress, unheard

QUARTERS = 4
SAFETY = 1.15
"""The error that is expected over the one measured."""
TOTAL_SURE = 2.0
"""Standard deviations that are added to the sum of all."""
MEASURED = (1024, 4096)
"""Of more patches a choice, even over the surface, tells whether one number a patch is enough: a small one where it
suffices to tell."""
FEWEST_RAYS, PIECE_RAYS, MOST_RAYS = 8, 32, 128
"""Of a sixteenth, to measure with: more where noise hides whether the goal is met, fewer of pieces, which are small."""
NOISE_SHARE, NOISE_POWER = 0.5, 1.4
"""Of the goal's square that the measurement's noise may take before there are more rays, and how it falls with them."""
SENDER_RAYS, FEWEST_SENDER_RAYS, MOST_SENDER_RAYS = 1 << 13, 8, 256
"""Of all patches together, to learn what senders of one number change, and limits of those from each."""
BIAS_SHARE = 0.5
"""Of the goal's square; where senders change more, those that vary most are quartered, and light bounces anew."""
SENDERS_CUT = 0.9
"""Of the squared variation within all patches, that quartered ones hold."""
CUT_GAIN = 0.6
"""Of a patch's squared error, that quarters are expected to lose: 0.5 at a shadow's edge, 0.94 where light bends."""
AIM = 0.95
"""Share of the goal that cuts aim at."""
MUCH_LESS = 16.0
"""Patches of so many times less squared error than the worst wait for the next round."""
MOST_ROUNDS = 16
MOST_LOOKS = 12
"""At all patches anew; a corner with much trapped light takes four."""
FIRST_DONE, RAYS_DONE, NUMBERS_DONE, MEASURED_DONE = 0.3, 0.5, 0.6, 0.8
"""Shares of the work after its parts, roughly."""
RELOOK = 1.1
"""Times the patches of the start from which on light bounces between the pieces, and those are judged again."""
PROBE_ERROR, PROBE_POWER = 0.01, 1.4
"""Down to this goal light bounces along the first rays of each patch; for a smaller one along more, by the power."""
MOST_PROBE_RAYS = 512
MOST_BOUNCES = 40
STEADY = 0.005
"""Change from bounce to bounce of the share of light that one keeps, at which all further ones are known."""
FAR_OFF, MUCH_MORE, SLOWEST = 2.0, 1.5, 0.2
"""Times the goal beyond which progress is looked at, times the patches from which on it can be told, and the power of
the patches' number with which an error must fall: smooth light has 1/2, an edge in patches 1/4."""
BEGUN, MANY_TIMES, MANY, EDGED = 4, 24, 40_000, 0.45
"""Times the patches that a look began with from which on it is told where cutting leads; times as many, and patches in
all, that are too many (seconds of planning a look), where the error falls no faster than this power of their number. A
triangle soup of 479 facets has 0.34 to 0.44, random corners end long before."""
ADVICE = 1.6
"""The tolerance that is advised over the error reached: 1.25 for the patches' share, the rest for safety."""
OTHER_STREAM = 7919
"""Seeds of measuring rays lie this far from those of the form factors."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledPatches:
    """Patches for rays, and how good they are."""

    cells: AdaptivePatches
    linear: bool
    """Light has to be linear within each; else one number is enough."""
    error: float
    """Expected of light that is one number a patch, or linear, RMS over the surface, with safety; 1 = white."""
    spectral_radius: float
    """Share of the light that a bounce keeps."""


def patches_by_rays(
    start: AdaptivePatches,
    light: Lighting,
    *,
    goal: float,
    check_size: Callable[[int], None],
    seed: int = 0,
    on_progress: OnProgress = unheard,
) -> SampledPatches:
    """Return the fewest patches whose light is within ``goal`` of the one that varies within them.

    Parameters
    ----------
    start : AdaptivePatches
        To begin with: the coarsest that there may be.
    light : Lighting
    goal : float
        RMS over the surface; 1 = white.
    check_size : callable
        Raises an error where so many patches are too many.
    seed : int
        Of the rays.
    on_progress : callable
        Is told the share that is done, as far as it can be known.

    Returns
    -------
    SampledPatches
        After some rounds the error may still be above the goal.

    Raises
    ------
    SimulationError
        Where more patches hardly help, or those found are lit otherwise than the ones before them, again and again.
    """
    before = None
    for _ in range(MOST_LOOKS):
        look = _Look(start, light, goal=goal, check_size=check_size, seed=seed, on_progress=on_progress)
        found = look.found(before)
        if found is not None:
            return found
        start, before = look.cells, look.reached
    raise SimulationError(
        f"{start.n_patches:,} patches, made {MOST_LOOKS} times from coarser ones, still change the light by more than "
        f"{100 * goal:.2g} %: light is trapped between surfaces that cut through each other; try a tolerance of "
        f"{200 * goal:.2g} %, or cut them where they meet"
    )


class _Look:
    """Light bounced between some patches, and what it says of them."""

    def __init__(
        self,
        start: AdaptivePatches,
        light: Lighting,
        *,
        goal: float,
        check_size: Callable[[int], None],
        seed: int,
        on_progress: OnProgress,
    ) -> None:
        self.cells, self.light, self.goal, self.seed = start, light, goal, seed
        self.check_size, self.on_progress = check_size, on_progress
        self.reached = (start.n_patches, np.inf)
        """Patches that light was bounced between, and their error."""

    def found(self, before: tuple[int, float] | None) -> SampledPatches | None:
        """Return the patches, or None where others are to be begun with: then they are ``cells``.

        ``before``: what the look before this one reached. Raises SimulationError where more patches hardly help.
        """
        start, goal = self.cells, self.goal
        self.check_size(start.n_patches)
        lit = emission(start, self.light)
        bounces = _Bounces(start, goal=goal, seed=self.seed, on_progress=self.on_progress)
        pieces = _Pieces(start, self.light, lit, bounces=bounces, goal=goal, stream=self.seed + OTHER_STREAM)
        radius = pieces.spectral_radius
        constant = pieces.error_of_numbers()
        if constant <= goal:
            return SampledPatches(cells=start, linear=False, error=constant, spectral_radius=radius)
        self.on_progress(NUMBERS_DONE)
        pieces.measure_all()
        self.reached = (start.n_patches, pieces.error)
        if before is not None:
            _check_progress(before, self.reached, goal)
        if pieces.bias**2 > BIAS_SHARE * goal**2:
            pieces.cut_senders()
            self.cells = pieces.settled
            return None
        self._cut(pieces)
        self.cells = pieces.settled
        if self.cells.n_patches > RELOOK * start.n_patches:
            # Pieces may be lit otherwise than the patches that they were cut from: light is trapped beside some.
            return None
        return SampledPatches(cells=self.cells, linear=True, error=pieces.error, spectral_radius=radius)

    def _cut(self, pieces: _Pieces) -> None:
        first = max(pieces.error, self.goal * (1 + 1e-9))
        for _ in range(MOST_ROUNDS):
            way = np.log(first / max(pieces.error, self.goal)) / np.log(first / self.goal)
            self.on_progress(MEASURED_DONE + (1 - MEASURED_DONE) * float(way))
            if pieces.error <= self.goal:
                break
            before = pieces.cells.n_patches, pieces.error
            pieces.cut()
            self.check_size(pieces.cells.n_patches)
            now = pieces.cells.n_patches, pieces.error
            _check_progress(before, now, self.goal)
            _check_course((pieces.start.n_patches, first), now, self.goal)


def _check_progress(before: tuple[int, float], now: tuple[int, float], goal: float) -> None:
    """Raise SimulationError where more patches hardly help, each given with its error: light jumps within them."""
    (patches, error), (more, left) = before, now
    if left <= FAR_OFF * goal or more < MUCH_MORE * patches:
        return
    if np.log(error / left) < SLOWEST * np.log(more / patches):
        raise SimulationError(
            f"{patches:,} patches leave {100 * error:.2g} %, {more:,} still {100 * left:.2g} %, and {100 * goal:.2g} % "
            "are wanted: where surfaces cut through each other light jumps within patches; "
            f"try a tolerance of {100 * ADVICE * left:.2g} %, or cut them where they meet"
        )


def _check_course(begun: tuple[int, float], now: tuple[int, float], goal: float) -> None:
    """Raise SimulationError where cutting will need very many patches, each given with its error."""
    (patches, error), (more, left) = begun, now
    if left <= goal or more < BEGUN * patches:
        return
    power = max(np.log(error / left) / np.log(more / patches), SLOWEST)
    needed = more * (left / goal) ** (1 / power)
    if power < EDGED and needed > max(MANY_TIMES * patches, MANY):
        raise SimulationError(
            f"{patches:,} patches leave {100 * error:.2g} %, {more:,} still {100 * left:.2g} %, and {100 * goal:.2g} % "
            f"would take about {round(needed, -3):,.0f}: light jumps within most of them, as where surfaces cut "
            f"through each other; try a tolerance of {100 * ADVICE * left:.2g} %"
        )


class _Bounces:
    """Light that a few rays of each patch carry from bounce to bounce."""

    def __init__(self, cells: AdaptivePatches, *, goal: float, seed: int, on_progress: OnProgress) -> None:
        rays = FIRST_RAYS * max(1.0, PROBE_ERROR / goal) ** PROBE_POWER
        self.cells, self.kept = cells, 0.0
        self.sample = RaySample.first(cells, seed)
        on_progress(FIRST_DONE)
        self.sample.lengthen(2 ** round(np.log2(min(rays, MOST_PROBE_RAYS))))
        on_progress(RAYS_DONE)

    def all_of(self, E: FloatArray) -> FloatArray:
        """(P,) radiosity by an emission (P,); ``kept`` is then the share of the light that a bounce keeps."""
        cells, term, B = self.cells, E, E.copy()
        kept, sent = 0.0, float(cells.areas @ np.abs(E))
        for _ in range(MOST_BOUNCES):
            if sent <= 0:
                break
            term = cells.reflectance * self.sample.halves(term).mean
            left, before = float(cells.areas @ np.abs(term)), kept
            B, kept, sent = B + term, min(left / sent, 1 - STEADY), left
            if abs(kept - before) <= STEADY * (1 - kept):
                break
        self.kept = kept
        return B + term * kept / (1 - kept)


class _Pieces:
    """Patches on their way to pieces within which light is linear enough."""

    def __init__(
        self, start: AdaptivePatches, light: Lighting, lit: Emission, *, bounces: _Bounces, goal: float, stream: int
    ) -> None:
        self.start, self.light, self.lit, self.goal, self.stream = start, light, lit, goal, stream
        self.area = float(start.areas.sum())
        self.bounces = bounces
        self.senders = Senders.even(start, bounces.all_of(start.reflectance * lit.irradiance))
        self.spectral_radius = bounces.kept
        self.cells, self.own, self.lit_cells = start, np.arange(start.n_patches), lit
        self.rays, self.bias = FEWEST_RAYS, 0.0
        self.edges = squared_light_edges(start, lit.variance, start)
        self.doubt = 0.0
        self.squared, self.noise = np.zeros((2, start.n_patches))

    def error_of_numbers(self) -> float:
        """Return the error that one number a patch leaves, from a choice of patches that is even over the surface."""
        error = np.inf
        for most in MEASURED:
            count = min(self.start.n_patches, most)
            error = self._error_of_some(count)
            if error <= self.goal or count == self.start.n_patches:
                break
        return error

    def _error_of_some(self, count: int) -> float:
        chosen, weight = np.arange(count), np.ones(count)
        if count < self.start.n_patches:
            shares = np.cumsum(self.start.areas) / self.area
            chosen = np.searchsorted(shares, (np.arange(count) + 0.5) / count)
            weight = self.area / count / self.start.areas[chosen]
        cells = self.start.chosen(chosen)
        seen = self._seen(cells, chosen)
        scale = weight * cells.areas * cells.reflectance**2
        measured = scale * seen.beside_constant
        spread = float(np.sqrt(count) * measured.std()) if count < self.start.n_patches else 0.0
        self.doubt = TOTAL_SURE * float(np.sqrt(((scale * seen.noise) ** 2).sum()))
        total = float(measured.sum()) + float(np.hypot(self.doubt, TOTAL_SURE * spread)) + float(self.edges.sum())
        return self._error(total)

    def measure_all(self) -> None:
        """Measure all patches beside linear light, by as many rays as it takes to tell if the goal is met."""
        B, rho = self.senders.B, self.start.reflectance
        received = np.divide(B, rho, out=np.zeros_like(B), where=rho > 0)
        received -= self.lit.irradiance
        slopes = rho[:, None] * gradients(self.start, received)[0]
        self.senders = Senders(surface=self.start, B=B, slopes=slopes)
        more = (self.doubt / (NOISE_SHARE * self.goal**2 * self.area)) ** (1 / NOISE_POWER)
        self.rays = int(np.clip(2 ** np.ceil(np.log2(FEWEST_RAYS * more)), FEWEST_RAYS, MOST_RAYS))
        seen = self._seen(self.cells, self.own)
        self.squared, self.noise = self._scaled(self.cells, seen)
        self.varies = self.start.areas * rho**2 * (seen.beside_constant + self.lit.variance)
        self.doubt = TOTAL_SURE * float(np.sqrt((self.noise**2).sum()))
        senders = UnevenSenders(cells=self.start, light=self.light, lit=self.lit, pieces=seen.pieces)
        self.bias = self._bias_by(senders)

    def _bias_by(self, senders: UnevenSenders) -> float:
        """RMS over the surface of what senders of one number change, by as many rays as it takes to tell if it counts.

        Its own noise is added to its square.
        """
        rays = int(np.clip(SENDER_RAYS // self.start.n_patches, FEWEST_SENDER_RAYS, MOST_SENDER_RAYS))
        while True:
            # What reaches a pocket where light is trapped bounces there many times.
            one, other = (
                self.bounces.all_of(self.start.reflectance * shift) for shift in senders.shifts(rays, self.stream)
            )
            noise = (one - other) ** 2 / 2
            variance = self.start.areas**2 * noise * (2 * np.maximum(one * other, 0.0) + noise)
            doubt = TOTAL_SURE * float(np.sqrt(variance.sum()))
            sure = max(float(self.start.areas @ (one * other)), 0.0) + doubt
            if doubt <= NOISE_SHARE * BIAS_SHARE * self.goal**2 * self.area or 4 * rays > MOST_SENDER_RAYS:
                return float(np.sqrt(sure / self.area))
            rays *= 4

    @property
    def error(self) -> float:
        """Expected of light that is linear within the pieces, with safety; 1 = white."""
        total = float(self.squared.sum()) + self.doubt + float(self.edges.sum())
        return float(np.hypot(self._error(total), self.bias))

    def cut_senders(self) -> None:
        """Quarter the patches that hold most of what one number a patch leaves: what they send is wrong by it."""
        order = np.argsort(self.varies)[::-1]
        held = np.cumsum(np.maximum(self.varies[order], 0.0))
        self._quarter(order[: int(np.searchsorted(held, SENDERS_CUT * held[-1])) + 1])

    def cut(self) -> None:
        """Quarter as many of the worst pieces as seem to be needed, and measure the quarters."""
        squared = np.maximum(self.squared - self.noise, 0.0) + self.edges
        order = np.argsort(squared)[::-1]
        worst = squared[order]
        allowed = max(self.goal**2 - self.bias**2, 0.0) * (AIM / SAFETY) ** 2 * self.area
        excess = float((self.squared + self.edges).sum()) + self.doubt - allowed
        enough = int(np.searchsorted(CUT_GAIN * np.cumsum(worst), excess)) + 1
        chosen = order[: min(enough, int((worst > worst[0] / MUCH_LESS).sum()) + 1)]
        self._quarter(chosen)

    def _quarter(self, chosen: IntArray) -> None:
        kept = np.ones(self.cells.n_patches, dtype=bool)
        kept[chosen] = False
        pieces, own = self.cells.chosen(chosen).quarters(), np.tile(self.own[chosen], QUARTERS)
        self.rays = min(self.rays, PIECE_RAYS)
        squared, noise = self._scaled(pieces, self._seen(pieces, own))
        lit = emission(pieces, self.light)
        edges = squared_light_edges(pieces, lit.variance, self.start)
        self.lit_cells = _joined_light(self.lit_cells, kept, lit)
        self.cells, self.own = joined(self.cells.chosen(kept), pieces), np.concatenate([self.own[kept], own])
        self.squared = np.concatenate([self.squared[kept], squared])
        self.noise = np.concatenate([self.noise[kept], noise])
        self.edges = np.concatenate([self.edges[kept], edges])
        self.doubt = TOTAL_SURE * float(np.sqrt((self.noise**2).sum()))

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

    def _seen(self, cells: AdaptivePatches, own: IntArray) -> Variation:
        return variation_within(cells, own, self.senders, rays=self.rays, stream=self.stream)

    def _scaled(self, cells: AdaptivePatches, seen: Variation) -> tuple[FloatArray, FloatArray]:
        """Squared error times area beside linear light, and its standard deviation [m²]."""
        scale = cells.areas * cells.reflectance**2
        return scale * seen.beside_linear, scale * seen.noise


def _joined_light(before: Emission, kept: BoolArray, more: Emission) -> Emission:
    irradiance, variance = (
        np.concatenate([old[kept], new])
        for old, new in ((before.irradiance, more.irradiance), (before.variance, more.variance))
    )
    return Emission(irradiance, variance)
