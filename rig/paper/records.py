"""What the replication of the paper finds: one frozen record a configuration, and one for all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.files.photographs import Photograph
from rig.records import Record
from sim.light.criteria import Spread

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Ends(Record):
    """The smallest and the largest value."""

    min: float
    max: float


@dataclass(frozen=True, kw_only=True)
class MeanError(Record):
    """Mean and standard deviation of |visible - desired|, as the paper prints them."""

    mean: float
    sd: float | None = None
    """None: not published."""


@dataclass(frozen=True, kw_only=True)
class PublishedFigures(Record):
    """What the paper says of a configuration; None where it says nothing."""

    indirect: Spread
    share_white: float | None = None
    required_emission: Ends | None = None
    error_uncompensated: MeanError | None = None
    error_compensated: MeanError | None = None


@dataclass(frozen=True, kw_only=True)
class PictureScores(Record):
    """|visible - desired| in grey levels over the pixels that see a surface, and how it looks."""

    mean: float
    sd: float
    max: float
    rms: float
    ssim: float
    delta_e_2000: float


@dataclass(frozen=True, kw_only=True)
class StrategyScores(PictureScores):
    """The same of a strategy's predicted picture, with its clipping, effort and notes."""

    clipped_share: float
    iterations: int
    seconds: float
    notes: Mapping[str, float | str]

    @property
    def worse_than_direct(self) -> bool:
        """Whether the strategy itself says that ``direct``, clamped, is better."""
        return "worse_than_direct" in self.notes


@dataclass(frozen=True, kw_only=True)
class Certificate(Record):
    """How far the bounded optimum can be from the best, and which strategies undercut its RMS error."""

    gap: float
    beaten_by: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class ConfigurationResult(Record):
    """One of the paper's six configurations, computed again; light in grey levels of 255."""

    name: str
    title: str
    image: str
    coverage: float
    """Share of the room's surface in patches that some pixel lights."""
    pixels_on_surface: float
    indirect: Spread
    indirect_bias_percent: float
    """What the paper's quadrature adds to the indirect light, against exact form factors."""
    share_white: float
    share_white_pixel_mean: float
    emission_share_mean: float
    required_emission: Ends
    error_uncompensated: PictureScores
    strategies: Mapping[str, StrategyScores]
    certificate: Certificate
    published: PublishedFigures


@dataclass(frozen=True, kw_only=True)
class Effect(Record):
    """An effect that the paper reports, its figures, ours, and whether ours go the same way."""

    effect: str
    published: str
    ours: str
    reproduced: bool


@dataclass(frozen=True, kw_only=True)
class PoseErrors(Record):
    """Mean errors from another plausible pose, on smaller images: by ``uncompensated`` and strategy."""

    position_m: tuple[float, float, float]
    direction: tuple[float, float, float]
    hfov_deg: float
    coverage: float
    reference: Mapping[str, float]
    indoor: Mapping[str, float]
    grey: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class StatedPose(Record):
    """The pose and the lens that stand for those that the paper does not publish."""

    position_m: tuple[float, float, float]
    direction: tuple[float, float, float]
    hfov_deg: float
    hfov_quarter_deg: float
    width_px: int
    height_px: int
    choice: str


@dataclass(frozen=True, kw_only=True)
class PaperResult(Record):
    """The replication as a whole: ``rig paper --json``."""

    coverage_quarter: float
    configurations: tuple[ConfigurationResult, ...]
    effects: tuple[Effect, ...]
    conventions: Mapping[str, str]
    exceptions: tuple[str, ...]
    row_sums: Ends
    spectral_radius: float
    pose: StatedPose
    photographs: Mapping[str, Photograph]
    sensitivity: tuple[PoseErrors, ...]
    sensitivity_remark: str
    figures: tuple[str, ...] | None = None
    """Paths of the pictures that were written."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PaperImages:
    """What one configuration shows; (H, W) grey levels of 255."""

    name: str
    title: str
    desired: FloatArray
    uncompensated: FloatArray
    """Seen when the desired image itself is projected."""
    projected: Mapping[str, FloatArray]
    """Projector image by strategy."""
    visible: Mapping[str, FloatArray]
    """Camera image by strategy."""
    once_reflected_share: FloatArray
    """When white is projected; share in [0, 1]."""
