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
from operator import attrgetter

import numpy as np

from sim.errors import SimulationError
from sim.geometry.adaptive_patches import AdaptivePatches
from sim.geometry.crossings import crossings_each, cut_where_crossed
from sim.light.lighting import Lighting, emission
from sim.planning.sampled.bounces import Bounces
from sim.planning.sampled.pieces import Pieces
from sim.progress import OnProgress, unheard

BIAS_SHARE = 0.5
"""Of the goal's square; where senders change more, those that vary most are cut, and light bounces anew."""
MOST_ROUNDS = 16
MOST_LOOKS = 12
"""At all patches anew; a corner with much trapped light takes six."""
NUMBERS_DONE, MEASURED_DONE = 0.6, 0.8
"""Shares of the work after its parts, roughly."""
RELOOK = 1.1
"""Times the patches of the start from which on light bounces between the pieces, and those are judged again."""
FEW_CROSSINGS, CROSSINGS_OF = 2.0, 100
"""A patch, on average over so many, up to which all are cut where they are crossed before light is looked at within
them: random corners have 0 to 0.6; of a soup of triangles only those are that hold much of the error."""
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


@dataclass(frozen=True, kw_only=True)
class _Reached:
    """What a look found, and which patches it cut."""

    patches: int
    """That light was bounced between."""
    error: float
    """Of light that is linear within them."""
    bias: float
    """Part of it that comes from what they send as one number each."""
    senders_cut: bool
    """Those were cut that vary most, for the bias; else those that were hit worst, for the error."""


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
        self.reached = _Reached(patches=start.n_patches, error=np.inf, bias=np.inf, senders_cut=False)

    def found(self, before: _Reached | None) -> SampledPatches | None:
        """Return the patches, or None where others are to be begun with: then they are ``cells``.

        ``before``: what the look before this one reached. Raises SimulationError where more patches hardly help.
        """
        start, goal = self.cells, self.goal
        self.check_size(start.n_patches)
        lit = emission(start, self.light)
        bounces = Bounces(start, goal=goal, seed=self.seed, on_progress=self.on_progress)
        pieces = Pieces(start, self.light, lit, bounces=bounces, goal=goal, stream=self.seed + OTHER_STREAM)
        radius = pieces.spectral_radius
        if before is None:
            constant = pieces.error_of_numbers()
            if constant <= goal:
                return SampledPatches(cells=start, linear=False, error=constant, spectral_radius=radius)
            self.cells = _without_crossings(start)
            if self.cells.n_patches > start.n_patches:
                return None
        self.on_progress(NUMBERS_DONE)
        pieces.measure_all()
        bias = BIAS_SHARE**0.5 * goal
        uneven = pieces.bias > bias
        now = _Reached(patches=start.n_patches, error=pieces.error, bias=pieces.bias, senders_cut=uneven)
        self.reached = now
        if before is not None:
            left = attrgetter("bias" if before.senders_cut else "error")
            _check_progress((before.patches, left(before)), (now.patches, left(now)), goal)
        if uneven:
            pieces.cut_senders(bias)
            self.cells = pieces.settled
            return None
        self._cut(pieces)
        self.cells = pieces.settled
        if self.cells.n_patches > RELOOK * start.n_patches:
            # Pieces may be lit otherwise than the patches that they were cut from: light is trapped beside some.
            return None
        return SampledPatches(cells=self.cells, linear=True, error=pieces.error, spectral_radius=radius)

    def _cut(self, pieces: Pieces) -> None:
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
            check_course((pieces.start.n_patches, first), now, self.goal)


def _without_crossings(cells: AdaptivePatches) -> AdaptivePatches:
    """Patches cut where others pass through them, whole from here on; the same ones where most are crossed often."""
    if crossings_each(cells, CROSSINGS_OF) > FEW_CROSSINGS:
        return cells
    pieces, _ = cut_where_crossed(cells)
    return cells if pieces.n_patches == cells.n_patches else replace(pieces, whole=np.arange(pieces.n_patches))


def _check_progress(before: tuple[int, float], now: tuple[int, float], goal: float) -> None:
    """Raise SimulationError where more patches hardly help, each given with its error: light jumps within them."""
    (patches, error), (more, left) = before, now
    if left <= FAR_OFF * goal or more < MUCH_MORE * patches:
        return
    if np.log(error / left) < SLOWEST * np.log(more / patches):
        raise SimulationError(
            f"{patches:,} patches leave {100 * error:.2g} %, {more:,} still {100 * left:.2g} %, and {100 * goal:.2g} % "
            "are wanted: light jumps within patches, as where surfaces cut through each other, or end close before "
            f"others; try a tolerance of {100 * ADVICE * left:.2g} %, or cut them where they meet"
        )


def check_course(begun: tuple[int, float], now: tuple[int, float], goal: float) -> None:
    """Raise SimulationError where cutting will need very many patches.

    Parameters
    ----------
    begun, now : (int, float)
        Patches that a look began with, and those that there are now, each with the error that they leave; 1 = white.
    goal : float
        Error that is wanted.
    """
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
