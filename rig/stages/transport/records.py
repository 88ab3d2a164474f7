"""What step `transport` keeps of its photographs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.light.transport.posterior import Photographs
from rig.files.channels import image_of, layers
from rig.records import Record
from rig.session import Step

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PhotographNote(Record):
    """One photograph of the light, and what was expected of it; errors in grey levels of 255."""

    name: str
    kind: str
    """`block`, `halves` or `least certain`: of what it is a picture."""
    lit_share: float
    """Of the projector's pixels."""
    brings: float
    """Part of the model's error on usual pictures that was expected to go."""
    rms_before: float
    """What was expected of that error before it was taken."""


@dataclass(frozen=True, kw_only=True)
class SurfaceGloss(Record):
    """What photographs tell of a surface's gloss."""

    surface: str
    says: str
    """`shines`, `matte` or `not told`."""
    ratio: float | None = None
    """Gloss over the model's matte reflectance ..."""
    sigma: float | None = None
    """... and its standard deviation; None: nothing that could be mirrored there was photographed."""
    roughness: float | None = None
    """Of the lobe that explains most ..."""
    least_roughness: float | None = None
    most_roughness: float | None = None
    """... and between which others it may be."""


@dataclass(frozen=True, kw_only=True)
class TransportRecord(Record):
    """What step `transport` found, beside its images."""

    photographs: tuple[PhotographNote, ...]
    another_brings: float
    """What one more is expected to bring ..."""
    noise_of_place: float
    """... and the noise of a photograph at a place of the picture, below which none is taken."""
    rms_left: float
    """What is expected of the model's error on usual pictures with all that were taken, as they show of each other."""
    left_out_rms: float = 0.0
    """Of photographs that are left out in turn, measured minus what the others expect, beyond noise ..."""
    left_out_expected: float = 0.0
    """... and what was expected of it before they were held against each other."""
    gloss: tuple[SurfaceGloss, ...] = ()


def save_photographs(step: Step, known: Sequence[Photographs]) -> None:
    """Keep what the photographs say as pictures, a row a photograph and a column a place, or a lit patch."""
    if not len(known[0].lit):
        return
    names = ("own", "difference", "variance")
    by_place = [np.stack([getattr(band, name) for band in known], axis=-1) for name in names]
    places = {k: v for name, values in zip(names, by_place, strict=True) for k, v in layers(name, values).items()}
    step.save_image("told", places, folder="maps")
    step.save_image("lit", layers("lit", np.stack([band.lit for band in known], axis=-1)), folder="maps")


def read_uneven(step: Step) -> FloatArray:
    """Return (H, W, B) what a step's photographs left within places."""
    return image_of(step.load_image("uneven"), "uneven").astype(np.float64)


def read_told(step: Step, n_bands: int) -> list[Photographs]:
    """Return what a step's photographs say in each band; it has to have taken some."""
    told, lit = step.load_image("told"), step.load_image("lit")
    parts = {name: image_of(told, name).astype(np.float64) for name in ("own", "difference", "variance")}
    shares = image_of(lit, "lit").astype(np.float64)
    return [
        Photographs(lit=shares[..., b], **{name: values[..., b] for name, values in parts.items()})
        for b in range(n_bands)
    ]
