"""What a plan finds, as frozen records; light in lux and cd/m², errors in grey levels: 255 is the white wanted."""

from __future__ import annotations

from dataclasses import dataclass

from rig.plan.paints import ChosenPaint
from rig.plan.projectors.numbers import ProjectorNumbers
from rig.plan.search.records import SearchResult
from rig.records import Record


@dataclass(frozen=True, kw_only=True)
class SurfaceLight(Record):
    """One surface while the projector shows white."""

    name: str
    area_m2: float
    paint: ChosenPaint
    coverage: float
    """Share of its area inside the picture; 0 ... 1."""
    direct_lux: float
    """From the projector, mean over the whole surface. [lx]"""
    indirect_lux: float
    """From the other surfaces. [lx]"""
    ambient_lux: float
    """With the projector off. [lx]"""
    white_cdm2: float
    """Luminance of white, all light: mean over its part of the picture, or over all where there is none. [cd/m²]"""
    white_min_cdm2: float
    """Of the darkest twentieth of that part. [cd/m²]"""
    black_cdm2: float
    """Of black there. [cd/m²]"""
    contrast: float
    """White over black, the whole picture white or black, room light in both."""
    global_share: float
    """Of white's light there, what came from other surfaces, room light left out; 0 ... 1."""
    px_per_m: float | None = None
    """Projector pixels a metre, median over the picture's area; None: no picture there."""
    px_per_m_least: float | None = None
    """Of its coarsest twentieth."""


@dataclass(frozen=True, kw_only=True)
class ContrastSteps(Record):
    """From the projector's own contrast to what is left of it in the room, by area."""

    projector: float
    """Full white over full black, the projector alone; of several the least."""
    full_in_room: float
    """The same in the room, its light included."""
    checker_dark_room: float
    """Mean of the white over mean of the black fields of a 4 x 4 checker, no room light."""
    checker_in_room: float
    """The same with room light."""


@dataclass(frozen=True, kw_only=True)
class StrategyOutcome(Record):
    """A strategy on a picture: |seen - wanted| over the pixels that meet a surface."""

    strategy: str
    error: float
    """Mean. [grey levels]"""
    rms: float
    """[grey levels]"""
    max: float
    """[grey levels]"""
    error_cdm2: float
    """Mean. [cd/m²]"""
    psnr_db: float
    """Of 255 over the rms."""
    clipped_share: float
    """Of the projector's pixels, that are held at black or white; 0 ... 1."""
    gain: float | None = None
    """What ``none`` scales the picture by, 1 = full drive for white; None for others."""


@dataclass(frozen=True, kw_only=True)
class UnreachedPart(Record):
    """Where the certified optimum still misses a picture by more than a fiftieth of white."""

    surface: str
    too_dark_m2: float
    """Area that stays darker than wanted: the projector is at white there, or would wash out what is beside. [m²]"""
    too_bright_m2: float
    """Area that stays brighter than wanted: light from other walls, the room's light, the projector's black. [m²]"""
    mean_cdm2: float
    """Mean of seen - wanted over all of the picture there. [cd/m²]"""


@dataclass(frozen=True, kw_only=True)
class PlannedPicture(Record):
    """One picture in the room."""

    name: str
    wanted_mean_cdm2: float
    global_share: float
    """Of the light seen uncompensated, what came from other surfaces; 0 ... 1."""
    strategies: tuple[StrategyOutcome, ...]
    optimum_gap: float
    """How far the optimum's squared error can be above the least one, as a share: its certificate."""
    unreached: tuple[UnreachedPart, ...]

    def outcome(self, strategy: str) -> StrategyOutcome:
        """Return the outcome of a strategy that was asked for."""
        return next(one for one in self.strategies if one.strategy == strategy)


@dataclass(frozen=True, kw_only=True)
class ShadowOf(Record):
    """What a person keeps from the walls."""

    person: str
    picture_share: float
    """Of the projector's pixels that end on the person; 0 ... 1."""
    by_surface_m2: dict[str, float]
    """Area in shadow. [m²]"""
    dazzled: bool
    """Light of the projector meets the top quarter of the person: the face."""


@dataclass(frozen=True, kw_only=True)
class ViewerSight(Record):
    """What a viewer sees of the picture."""

    name: str
    visible_share: float
    """Of the picture's area, not hidden by furniture; 0 ... 1."""
    px_per_deg: float
    """Projector pixels a degree, median over the picture as the viewer sees it; eyes tell 60 apart."""
    px_per_deg_least: float
    """Of its coarsest twentieth."""
    white_cdm2: float
    """Mean over the visible picture, by solid angle. [cd/m²]"""
    error: float
    """Mean error of ``bounded`` on the first picture, by solid angle. [grey levels]"""


@dataclass(frozen=True, kw_only=True)
class PlanTotals(Record):
    """The plan in few numbers."""

    coverage: float
    """Share of the room's surface inside the picture."""
    lit_m2: float
    white_cdm2: float
    """Mean luminance of white over the picture's area. [cd/m²]"""
    wanted_white_cdm2: float
    reached_share: float
    """Of the picture's area, where white is at least as bright as wanted; 0 ... 1."""
    uniformity: float
    """Darkest twentieth of white over its mean."""
    global_share: float
    """Of white's light over the picture's area, what came from other surfaces, room light left out; 0 ... 1."""
    indirect_lux: float
    """Mean over the whole room, projector white. [lx]"""
    px_per_m: float
    """Median over the picture's area."""
    paint_cost: float
    """Area times cost of the paints, openings left out."""
    projector_cost: float


@dataclass(frozen=True, kw_only=True)
class PlanResult(Record):
    """What a room will be like."""

    name: str
    projectors: tuple[ProjectorNumbers, ...]
    patches: int
    pixels: tuple[int, int]
    """Columns and rows of the first projector's pictures, as computed."""
    totals: PlanTotals
    contrast: ContrastSteps
    surfaces: tuple[SurfaceLight, ...]
    pictures: tuple[PlannedPicture, ...]
    shadows: tuple[ShadowOf, ...]
    viewers: tuple[ViewerSight, ...]
    remarks: tuple[str, ...]
    """What a reader should know: guesses, and what falls short, in words."""
    search: SearchResult | None = None
    """Better designs; None: nobody looked."""
