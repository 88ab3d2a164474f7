"""What steps `separation` and `model` find, as their records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rig.records import Record
from rig.stages.light.unseen_walls import PlacedByLight


@dataclass(frozen=True, kw_only=True)
class BlurRecord(Record):
    """Blur of one lens."""

    variance_px2: tuple[float, float, float, float]
    """Coefficients of :class:`calibration.light.blur.LensBlur`."""
    middle_px: float
    """Standard deviation in the middle of its picture ..."""
    middle_sigma_px: float
    """... and how well that is known."""
    worst_px: float
    """Largest at a corner of its picture."""


@dataclass(frozen=True, kw_only=True)
class SeparationRecord(Record):
    """What step `separation` found, beside its images."""

    projector_blur: BlurRecord
    camera_blur: BlurRecord
    checker_size_px: int
    """Of the checks that were shown: what the profile says, unless that is too fine for the blur."""
    stripes_blur_px: float | None = None
    """By stripes of the code, before: standard deviation of what a camera pixel sees, in projector pixels.
    None for a code without such stripes."""
    camera_pixel_px: float | None = None
    """Side of a camera pixel in projector pixels, at the coarse end; None in sessions of before it was asked for."""
    checks_blur_px: float | None = None
    """Blur, as that of stripes, by the checks; None in sessions of before it was kept."""
    blur_rms: float
    """What the blurred pattern leaves of a pixel's light, as a share of its direct light."""
    middle_percent: float | None = None
    """Direct light by the middles of checks alone, less that by all frames, in per cent of it, which what is kept has
    more of; None where checks have no middle, and in sessions of before it was looked for."""
    left_out: tuple[str, ...] = ()
    """Pictures of checks that are not what the others make of them."""
    processing_noise_dn: float = 0.0
    """What the camera's processing, as JPEG, adds to pictures of checks, rms; 0 of raw frames, and in sessions of
    before it was looked for."""
    extremes_over_known_pattern: float
    """Median direct light by the brightest and darkest frames over that by the known pattern."""


@dataclass(frozen=True, kw_only=True)
class BandModel(Record):
    """What the scene does in one band of light."""

    reflectance: tuple[float, ...]
    """Of each patch."""
    source: tuple[int, ...]
    """What each patch's reflectance is from (:class:`calibration.light.reflectance.Source`)."""
    unseen_reflectance: float
    """Mean of the patches that nobody saw ..."""
    unseen_sigma: float
    """... and its standard deviation."""
    global_rms: float
    """Residual of the fit to the global light, relative."""
    white_median: float
    """Of projector white over the lit pixels."""
    global_share_mean: float
    """Mean share of global light in it."""
    returned_share: float = 0.0
    """Of one wall's mean radiosity, what an open room sends back, evenly; 0 where walls light each other."""
    lit_part: tuple[float, ...] = ()
    """Reflectance of each patch's lit part over the whole patch's, or by how much more light it gets of the projector
    than its slant says; (): all alike."""
    reflectance_sigma: float = 0.0
    """Standard deviation of the reflectance of patches that are lit and seen, root mean square; 0 in older sessions."""


@dataclass(frozen=True, kw_only=True)
class CameraModel(Record):
    """What the model knows of one camera beside its geometry."""

    vignetting: tuple[float, float]
    """v2, v4: relative illumination 1 + v2 r² + v4 r⁴."""


@dataclass(frozen=True, kw_only=True)
class ProjectorModel(Record):
    """What the model knows of one projector beside its geometry."""

    vignetting: tuple[float, float]
    flux: tuple[float, ...]
    """κ in each band ..."""
    flux_sigma: tuple[float, ...]
    """... and its standard deviation."""


@dataclass(frozen=True, kw_only=True)
class ModelRecord(Record):
    """What step `model` found, beside its images."""

    patch_size_m: float
    bands: tuple[BandModel, ...]
    cameras: Mapping[str, CameraModel]
    projectors: Mapping[str, ProjectorModel]
    vignetting_rms: float
    level: float
    """Camera value of a target's 255, in each band."""
    lit_share_of_image: float
    placed: tuple[PlacedByLight, ...] = ()
    """Walls that nobody measured, an entry an axis."""
