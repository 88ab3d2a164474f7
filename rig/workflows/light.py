"""Linear light from a session's frames: black subtracted, exposures merged, with its variance.

The unit is the camera's full scale at the session's reference exposure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.records import Response
from rig.session import Step
from rig.workflows.capture import Shot, frame_name

Float32Array = NDArray[np.float32]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class LightImage:
    """A photograph in linear light, all (H, W)."""

    value: Float32Array
    variance: Float32Array
    saturated: BoolArray
    """Clipped in every exposure."""


@dataclass(frozen=True, eq=False)
class Photometry:
    """How digital numbers become light on this rig."""

    reference_exposure_s: float
    offset_dn: float
    """Digital number without any light."""
    full_scale_dn: int
    camera: Response
    projector: Response
    gain_e_per_dn: float
    read_noise_dn: float
    black: Mapping[float, Float32Array]
    """Linear light (not relative to exposure) while the projector shows black, by exposure. [full scale]"""

    def table(self) -> Float32Array:
        """(full scale + 1,) linear light of each digital number; below the offset it goes on straight."""
        above = np.arange(self.full_scale_dn + 1) - self.offset_dn
        levels, linear = self.camera.levels, self.camera.linear
        slope = (linear[1] - linear[0]) / (levels[1] - levels[0])
        inside = np.interp(above, levels, linear)
        low = np.where(above < levels[0], linear[0] + (above - levels[0]) * slope, inside)
        return np.asarray(low, dtype=np.float32)

    @property
    def saturation_dn(self) -> int:
        """From here on a pixel counts as clipped."""
        return int(self.full_scale_dn * 0.95)


def light_of(step: Step, pattern: str, shot: Shot, photometry: Photometry) -> LightImage:
    """Merge a pattern's frames (exposures × repeats) to light above black, by inverse variance."""
    table = photometry.table()
    weight_sum: Float32Array | None = None
    for exposure, exposure_s in enumerate(shot.exposures_s):
        mean, clipped = _mean_of_repeats(step, pattern, exposure, shot.repeats, table, photometry)
        ratio = np.float32(exposure_s / photometry.reference_exposure_s)
        variance = (
            _noise(mean, photometry) / shot.repeats + _noise(photometry.black[exposure_s], photometry) / 4
        ) / ratio**2
        weight = np.where(clipped, np.float32(0), 1 / variance)
        value = (mean - photometry.black[exposure_s]) / ratio
        if weight_sum is None:
            weight_sum, total, shortest, shortest_variance = weight, weight * value, value, variance
        else:
            weight_sum, total = weight_sum + weight, total + weight * value
    if weight_sum is None:
        raise ValueError("a shot needs at least one exposure")
    good = weight_sum > 0
    safe = np.where(good, weight_sum, 1)
    return LightImage(np.where(good, total / safe, shortest), np.where(good, 1 / safe, shortest_variance), ~good)


def _mean_of_repeats(
    step: Step, pattern: str, exposure: int, repeats: int, table: Float32Array, photometry: Photometry
) -> tuple[Float32Array, BoolArray]:
    frames = [step.load_frame(frame_name(pattern, exposure, r)).pixels[..., 0] for r in range(repeats)]
    mean = sum(table[f] for f in frames[1:]) + table[frames[0]] if len(frames) > 1 else table[frames[0]]
    clipped = np.any([f >= photometry.saturation_dn for f in frames], axis=0)
    return np.asarray(mean / np.float32(repeats)), clipped


def _noise(linear: Float32Array, photometry: Photometry) -> Float32Array:
    """Variance of one frame's linear light: shot noise, read noise and rounding."""
    scale = np.float32(photometry.camera.linear[-1] / photometry.camera.levels[-1])
    digital = np.maximum(linear / scale, 0)
    shot_noise = digital / np.float32(photometry.gain_e_per_dn)
    return np.asarray((shot_noise + np.float32(photometry.read_noise_dn**2 + 1 / 12)) * scale**2, dtype=np.float32)


def response_record(response: Response) -> dict[str, Any]:
    """A response for a JSON record."""
    return {"levels": response.levels.tolist(), "linear": response.linear.tolist(), "rms": response.rms}


def response_of(record: Mapping[str, Any]) -> Response:
    """The inverse of :func:`response_record`."""
    return Response(np.array(record["levels"]), np.array(record["linear"]), float(record["rms"]))
