"""What the frame kernel does, in numpy and double precision: its definition."""

from __future__ import annotations

import numpy as np

from sim.arrays import CodeArray, FloatArray
from sim.frame.codes import checked_frame, fractional_code
from sim.frame.model import CHANNELS, DITHER_PX, FrameModel
from sim.frame.packed import Packed


def reference_frame(model: FrameModel, codes: CodeArray, gain: float = 1.0) -> CodeArray:
    """Return the projector's codes (H, W, 3) for a target's codes (H, W, 3) by the exact strategy, clamped."""
    checked_frame(model, codes)
    return coded(model, wanted_light(model, codes, gain))


def wanted_light(model: FrameModel, codes: CodeArray, gain: float = 1.0) -> FloatArray:
    """Return (3, H, W) light of the projector's channels that gives the target exactly; not clamped."""
    target = (gain * model.target_scale[:, None] * model.eotf)[
        np.arange(CHANNELS)[:, None, None], np.moveaxis(codes, 2, 0)
    ]
    inverse = layers(model.inverse_direct)
    sums = patch_sums(model, inverse * target) - model.black_emission
    irradiance = np.stack(
        [model.nodes.matrix @ (matrix @ row) for matrix, row in zip(_three(model.inverse.values), sums, strict=True)]
    )
    irradiance = np.maximum(irradiance, 0.0)
    q = inverse * target - layers(model.offset) - layers(model.view_gain) * seen(model, irradiance)
    return np.asarray(np.einsum("cb,bhw->chw", np.linalg.inv(model.mixing), q))


def patch_sums(model: FrameModel, light: FloatArray) -> FloatArray:
    """Return (3, L) S light for light (3, H, W) of the bands, emission as of the first band."""
    rows = model.sum_rows
    patch = model.patch_runs.value[model.patch_runs.of_pixels(model.shape)[rows], 0].ravel()
    weight = model.emission.values[0][rows]
    sums = [np.bincount(patch, (weight * band[rows]).ravel(), model.n_lit) for band in light]
    return np.stack(sums) * model.row_scale


def seen(model: FrameModel, irradiance: FloatArray) -> FloatArray:
    """Return (3, H, W) irradiance (3, W) of the nodes, bilinear in each pixel's cell."""
    cells = model.cells
    corner = irradiance[:, cells.corners[cells.runs.value[cells.runs.of_pixels(model.shape), 0]]]
    x, y = cells.place / 255.0
    return np.asarray(
        (1 - y) * ((1 - x) * corner[..., 0] + x * corner[..., 1]) + y * ((1 - x) * corner[..., 2] + x * corner[..., 3])
    )


def coded(model: FrameModel, light: FloatArray) -> CodeArray:
    """Return (H, W, 3) codes of linear light (3, H, W), clamped to the range; 0 where nothing is steered."""
    height, width = model.shape
    codes = np.empty((height, width, CHANNELS), dtype=np.uint8)
    rows, columns = np.arange(height)[:, None] % DITHER_PX, np.arange(width) % DITHER_PX
    for channel in range(CHANNELS):
        code = fractional_code(model.response[channel], light[channel])
        codes[..., channel] = np.minimum(np.floor(code + model.dither[channel][rows, columns] / 256), 255)
    codes[~model.active] = 0
    return codes


def layers(numbers: Packed) -> FloatArray:
    """Return (3, H, W) numbers of each band."""
    return _three(numbers.values)


def _three(values: FloatArray) -> FloatArray:
    return np.broadcast_to(values, (CHANNELS, *values.shape[1:]))
