"""What a session's photographs say of each other, and of what is left within places: the honest part of a posterior."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.light.transport.choice import Pictures
from calibration.light.transport.posterior import LeftOut, Photographs, left_out
from calibration.structured_light.patterns import Pattern
from rig.session import Step
from rig.stages.linear_light import RadiometricCalibration, channel_light, merge_exposures
from rig.stages.model import FittedScene
from rig.stages.photograph import ExposureBracket
from rig.stages.prediction import picture_parts
from rig.stages.transport.learned import BandPrior, LearnedBand, learned_band
from rig.stages.transport.places import WORTH
from rig.terminal import OnStep

FloatArray = NDArray[np.float64]

_ALIKE_PX = 1.5
"""Over so many pixels what is left is taken together: with some ten photographs its variance is known to a tenth."""
_MOST_UNEVEN = 1.0
"""Of global light, relative."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ShownPictures:
    """Photographs of known pictures, with all that is needed to look at them again."""

    step: Step
    bracket: ExposureBracket
    radiometric: RadiometricCalibration
    patterns: tuple[Pattern, ...]


@dataclass(frozen=True, kw_only=True)
class Left:
    """What is left open, in light: means over places."""

    usual_rms: float
    """On pictures as people show them."""
    left_out_rms: float
    """Of photographs that are left out in turn, beyond noise ..."""
    left_out_expected: float
    """... and what was expected of it before."""


def learned_bands(
    model: FittedScene, bands: tuple[BandPrior, ...], known: list[Photographs], shown: ShownPictures, *, on_step: OnStep
) -> tuple[LearnedBand, ...]:
    """Return every band with what its photographs say, and what they leave within places."""
    learned = tuple(learned_band(band, each, model.lit) for band, each in zip(bands, known, strict=True))
    left = _uneven(model, learned, shown, on_step)
    return tuple(replace(band, uneven=each) for band, each in zip(learned, left, strict=True))


def what_is_left(band: LearnedBand, known: Photographs, usual: Pictures) -> Left:
    """Hold photographs against each other; usual pictures as `known` has them, at all places."""
    found = band.posterior
    apart: LeftOut = left_out(found.prior, known, band.places.alike(), WORTH)
    beyond = max(float((apart.off**2 - apart.noise).mean()), 0.0) if apart.off.size else 0.0
    expected = float(apart.expected.mean()) if apart.off.size else 0.0
    return Left(
        usual_rms=float(np.sqrt(found.variance(usual.lit, usual.own).mean())),
        left_out_rms=float(np.sqrt(beyond)),
        left_out_expected=float(np.sqrt(expected)),
    )


def _uneven(
    model: FittedScene, learned: tuple[LearnedBand, ...], shown: ShownPictures, on_step: OnStep
) -> list[FloatArray]:
    """(H, W) in each band: relative error of global light that photographs have beside noise and places' means.

    What is measured minus predicted, squared, less its variance, over the square of what a relative error would make.
    """
    room = replace(model.room, bands=tuple(band.scene_model for band in learned))
    after = replace(model, room=room, learned=learned)
    beyond, of_one = (np.zeros((len(learned), *model.lit.shape)) for _ in range(2))
    for k, pattern in enumerate(shown.patterns):
        on_step("see what photographs leave", k, len(shown.patterns))
        measured = merge_exposures(shown.step, pattern.name, shown.bracket, shown.radiometric)
        light = channel_light(shown.radiometric.projector, pattern.codes).reshape(-1, model.channels)
        mixed = (light.astype(np.float64) @ room.mixing.T) / room.mixing.sum(axis=1)
        for b, band in enumerate(learned):
            parts = picture_parts(after, shown.radiometric, band=b, light=mixed[:, b])
            left = band.variance(mixed[:, b], parts.direct, parts.white_direct)
            variance = parts.variance + parts.moved_by(model.uncertainty.split[..., b]) ** 2 + left
            off = (measured.value[..., b] - parts.value) ** 2 - measured.variance[..., b] - variance
            usable = model.lit & ~measured.saturated[..., b]
            beyond[b] += np.where(usable, off, 0.0)
            of_one[b] += np.where(usable, parts.apart_from_white**2, 0.0)
    on_step("see what photographs leave", len(shown.patterns), len(shown.patterns))
    return [_root_of_ratio(*pair) for pair in zip(beyond, of_one, strict=True)]


def _root_of_ratio(beyond: FloatArray, of_one: FloatArray) -> FloatArray:
    above, below = (cv2.GaussianBlur(each, (0, 0), _ALIKE_PX) for each in (beyond, of_one))
    share = np.where(below > 0, above / np.where(below > 0, below, 1.0), 0.0)
    return np.asarray(np.sqrt(np.clip(share, 0.0, _MOST_UNEVEN**2)))
