"""What light would do with other guesses of what nobody saw of things: part of what is not known of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial, reduce

import numpy as np
from numpy.typing import NDArray

from calibration.light.reflectance import ReflectanceFit, ReflectanceSource
from rig.stages.light.choice import FittedRoom
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


def probabilities(taken: FittedRoom, other: FittedRoom) -> list[float]:
    """Return how likely the other room is than the one taken, of both, in each band."""
    pairs = zip(other.fits, taken.fits, strict=True)
    return [probability_of(one.usual_misfit, mine.usual_misfit) for one, mine in pairs]


def with_other_guesses(taken: FittedRoom, others: Iterable[FittedRoom]) -> FittedRoom:
    """Return the room with what other guesses make of its reflectances and flux in their standard deviations."""
    return replace(taken, fits=reduce(partial(_with_other, taken), others, taken.fits))


def _with_other(taken: FittedRoom, known: list[ReflectanceFit], other: FittedRoom) -> list[ReflectanceFit]:
    fits = zip(known, other.fits, probabilities(taken, other), strict=True)
    return [known_as_well_as(*one) for one in fits]


def known_as_well_as(taken: ReflectanceFit, other: ReflectanceFit, probability: float) -> ReflectanceFit:
    """Return a fit whose standard deviations reach for what another guess of the room says.

    Patches of the two rooms are not the same ones, so reflectances are taken to differ as their means do, of what is
    lit and seen, of what is only seen, and of what is neither: what a guess changes is how much light comes back, and
    by that the flux, which all lit patches share.

    Parameters
    ----------
    taken, other
        Of the two rooms.
    probability
        Of the other one.
    """
    share = np.sqrt(max(probability, _EVEN))
    variance = taken.sigma**2
    for source in ReflectanceSource:
        mine, others = (fit.reflectance[fit.source == source] for fit in (taken, other))
        if mine.size and others.size:
            ratio = others.mean() / max(float(mine.mean()), _NO_LIGHT)
            variance[taken.source == source] += (share * (ratio - 1) * mine) ** 2
    return replace(
        taken,
        sigma=np.sqrt(variance),
        flux_sigma=float(np.hypot(taken.flux_sigma, share * (other.flux - taken.flux))),
        unseen_sigma=float(np.hypot(taken.unseen_sigma, share * (other.unseen_reflectance - taken.unseen_reflectance))),
    )


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
