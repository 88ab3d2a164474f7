"""A start near the optimum from a sample of the pixels: the patches' light is known long before every pixel is.

At the optimum a pixel depends on the others only through two numbers a patch and band: q, the light that comes back to
the patch, and z, what light of the patch is worth to all pixels. Both are sums over many pixels, so a sample gives
them, and one pass over the picture gives every pixel: the best p in the range for c - V q - Ω⁻¹ D⁻¹ Sᵀ z.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array

from sim.compensation.box_least_squares import BoxProblem, pixel_optimum, solved
from sim.compensation.split_transport import SplitTransport, divided
from sim.geometry.scene import FloatArray, IntArray
from sim.light.interreflection_operator import InterreflectionOperator

SAMPLES = 16
"""Pixels of the sample for each lit patch; pictures of up to four times as many are solved whole."""
SAMPLE_TOLERANCE = 1e-3
SAMPLE_STEPS = 20


def start_of(problem: BoxProblem, wanted: FloatArray) -> FloatArray:
    """Projector image (n, C) to start from; ``wanted``, the exact inverse of the target, for small pictures."""
    lit = problem.view.couplings[0].interreflection.shape[1]
    stride = len(problem.target) // max(SAMPLES * lit, 1)
    reachable = bool((wanted >= problem.lower).all() and (wanted <= problem.upper).all())
    if stride < 4 or reachable:
        return wanted
    chosen = _stratified(len(problem.target), stride)
    view = _sampled(problem.view, chosen)
    metric = None if problem.metric is None else problem.metric[chosen]
    small = BoxProblem(view, problem.target[chosen], problem.lower, problem.upper, metric)
    state = solved(small, wanted[chosen], SAMPLE_TOLERANCE, SAMPLE_STEPS)[0]
    return _extended(problem, small, state.p, small.weighed(state.residual), len(problem.target) / len(chosen))


def _stratified(count: int, stride: int) -> IntArray:
    """One pixel at random out of every run of them; always the same."""
    first = np.arange(0, count - stride + 1, stride)
    return np.asarray(first + np.random.default_rng(0).integers(0, stride, len(first)))


def _sampled(view: SplitTransport, chosen: IntArray) -> SplitTransport:
    couplings = tuple(_sampled_coupling(coupling, chosen) for coupling in view.couplings)
    return SplitTransport(view.bands, view.mixing, view.diagonal[chosen], couplings)


def _sampled_coupling(coupling: InterreflectionOperator, chosen: IntArray) -> InterreflectionOperator:
    """The same patches, lit by the sample as by all pixels."""
    adjoint = csr_array(coupling.emission_adjoint[chosen])
    whole, part = (np.asarray(matrix.sum(axis=0)).ravel() for matrix in (coupling.emission_adjoint, adjoint))
    adjoint = csr_array(adjoint @ diags_array(divided(whole, part)))
    view = csr_array(coupling.view[chosen])
    return InterreflectionOperator(csr_array(adjoint.T), coupling.interreflection, view, adjoint, csr_array(view.T))


def _extended(problem: BoxProblem, small: BoxProblem, p: FloatArray, weighted: FloatArray, scale: float) -> FloatArray:
    """Every pixel's answer to the light of the patches that the sample found."""
    light = small.view.mixed(p)
    target: FloatArray = problem.target.copy()
    worth = np.empty_like(target)
    for b, (few, all_) in enumerate(zip(small.view.couplings, problem.view.couplings, strict=True)):
        target[:, b] -= all_.view @ (few.interreflection @ (few.emission @ light[:, b]))
        z = scale * (few.interreflection.T @ (few.view_adjoint @ weighted[:, b]))
        worth[:, b] = all_.emission_adjoint @ z
    view = problem.view
    p = np.clip(view.by_direct(target), problem.lower, problem.upper)
    short = problem.weighed(view.diagonal * view.mixed(p) - target)
    gradient = np.asarray((view.mixing.T @ (view.diagonal * short + worth).T).T)
    return pixel_optimum(problem, p, gradient)
