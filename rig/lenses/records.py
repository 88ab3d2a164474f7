"""What `rig lenses` finds, as frozen records."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rig.records import Record, Verdict, all_met


@dataclass(frozen=True, kw_only=True)
class HalvesSummary(Record):
    """How far the lenses of two halves of the views are apart."""

    difference_px: float
    """Root mean square within the outline of the corners, of points far away."""
    expected_px: float
    """What the uncertainties of both halves say it should be."""
    ratio: float
    """Difference over expectation; about 1 when the uncertainties are true."""


@dataclass(frozen=True, kw_only=True)
class LeftOutSummary(Record):
    """How a distortion model predicts views that were left out of its fit."""

    model: str
    rms_px: float


@dataclass(frozen=True, kw_only=True)
class DeviceLens(Record):
    """One lens and how far it is known."""

    name: str
    role: str
    width_px: int
    height_px: int
    model: str
    focal_px: tuple[float, float]
    focal_sigma_px: tuple[float, float]
    principal_point_px: tuple[float, float]
    principal_point_sigma_px: tuple[float, float]
    distortion: tuple[float, ...]
    rms_px: float
    """RMS distance of the corners that the fit rests on from where the lens has them."""
    rms_all_px: float
    """The same of all corners, also of those left out."""
    noise_px: float
    """Standard deviation of one coordinate."""
    corners: int
    left_out: int
    """Corners that do not belong: mistakes of the detection, views that fit none."""
    projection_sigma_px: tuple[float, float, float]
    """Uncertainty of projection far away: in the picture's middle; median and worst within the corners' outline."""
    projection_sigma_near_px: tuple[float, float, float]
    """The same at the boards' median distance."""
    covered_share: float
    """Of the picture in which corners were seen, in 10 × 10 fields."""
    left_out_models: tuple[LeftOutSummary, ...]
    """The distortion models that were tried, from lean to rich."""
    halves: HalvesSummary | None = None
    """None: too few views to divide."""


@dataclass(frozen=True, kw_only=True)
class ViewSummary(Record):
    """One view of the board."""

    name: str
    used: bool
    corners: int = 0
    camera_rms_px: float | None = None
    projector_rms_px: float | None = None
    tilt_deg: float | None = None
    """Between the board's normal and the line of sight."""
    distance_m: float | None = None
    note: str = ""
    """What is wrong with it, and what to do."""


@dataclass(frozen=True, kw_only=True)
class PairPose(Record):
    """The projector's pose in the camera's frame."""

    rotation: tuple[float, ...]
    """projector_from_camera, row after row."""
    translation_m: tuple[float, float, float]
    translation_sigma_m: tuple[float, float, float]
    baseline_m: float
    baseline_sigma_m: float


@dataclass(frozen=True, kw_only=True)
class LensesResult(Record):
    """Lenses from boards: ``rig lenses --json``."""

    rms_px: float
    """RMS distance of all corners that the fit rests on, camera and projector together."""
    devices: tuple[DeviceLens, ...]
    views: tuple[ViewSummary, ...]
    pose: PairPose | None = None
    flex_mm: tuple[float, float, float]
    """How far the board's middle stands out along its columns and rows, and its first corner by twist; 0: taken as
    flat."""
    flex_sigma_mm: tuple[float, float, float]
    stretch: float = 0.0
    """By what share the board's squares are longer down than across; 0: taken as square. [1]"""
    stretch_sigma: float = 0.0
    scatter_of_views: float
    """Between views over what corner noise explains (standard deviation); near 1: the model fits."""
    starts: int
    starts_agree_px: float
    """Largest difference of the lenses from all starts that end at the lowest cost."""
    worse_starts: int
    next_pose: str
    """The view that would help most."""
    limits: tuple[Verdict, ...]
    warnings: tuple[str, ...]
    seconds: float
    output: Path
    report: Path | None = None

    @property
    def within_limits(self) -> bool:
        """Whether every limit is kept and no view had to be left out."""
        return all_met(self.limits) and not self.warnings
