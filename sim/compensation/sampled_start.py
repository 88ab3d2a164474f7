"""A start near the optimum from a sample of the pixels: the patches' light is known long before every pixel is.

At the optimum a pixel depends on the others only through two numbers a patch and band: q, the light that comes back to
the patch, and z, what light of the patch is worth to all pixels. Both are sums over many pixels, so a sample gives
them, and one pass over the picture gives every pixel: the best p in the range for c - V q - Ω⁻¹ D⁻¹ Sᵀ z.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array, diags_array

from sim.arrays import FloatArray, IntArray
from sim.compensation.box_least_squares import BoxProblem, State, minimise, pixel_optimum
from sim.compensation.split_transport import SplitTransport, divide_where_lit
from sim.light.interreflection_operator import InterreflectionOperator

SAMPLES = 16
"""Pixels of the sample for each lit patch; pictures of up to four times as many are solved whole."""
SAMPLE_TOLERANCE = 1e-3
"""Relative gap that the sample is solved to: its patches' light is off by more for being a sample."""
SAMPLE_STEPS = 20
"""Most steps for it."""


def initial_image(problem: BoxProblem, wanted: FloatArray) -> FloatArray:
    """Return a projector image (n, C) to start from: of small pictures ``wanted``, the target's exact inverse."""
    lit = problem.transport.interreflections[0].patch_to_patch.shape[1]
    stride = len(problem.target) // max(SAMPLES * lit, 1)
    reachable = bool((wanted >= problem.lower).all() and (wanted <= problem.upper).all())
    if stride < 4 or reachable:
        return wanted
    chosen = _stratified(len(problem.target), stride)
    transport = _sampled(problem.transport, chosen)
    metric = None if problem.metric is None else problem.metric[chosen]
    small = replace(problem, transport=transport, target=problem.target[chosen], metric=metric)
    state = minimise(small, wanted[chosen], SAMPLE_TOLERANCE, SAMPLE_STEPS)[0]
    return _extended(problem, small, state, scale=len(problem.target) / len(chosen))


def _stratified(count: int, stride: int) -> IntArray:
    """One pixel at random out of every run of them; always the same."""
    first = np.arange(0, count - stride + 1, stride)
    return np.asarray(first + np.random.default_rng(0).integers(0, stride, len(first)))


def _sampled(transport: SplitTransport, chosen: IntArray) -> SplitTransport:
    interreflections = tuple(_sampled_interreflection(band, chosen) for band in transport.interreflections)
    return SplitTransport(
        bands=transport.bands,
        mixing=transport.mixing,
        diagonal=transport.diagonal[chosen],
        interreflections=interreflections,
    )


def _sampled_interreflection(whole: InterreflectionOperator, chosen: IntArray) -> InterreflectionOperator:
    """The same patches, lit by the sample as by all pixels."""
    adjoint = csr_array(whole.emission_adjoint[chosen])
    by_all, by_sample = (np.asarray(matrix.sum(axis=0)).ravel() for matrix in (whole.emission_adjoint, adjoint))
    adjoint = csr_array(adjoint @ diags_array(divide_where_lit(by_all, by_sample)))
    view = csr_array(whole.view[chosen])
    return InterreflectionOperator(
        emission=csr_array(adjoint.T),
        patch_to_patch=whole.patch_to_patch,
        view=view,
        emission_adjoint=adjoint,
        view_adjoint=csr_array(view.T),
    )


def _extended(problem: BoxProblem, small: BoxProblem, found: State, scale: float) -> FloatArray:
    """Every pixel's answer to the light of the patches that the sample found."""
    light, weighted = small.transport.mixed(found.p), small.weighted(found.residual)
    target: FloatArray = problem.target.copy()
    worth = np.empty_like(target)
    bands = zip(small.transport.interreflections, problem.transport.interreflections, strict=True)
    for b, (few, all_) in enumerate(bands):
        target[:, b] -= all_.view @ (few.patch_to_patch @ (few.emission @ light[:, b]))
        z = scale * (few.patch_to_patch.T @ (few.view_adjoint @ weighted[:, b]))
        worth[:, b] = all_.emission_adjoint @ z
    transport = problem.transport
    p = np.clip(transport.divide_by_direct(target), problem.lower, problem.upper)
    short = problem.weighted(transport.diagonal * transport.mixed(p) - target)
    gradient = np.asarray((transport.mixing.T @ (transport.diagonal * short + worth).T).T)
    return pixel_optimum(problem, p, gradient)
