"""A fixed point of predicted interreflection, known by blocks only (Habe et al. 2007)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sim.arrays import FloatArray, IntArray
from sim.compensation.fixed_point import iterate_clamped
from sim.compensation.result import Compensation, prepare
from sim.compensation.spectrum import damping_for
from sim.compensation.split_transport import Transport
from sim.errors import SimulationError


def block_fixed_point(
    transport: Transport,
    target: ArrayLike,
    lower: float = 0.0,
    upper: float = 1.0,
    *,
    blocks: ArrayLike | None = None,
    steps: int = 30,
    damping: float | None = None,
    tolerance: float = 1e-4,
) -> Compensation:
    """Repeat p <- clamp(K⁻¹ D⁻¹ (c - M R p)): M R p is the interreflection, constant within each block.

    Published with coarse blocks of measured interreflection; here the blocks are patches unless told otherwise.

    Limits: the steps of light within a block are not seen, so block edges show; no optimum under clamping; undamped
    it diverges in closed bright rooms.

    Parameters
    ----------
    transport, target, lower, upper
        As in :func:`sim.compensate`.
    blocks : (n,) int, optional
        Block of each pixel, negative for none; default: its patch.
    steps, damping, tolerance
        As in ``reverse_radiosity``.

    Returns
    -------
    Compensation

    Raises
    ------
    SimulationError
        For a damping with which it diverges, or blocks of the wrong shape.

    References
    ----------
    Habe, Saeki and Matsuyama, Inter-reflection compensation for immersive projection display, PROCAMS 2007.
    """
    problem = prepare(transport, target, lower, upper)
    split = problem.transport
    block = _checked(blocks, transport.pixel_patch)
    step, notes = damping_for(split, "block_fixed_point", damping)

    def correction(p: FloatArray) -> FloatArray:
        return split.divide_by_direct(problem.target - _block_means(split.indirect(split.mixed(p)), block)) - p

    wanted, taken = iterate_clamped(problem, correction, damping=step, steps=steps, tolerance=tolerance)
    return problem.result(wanted, taken, notes)


def _checked(blocks: ArrayLike | None, patches: IntArray) -> IntArray:
    block = np.asarray(patches if blocks is None else blocks)
    if block.shape != patches.shape or not np.issubdtype(block.dtype, np.integer):
        raise SimulationError(
            f"block_fixed_point: blocks {block.dtype} of shape {block.shape}; it takes one whole number a pixel, "
            f"{patches.shape}"
        )
    return block


def _block_means(values: FloatArray, block: IntArray) -> FloatArray:
    """Replace every value by the mean of its block, band by band; values outside blocks stay."""
    inside = block >= 0
    label = block[inside]
    count = np.maximum(np.bincount(label), 1)
    means = values.copy()
    for b in range(values.shape[1]):
        means[inside, b] = (np.bincount(label, weights=values[inside, b]) / count)[label]
    return means
