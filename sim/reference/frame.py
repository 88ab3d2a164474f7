"""What the frame kernel does, in numpy and double precision: its definition."""

from __future__ import annotations

from dataclasses import dataclass

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
    whole = layers(model.inverse_direct) * target
    irradiance = node_irradiance(model, patch_sums(model, whole) - model.black_emission)
    q = whole - layers(model.offset) - layers(model.view_gain) * seen(model, irradiance)
    return np.asarray(np.einsum("cb,bhw->chw", np.linalg.inv(model.mixing), q))


@dataclass(frozen=True, eq=False)
class BoundedState:
    """All that the bounded strategy keeps from one frame to the next."""

    irradiance: FloatArray
    """(3, W) of the nodes."""
    pull: FloatArray
    """(3, L) Hᵀ Vᵀ (predicted - wanted), emission as of the first band."""


def reference_bounded(
    model: FrameModel, codes: CodeArray, steps: int, state: BoundedState | None = None, gain: float = 1.0
) -> tuple[CodeArray, BoundedState]:
    """Return codes (H, W, 3) after so many steps towards the bounded optimum, and the state for the next frame.

    Steps begin from a frame's state, or from the exact inverse without one (docs/explanation/live-frames.md).
    """
    checked_frame(model, codes)
    target = (gain * model.target_scale[:, None] * model.eotf)[
        np.arange(CHANNELS)[:, None, None], np.moveaxis(codes, 2, 0)
    ]
    light = layers(model.inverse_direct) * target
    whole = light - layers(model.offset)
    if state is None:
        irradiance = node_irradiance(model, patch_sums(model, light) - model.black_emission)
        state = BoundedState(irradiance, np.zeros((CHANNELS, model.n_lit)))
    for _ in range(steps):
        state = _stepped(model, whole, state)
    shares, _ = _chosen(model, whole, state)
    return coded(model, shares * model.response[:, -1][:, None, None]), state


def _stepped(model: FrameModel, whole: FloatArray, state: BoundedState) -> BoundedState:
    """One step: as if the pixels at a bound stayed at that distance from what they would choose."""
    shares, free = _chosen(model, whole, state)
    beyond = np.einsum("bc,chw->bhw", model.mixing * model.response[:, -1], shares) - free
    returned = _returned(model, layers(model.view_gain) * _weights(model) * beyond)
    matrices = _three(model.inverse.values)
    pull = np.stack([matrix.T @ (model.nodes.matrix.T @ row) for matrix, row in zip(matrices, returned, strict=True)])
    sums = patch_sums(model, whole + beyond) - model.curvature * pull
    return BoundedState(node_irradiance(model, sums), pull)


def _chosen(model: FrameModel, whole: FloatArray, state: BoundedState) -> tuple[FloatArray, FloatArray]:
    """(3, H, W) shares of the channels' spans that pixels choose, and light of the bands if nothing held them back."""
    patch = model.patch_runs.value[model.patch_runs.of_pixels(model.shape), 0]
    asked = whole - layers(model.view_gain) * seen(model, state.irradiance)
    free = asked - layers(model.emission) * layers(model.inverse_direct) ** 2 * state.pull[:, patch]
    light = model.mixing * model.response[:, -1]
    wanted = np.einsum("cb,bhw->chw", np.linalg.inv(light), free)
    common = np.einsum("bhw,bc,bd->cdhw", _weights(model), light, light)
    shares = np.clip(wanted, 0, 1)
    for _ in range(_rounds(model.mixing)):
        for channel in range(CHANNELS):
            others = [other for other in range(CHANNELS) if other != channel]
            left = sum(common[channel, other] * (wanted[other] - shares[other]) for other in others)
            own = common[channel, channel]
            moved = np.divide(left, own, out=np.zeros_like(own), where=own > 0)
            shares[channel] = np.clip(wanted[channel] + moved, 0, 1)
    return shares, free


def _rounds(mixing: FloatArray) -> int:
    """Over the channels, to hold them within their range together: few where two have little in common."""
    common = mixing.T @ mixing
    shared = np.abs(common - np.diag(np.diag(common))) / np.diag(common)[:, None]
    if not shared.any():
        return 0
    return 1 if shared.max() < 0.2 else 4


def _weights(model: FrameModel) -> FloatArray:
    """(3, H, W) squared camera value of a band's light."""
    inverse = layers(model.inverse_direct)
    return np.divide(1.0, inverse**2, out=np.zeros_like(inverse), where=inverse > 0)


def _returned(model: FrameModel, light: FloatArray) -> FloatArray:
    """(3, W) light (3, H, W) brought to the nodes that see it, from the rows that sums are taken from."""
    rows, cells = model.sum_rows, model.cells
    corner = cells.corners[cells.runs.value[cells.runs.of_pixels(model.shape)[rows], 0]]
    x, y = cells.place[:, rows] / 255.0
    shares = np.stack([(1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x], axis=-1)
    n = len(model.nodes.start) - 1
    sums = [np.bincount(corner.ravel(), (shares * band[rows, :, None]).ravel(), n) for band in light]
    return np.asarray(np.stack(sums) * (model.shape[0] / len(rows)))


def node_irradiance(model: FrameModel, sums: FloatArray) -> FloatArray:
    """Return (3, W) irradiance of the nodes, at least 0, by S light (3, L)."""
    matrices = _three(model.inverse.values)
    of_nodes = [model.nodes.matrix @ (matrix @ row) for matrix, row in zip(matrices, sums, strict=True)]
    return np.asarray(np.maximum(np.stack(of_nodes), 0.0))


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
