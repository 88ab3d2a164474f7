"""What the frame kernel does, in numpy and double precision: its definition."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.errors import SimulationError
from sim.frame.model import CHANNELS, DITHER_PX, FrameModel
from sim.frame.packed import Packed
from sim.geometry.scene import FloatArray


def checked_frame(model: FrameModel, codes: NDArray[np.uint8], what: str = "frame") -> NDArray[np.uint8]:
    """Return the frame if the kernel can read, or write, it.

    Raises
    ------
    SimulationError
        If it is not (H, W, 3) uint8 in one piece, with the model's H and W.
    """
    wanted = (*model.shape, CHANNELS)
    if not isinstance(codes, np.ndarray) or codes.dtype != np.uint8:
        kind = getattr(codes, "dtype", type(codes).__name__)
        raise SimulationError(f"{what}: {kind} instead of uint8; give codes 0 ... 255")
    if codes.shape != wanted:
        raise SimulationError(f"{what} of shape {codes.shape}; the model's pictures are {wanted}")
    if not codes.flags.c_contiguous:
        raise SimulationError(f"{what}: strides {codes.strides} are not those of one piece; give a contiguous copy")
    return codes


def reference_frame(model: FrameModel, codes: NDArray[np.uint8], gain: float = 1.0) -> NDArray[np.uint8]:
    """The projector's codes (H, W, 3) for a target's codes (H, W, 3) by the exact strategy, clamped."""
    checked_frame(model, codes)
    return coded(model, wanted_light(model, codes, gain))


def wanted_light(model: FrameModel, codes: NDArray[np.uint8], gain: float = 1.0) -> FloatArray:
    """(3, H, W) light of the projector's channels that gives the target exactly; not clamped."""
    target = (gain * model.target_scale[:, None] * model.eotf)[
        np.arange(CHANNELS)[:, None, None], np.moveaxis(codes, 2, 0)
    ]
    inverse = layers(model.inverse_direct)
    sums = patch_sums(model, inverse * target) - model.black_emission
    irradiance = np.stack([matrix @ row for matrix, row in zip(_three(model.inverse.values), sums, strict=True)])
    irradiance = np.maximum(irradiance, 0.0)
    q = inverse * target - layers(model.offset) - layers(model.view_gain) * seen(model, irradiance)
    return np.asarray(np.einsum("cb,bhw->chw", np.linalg.inv(model.mixing), q))


def patch_sums(model: FrameModel, light: FloatArray) -> FloatArray:
    """(3, L) S light for light (3, H, W) of the bands, emission as of the first band."""
    rows = model.sum_rows
    patch = model.patch_runs.value[model.patch_runs.of_pixels(model.shape)[rows], 0].ravel()
    weight = model.emission.values[0][rows]
    sums = [np.bincount(patch, (weight * band[rows]).ravel(), model.n_lit) for band in light]
    return np.stack(sums) * model.row_scale


def seen(model: FrameModel, irradiance: FloatArray) -> FloatArray:
    """(3, H, W) irradiance (3, W) of the viewed patches, bilinear in each pixel's cell."""
    cells = model.cells
    corner = irradiance[:, cells.corners[cells.runs.value[cells.runs.of_pixels(model.shape), 0]]]
    x, y = cells.place / 255.0
    return np.asarray(
        (1 - y) * ((1 - x) * corner[..., 0] + x * corner[..., 1]) + y * ((1 - x) * corner[..., 2] + x * corner[..., 3])
    )


def coded(model: FrameModel, light: FloatArray) -> NDArray[np.uint8]:
    """(H, W, 3) codes of linear light (3, H, W), clamped to the projector's range; 0 where nothing is steered."""
    height, width = model.shape
    codes = np.empty((height, width, CHANNELS), dtype=np.uint8)
    rows, columns = np.arange(height)[:, None] % DITHER_PX, np.arange(width) % DITHER_PX
    for channel in range(CHANNELS):
        code = fractional_code(model.response[channel], light[channel])
        codes[..., channel] = np.minimum(np.floor(code + model.dither[channel][rows, columns] / 256), 255)
    codes[~model.active] = 0
    return codes


def fractional_code(response: FloatArray, light: FloatArray) -> FloatArray:
    """Code between two codes whose light is the wanted one, linear between them; light beyond the ends is clamped."""
    highest = np.maximum.accumulate(response)
    rises = np.concatenate([[True], response[1:] > highest[:-1]])
    return np.asarray(np.interp(light, response[rises], np.flatnonzero(rises)))


def layers(numbers: Packed) -> FloatArray:
    """(3, H, W) numbers of each band."""
    return _three(numbers.values)


def _three(values: FloatArray) -> FloatArray:
    return np.broadcast_to(values, (CHANNELS, *values.shape[1:]))
