"""What a simulation or a scan finds, as frozen records."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rig.records import Record


@dataclass(frozen=True, kw_only=True)
class PlanSummary(Record):
    """What the planner chose, and why."""

    patches: int
    smallest_patch_m: float
    """Square root of the smallest area."""
    largest_patch_m: float
    light: str
    method: str
    visibility: str
    solver: str
    channels: int
    bounces: int
    reasons: tuple[str, ...]
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Estimate(Record):
    """What a simulation is expected to cost; error in percent of white."""

    error: float
    seconds: float
    peak_mb: float


@dataclass(frozen=True, kw_only=True)
class SimulationOutcome(Record):
    """What a simulation did cost, and what is left over of its equations."""

    seconds: float
    peak_mb: float
    residual: float
    closure_max: float
    energy_balance: float
    products: int
    error: float | None = None
    """Root mean square against a refined solution, percent of white; None: not checked."""
    error_max: float | None = None
    refined_patches: int | None = None


@dataclass(frozen=True, kw_only=True)
class SimulationResult(Record):
    """A planned simulation, and its outcome once it was done: ``rig simulate --json``."""

    scene: str
    tolerance: float
    """RMS over the surface. [% of white]"""
    plan: PlanSummary
    estimated: Estimate
    actual: SimulationOutcome | None = None


@dataclass(frozen=True, kw_only=True)
class ScanResult(Record):
    """A point cloud and how it came about: ``rig scan --json``."""

    points: int
    unit: str
    valid_share: float
    """Share of the camera's pixels that have a code."""
    epipolar_median_px: float | None
    """Before points beyond the limit were left out; None where columns or rows alone were photographed."""
    left_out: int
    """Points beyond the epipolar limit, or alone."""
    mended: tuple[str, ...]
    """What was wrong with the photographs and could be put right, a sentence each."""
    warnings: tuple[str, ...]
    """What is wrong and could not: the cloud may be poor or incomplete."""
    lens_sigma_percent: float | None
    """Median standard deviation of a point's distance that the lens file leaves open; None without a lens file."""
    seconds: float
    output: Path
