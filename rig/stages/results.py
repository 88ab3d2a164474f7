"""What a session has measured, in the keys that others rely on: metrics.json, `rig run --json`, ``rig.run_session``.

All are records of numbers; errors of pictures are grey levels of 255.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rig.records import Record, Verdict
from rig.stages.comparison import ModelErrors
from rig.stages.light.darkness import DarknessRecord
from rig.stages.light.unseen_walls import PlacedByLight
from rig.stages.picture_errors import PictureErrors
from rig.stages.surface.known import RegistrationRecord
from rig.stages.surface.openings import SeenBehind
from rig.stages.surface.positions import PositionRecord
from rig.stages.target import ShownTarget
from rig.stages.transport.evidence import EvidenceRecord
from rig.stages.transport.records import SurfaceGloss

ByBand = float | tuple[float, ...]
"""A number of a grey rig; three of a colour rig: red, green, blue."""


@dataclass(frozen=True, kw_only=True)
class GeometryResult(Record):
    """How well lenses, poses and walls explain the correspondence."""

    rms_px: float
    """Reprojection error of both devices together."""
    camera_rms_px: float
    projector_rms_px: float
    valid_share_of_image: float
    """Of the camera's pixels: have a projector pixel."""
    baseline_m: float
    room_size_m: tuple[float, float, float]
    faces_seen: tuple[str, ...]
    room_notes: str
    """What was assumed of the room, in words."""
    off_walls_m: float = 0.0
    """How far what was measured of the walls lies off the box that stands for them: 95 % of the points by no more."""
    sigmas: Mapping[str, float]
    """Standard deviations: lens terms [px or 1]; what ends in _m or _deg, of poses and lengths, in that unit."""
    openings_m: Mapping[str, float] = field(default_factory=dict)
    """By wall with an opening: how far what is seen through it lies behind, where nobody saw the wall opposite and
    `size_m` may have been measured to either. It is part of the standard deviations."""
    right_angle_sigmas: float | None = None
    """By how much the points and the data sheets speak against right angles; None where none were taken."""
    askew_sigmas: Mapping[str, float] | None = None
    """What of poses and lengths would be off, were each wall that is taken to be square off by 0.3 degrees; None where
    no right angle was taken for granted."""
    valid_share: float | None = None
    """Of the pixels that the projector lights: have a projector pixel. None before the light is separated."""
    stripes_times: int = 1
    """How many times as wide as the code's own its stripes had to be, because the lenses blur these away."""
    superposition_percent: float | None = None
    """Of white: by how much more light pictures of the code have with their inverses; None where nobody could tell."""


@dataclass(frozen=True, kw_only=True)
class SeparationResult(Record):
    """Share of global light in projector white, over the valid pixels."""

    global_share_mean: float
    global_share_median: float


@dataclass(frozen=True, kw_only=True)
class StandingResult(Record):
    """What stands before the walls of a free surface, as far as the camera sees it."""

    parts: int
    """Pieces of surface over which light is smooth."""
    flat_parts: int
    triangles: int
    share_of_image: float
    """Of the valid pixels."""
    share_left_out: float
    """Of the valid pixels: of pieces that are too small for a surface."""
    n_continued: int = 0
    """Of the triangles, those that nobody saw: flat parts that the picture's border cuts, carried on."""
    behind: tuple[SeenBehind, ...] = ()
    """Walls that are open, for something is seen behind them."""
    positions: tuple[PositionRecord, ...] = ()
    """What sessions with the camera elsewhere saw of the room."""
    deep: bool = False
    """Their backs, which nobody saw, are taken to be as far behind as they are wide: the light is explained better."""
    registration: RegistrationRecord | None = None
    """How well a known mesh fits; None of what was measured point by point."""


@dataclass(frozen=True, kw_only=True)
class LearnedResult(Record):
    """What photographs of known pictures taught of the light; in grey levels of 255."""

    photographs: int
    rms_before: float
    """What was expected of the model's error on usual pictures once photographs had shown how large it is ..."""
    rms_left: float
    """... and with all of them."""
    left_out_rms: float
    """Each photograph, measured minus what all others expect of it, beyond noise ..."""
    left_out_expected: float
    """... and what was expected of that."""
    gloss: tuple[SurfaceGloss, ...]
    another_brings: float
    """Part of that error that one more is expected to take away."""
    noise: float
    """Of a photograph, averaged over pixels that are alike: below it none is taken."""


