"""Three to five boards: what they do not tell of the lenses and the board is in the sigmas."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.lenses.calibrate import LensFit, LensRequest, calibrate_lenses
from calibration.lenses.records import RigState
from tests.calibration.lenses.board_world import CAMERA, CAMERA_SIZE, PROJECTOR, PROJECTOR_SIZE, sightings, truth

OPEN = LensRequest(camera_size_px=CAMERA_SIZE, projector_size_px=PROJECTOR_SIZE)
READ = [0, 1, 2, 3, 12, 13, 14, 15]
"""Focal lengths and principal points."""


def drawn(seed: int, views: int) -> RigState:
    """Lenses with other terms, and a board that may be bent by half a millimetre."""
    rng = np.random.default_rng(seed)
    camera, projector = CAMERA.copy(), PROJECTOR.copy()
    camera[4:8] = rng.normal(size=4) * [0.15, 0.15, 0.0008, 0.0008]
    projector[4:8] = rng.normal(size=4) * [0.05, 0.05, 0.0003, 0.0003]
    flex_m = rng.normal(size=3) * rng.choice([0.0, 4e-4])
    return replace(truth(views, seed=seed), camera=camera, projector=projector, flex_m=flex_m)


def fitted(seed: int, views: int) -> tuple[LensFit, np.ndarray]:
    """A fit, and its errors over their sigmas."""
    state = drawn(seed, views)
    fit = calibrate_lenses(sightings(state, seed=seed), OPEN)
    found, sigma = fit.calibration.state, fit.calibration.sigmas()
    off = np.concatenate([found.camera - state.camera, found.projector - state.projector])
    return fit, (off / np.where(sigma[:24] > 0, sigma[:24], np.inf))[READ]


@pytest.mark.parametrize("views", [3, 4, 5])
def test_errors_of_hardly_enough_views_are_within_what_is_stated(views: int) -> None:
    # as terms that were taken for zero, errors came to 7.5 of their sigmas (rms 1.5) over sixty such sets
    z = np.concatenate([fitted(seed, views)[1] for seed in range(100, 106)])
    assert np.abs(z).max() < 3.5
    assert 0.4 < np.sqrt((z**2).mean()) < 1.4


def test_more_views_narrow_what_is_stated() -> None:
    sigmas = [fitted(7, views)[0].calibration.sigmas()[0] for views in (3, 5, 12)]
    assert sigmas[0] > sigmas[1] > sigmas[2] > 0


def test_a_term_that_few_views_cannot_tell_is_as_uncertain_as_before_any_view() -> None:
    state = truth(3)
    far = replace(state, translations_m=state.translations_m * [1, 1, 3])  # boards in the middle of the picture alone
    alone = replace(OPEN, projector_size_px=None)
    known = [calibrate_lenses(sightings(one).camera_only(), alone).calibration.sigmas()[5] for one in (state, far)]
    assert known[0] < 0.2
    assert 0.45 < known[1] <= 0.51
