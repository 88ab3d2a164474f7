"""What a simulation or a scan finds, as frozen records."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rig.records import Record


@dataclass(frozen=True, kw_only=True)
class GlossSummary(Record):
    """By how much matte patches that reflect as much would be wrong; estimated, RMS over the surface, % of white."""

    area_share: float
    """Of the surface, that is glossy; 0 ... 1."""
    matte_between: float
    """Of what patches send back of each other's light."""
    matte_seen: float
    """Of that as it is seen, over all directions."""
    matte_highlight: float
    """Of the lamp's light reflected once, over all directions."""
    matte_error: float
    """Expected with matte patches in all: 1.25 times the largest of these, and the plan's own, added in squares."""
    needed: bool
    """That is above the tolerance: the lobes are simulated."""
    bend: float
    """Times as much as light of matte patches, that light of lobes may vary within patches; at least 1."""
    rays: int
    """Pairs from each glossy patch that the noise asks for, if lobes are simulated."""
    noise: float
    """That they are expected to leave."""


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
    gloss: GlossSummary | None = None
    """None: no patch is glossy."""


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
    noise: float | None = None
    """RMS that the rays of lobes left, from two halves of them, percent of white; None: no lobes."""
    lobe_rays: int | None = None
    """Pairs that each glossy patch did send; None: no lobes."""
    error: float | None = None
    """Root mean square against a refined solution, percent of white; None: not checked."""
    error_max: float | None = None
    refined_patches: int | None = None
    refined_noise: float | None = None
    """RMS that the rays of lobes left of the refined solution, percent of white; ``error`` is free of it."""


@dataclass(frozen=True, kw_only=True)
class MeshRemark(Record):
    """One kind of thing that was found in a mesh file."""

    kind: str
    outcome: str
    """``mended`` or ``note``."""
    message: str
    facets: int
    """How many it is about."""


@dataclass(frozen=True, kw_only=True)
class MeshSummary(Record):
    """A mesh file as it was read, mended and, where it has very many facets, simplified."""

    file_facets: int
    """Triangles of the file."""
    facets: int
    """That the plan was made of."""
    remarks: tuple[MeshRemark, ...]
    simplified_within_m: float | None = None
    """Distance within which 95 % of the file's surface lies of the simpler one; None: not simplified."""
    faults: Path | None = None
    """File of facets in colours, if one was asked for."""


@dataclass(frozen=True, kw_only=True)
class SimulationResult(Record):
    """A planned simulation, and its outcome once it was done: ``rig simulate --json``."""

    scene: str
    tolerance: float
    """RMS over the surface. [% of white]"""
    plan: PlanSummary
    estimated: Estimate
    actual: SimulationOutcome | None = None
    mesh: MeshSummary | None = None
    """Of a mesh file."""
    files: tuple[Path, ...] = ()
    """That were written."""


@dataclass(frozen=True, kw_only=True)
class ScanResult(Record):
    """A point cloud and how it came about: ``rig scan --json``."""

    points: int
    unit: str
    valid_share: float
    """Share of the camera's pixels that have a code."""
    epipolar_median_px: float | None = None
    """Before points beyond the limit were left out; None where columns or rows alone were photographed."""
    left_out: int
    """Points beyond the epipolar limit, or alone."""
    mended: tuple[str, ...]
    """What was wrong with the photographs and could be put right, a sentence each."""
    warnings: tuple[str, ...]
    """What is wrong and could not: the cloud may be poor or incomplete."""
    distance_sigma_percent: float
    """Median standard deviation of a point's distance that errors of its code leave: by what pixels are off their
    epipolar lines, or a whole code's 0.3 px of columns or rows alone. Lenses and pose are taken as right."""
    lens_sigma_percent: float | None = None
    """Median standard deviation of a point's distance that the lens file leaves open; None without a lens file."""
    seconds: float
    output: Path
