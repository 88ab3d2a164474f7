"""What photographs have taught of a transport, as frames know it: more light that its patches send back.

A pixel of a frame sees four patches and nothing else, so U V S, U by pixel, becomes V' W V S, V' the view of patches:
W is what comes nearest to U in it, in least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sim.arrays import FloatArray
from sim.light.learned_transport import LearnedRadiosity
from sim.light.transport import LightTransport

_DAMPING = 1e-3
"""Of the mean weight with which patches are seen: those that hardly any pixel sees stay near nothing."""


@dataclass(frozen=True, eq=False, kw_only=True)
class OnPatches:
    """A transport of patches alone, and what they send back beside its radiosity."""

    transport: LightTransport
    by_view: FloatArray
    """(P, r) W; nothing was learned: r is 0."""
    by_patch: FloatArray
    """(r, P) V, of the patches' emission."""
    left_out: float
    """Share, rms, of what was learned that patches cannot show: it changes within them."""


def on_patches(transport: LightTransport) -> OnPatches:
    """Return a transport with what was learned of it brought to its patches."""
    radiosity = transport.radiosity
    n_patches = radiosity.n_patches
    if not isinstance(radiosity, LearnedRadiosity):
        none = np.zeros((n_patches, 0))
        return OnPatches(transport=transport, by_view=none, by_patch=none.T, left_out=0.0)
    n_patches = radiosity.scene.n_patches
    alone = LightTransport(
        transport.direct_matrix,
        csr_array(transport.emission[:n_patches]),
        radiosity.scene,
        csr_array(transport.view[:, :n_patches]),
        pixel_patch=transport.pixel_patch,
        pixel_xy_px=transport.pixel_xy_px,
        blur=transport.blur,
    )
    by_pixel = transport.view[:, n_patches:].toarray()
    by_view = _nearest(alone.view, by_pixel)
    by_white = radiosity.by_patch * np.asarray(alone.emission.sum(axis=1))
    missing, whole = (
        float(np.linalg.norm(np.linalg.cholesky(_moments(each)).T @ by_white))
        for each in (by_pixel - alone.view @ by_view, by_pixel)
    )
    return OnPatches(
        transport=alone, by_view=by_view, by_patch=radiosity.by_patch, left_out=missing / whole if whole > 0 else 0.0
    )


def _nearest(view: csr_array, by_pixel: FloatArray) -> FloatArray:
    """(P, r) what patches have to send for pixels to see nearly `by_pixel` (n, r)."""
    viewed = np.unique(view.indices)
    weights = view[:, viewed]
    moments = (weights.T @ weights).toarray()
    moments += _DAMPING * max(float(np.mean(np.diag(moments))), np.finfo(float).tiny) * np.eye(len(viewed))
    found = np.zeros((view.shape[1], by_pixel.shape[1]))
    found[viewed] = np.linalg.solve(moments, weights.T @ by_pixel)
    return found


def _moments(values: FloatArray) -> FloatArray:
    """(r, r) their second moments, with next to nothing on the diagonal."""
    moments = values.T @ values
    return np.asarray(moments + 1e-12 * max(float(np.trace(moments)), np.finfo(float).tiny) * np.eye(len(moments)))