@dataclass(frozen=True, kw_only=True)
class ModelResult(Record):
    """The fitted scene."""

    patches: int
    reflectance_mean: ByBand
    """Weighted by area."""
    reflectance_sigma: ByBand = 0.0
    """Standard deviation of a patch that is lit and seen, root mean square; 0 in older sessions."""
    patches_lit_and_seen: int
    patches_seen_in_global_light: int
    patches_unseen: int
    unseen_reflectance: ByBand
    unseen_sigma: ByBand
    flux: ByBand
    global_rms: ByBand
    """Residual of the fit to the global light, relative."""
    vignetting_camera: tuple[float, float]
    vignetting_projector: tuple[float, float]
    level: float
    """Camera value of a target's 255."""
    placed: tuple[PlacedByLight, ...] = ()
    """Walls that nobody saw, where the light tells; an entry an axis."""
    standing: StandingResult | None = None
    """None of a box."""
    learned: LearnedResult | None = None
    """None of a session without ``[transport] photographs``."""
    evidence: EvidenceRecord | None = None
    """What was learned from pictures on which loops were closed; None where there were none."""
    mixing: tuple[tuple[float, ...], ...] | None = None
    """Of a colour rig: share of white in each band that each channel of the projector makes."""
    mixing_variation: float | None = None
    white_over_channels: tuple[float, ...] | None = None
    balance: tuple[float, ...] | None = None


@dataclass(frozen=True, kw_only=True)
class TruthErrors(Record):
    """Errors against the simulated world, which calibration never looks at."""

    camera_position_mm: float
    camera_rotation_deg: float
    focal_percent: float
    surface_median_mm: float
    reflectance_rmse: float
    reflectance_rmse_lit_and_seen: float
    direct_bias_percent: float
    global_bias_percent: float
    mixing_max_error: float | None = None
    """Of a colour rig."""
    surface_median_percent: float | None = None
    """Of the distance from the camera; None of sessions of older versions."""
    surface_p95_percent: float | None = None
    """The same: 95 of 100 lit pixels see less."""


@dataclass(frozen=True, kw_only=True)
class CompensationResult(Record):
    """The strategy that stands for 'compensated'."""

    strategy: str
    clipped_share: float
    target: ShownTarget | None = None
    """None of sessions of older versions."""


@dataclass(frozen=True, kw_only=True)
class MeasuredResult(Record):
    """Measured errors against the target without and with compensation."""

    uncompensated: PictureErrors
    compensated: PictureErrors


@dataclass(frozen=True, kw_only=True)
class StrategyResult(Record):
    """One strategy's picture: errors against the target, and how it was computed."""

    measured: PictureErrors
    predicted: PictureErrors
    clipped_share: float
    iterations: int
    notes: Mapping[str, float | str]


@dataclass(frozen=True, kw_only=True)
class ModelComparison(ModelErrors):
    """Measured against predicted light, over all frames; none of them was used for fitting."""

    frames: Mapping[str, ModelErrors]
    photographs: int = 1
    """Of each picture at each exposure, that were averaged."""
    processing_noise_dn: float = 0.0
    """What the camera's processing, as JPEG, is taken to add to each of them: it is part of `noise_rms`."""


@dataclass(frozen=True, kw_only=True)
class ExpectedFigure(Record):
    """A number, and the range that a rig's own noise and geometry let one expect of it."""

    what: str
    value: float
    low: float
    high: float
    unit: str
    because: str
    """From what the range follows."""
    raised_by: str
    """What makes the number larger, or hides in it."""
    remedy: str
    """What to do about it."""

    @property
    def as_expected(self) -> bool:
        """Whether the number is in the range."""
        return self.low <= self.value <= self.high


@dataclass(frozen=True, kw_only=True)
class PartialResult(Record):
    """What a session has measured before it is compared: as far as its steps are done."""

    geometry: GeometryResult | None = None
    separation: SeparationResult | None = None
    model: ModelResult | None = None
    truth: TruthErrors | None = None
    """On a simulated rig."""
    compensation: CompensationResult | None = None
    elapsed_s: float | None = None
    """How long this run took; metrics.json does not hold it."""


@dataclass(frozen=True, kw_only=True)
class SessionResult(Record):
    """What a session has measured that was compared."""

    geometry: GeometryResult
    separation: SeparationResult
    model: ModelResult
    truth: TruthErrors | None = None
    """On a simulated rig."""
    compensation: CompensationResult
    measured: MeasuredResult
    strategies: Mapping[str, StrategyResult]
    comparison: ModelComparison
    limits: tuple[Verdict, ...]
    within_limits: bool
    darkness: DarknessRecord | None = None
    """What there is beside the picture."""
    expected: tuple[ExpectedFigure, ...] = ()
    """What a good figure is on this rig."""
    report: str | None = None
    """Where its page is, if it was written."""
    elapsed_s: float | None = None
    """How long this run took; metrics.json does not hold it."""
