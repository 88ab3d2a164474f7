"""What step `model` finds, as its records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rig.records import Record
from rig.stages.light.unseen_walls import PlacedByLight


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
    """Reflectance of each patch's lit part over the whole patch's; (): all alike."""
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
