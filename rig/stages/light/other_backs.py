"""What light would do with another guess of what nobody saw of things: part of a predicted picture's deviation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.stages.scene_model import SceneModel, camera_view

FloatArray = NDArray[np.float64]

_EVEN = 1 / 12
"""Variance of what may lie anywhere between two guesses, of their difference squared: no light rules out all of it."""
_INDEPENDENT, _LEAST_MISFIT = 12, 0.01
"""Observations that all patches together are worth, and what right rooms leave: as where walls are placed by light."""
_MOST = 1.0
"""Of a pixel's light: where next to none arrives, a ratio says nothing."""
_NO_LIGHT = 1e-9


def probability_of(other_misfit: float, misfit: float) -> float:
    """Return how likely another guess is than the one taken, of both: by what their best reflectances leave over.

    Parameters
    ----------
    other_misfit, misfit
        Relative rms of global light, outliers counted less.
    """
    costs = [_INDEPENDENT * np.log(one**2 + _LEAST_MISFIT**2) for one in (misfit, other_misfit)]
    return float(1 / (1 + np.exp(np.clip((costs[1] - costs[0]) / 2, -50, 50))))


def sigma_of_backs(taken: SceneModel, other: SceneModel, probability: float) -> FloatArray:
    """Return (H, W) relative standard deviation of what global light has apart from white's, in half pictures.

    Both models explain white; in half pictures they differ where light goes by what they guess.

    Parameters
    ----------
    taken, other
        With the same devices and one guess each.
    probability
        Of the other one.
    """
    (mine, direct), (others, _) = (_shares_of_halves(model) for model in (taken, other))
    apart, differs = ((part**2).sum(axis=1) for part in (mine - direct, others - mine))
    variance = max(probability, _EVEN) * differs / np.maximum(apart, _NO_LIGHT)
    return np.asarray(np.minimum(np.sqrt(variance), _MOST).reshape(taken.camera.lens.shape))


def _shares_of_halves(model: SceneModel) -> tuple[FloatArray, FloatArray]:
    """(n, 4) global light of four half pictures over that of white at each camera pixel, and direct light's."""
    height, width = model.projector.lens.shape
    pictures = np.zeros((5, height, width))
    pictures[0], pictures[1, :, : width // 2], pictures[2, :, width // 2 :] = 1, 1, 1
    pictures[3, : height // 2], pictures[4, height // 2 :] = 1, 1
    transport = camera_view(model.with_global_gain(1.0), np.ones(height * width, dtype=bool))
    parts = (np.asarray(part @ pictures.reshape(5, -1).T) for part in (transport.global_, transport.direct))
    global_, direct = (
        np.where(part[:, :1] > _NO_LIGHT, part / np.maximum(part[:, :1], _NO_LIGHT), 0) for part in parts
    )
    return global_[:, 1:], np.clip(direct[:, 1:], 0, 1)
