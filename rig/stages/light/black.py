"""The light of black: what a camera sees while the projector shows nothing, and by how much it changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.radiometry.flicker import PHASES
from rig.session import Step
from rig.stages.linear_light import Float32Array, RadiometricCalibration
from rig.stages.photograph import ExposureBracket, frame_name

_LEAST_BLACK = 1e-5
"""Of full scale: of less light on black a share means nothing."""


@dataclass(frozen=True, eq=False)
class BlackLight:
    """Of each exposure."""

    mean: dict[float, Float32Array]
    """(H, W, B) linear light. [full scale]"""
    ripple: dict[float, float]
    """Standard deviation of a frame, or of as many as are averaged, share of the mean over all pixels."""
    swell: dict[float, float]
    """By what share of that mean a mains light makes single frames brighter and darker; 0 where none is seen."""


def black_light(step: Step, bracket: ExposureBracket, radiometric: RadiometricCalibration) -> BlackLight:
    """Return the light of the frames of black that a step has taken.

    The noise of a mean over all pixels is nothing beside a mains light that flickers. Where frames are averaged over
    its period, the means of such sets tell what is left, and single frames, thirds of a period apart, its amplitude.
    """
    table, one_set = radiometric.table(), 1 if bracket.swell_hz is None else PHASES
    found = BlackLight({}, {}, {})
    for e, exposure_s in enumerate(bracket.exposures_s):
        frames = [table[step.load_frame(frame_name("black", e, r)).pixels] for r in range(bracket.repeats)]
        mean = np.mean(frames, axis=0).astype(np.float32)
        found.mean[exposure_s] = mean if radiometric.mosaic is None else radiometric.mosaic.interpolated(mean)
        light = np.array([frame.mean(dtype=np.float64) for frame in frames])
        typical = max(light.mean(), _LEAST_BLACK)
        of_sets = light.reshape(-1, one_set).mean(axis=1)
        found.ripple[exposure_s] = float(np.sqrt(one_set) * of_sets.std(ddof=1) / typical)
        found.swell[exposure_s] = float(np.sqrt(2) * light.std() / typical) if one_set > 1 else 0.0
    return found
