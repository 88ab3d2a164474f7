"""Gloss by surface from photographs of known pictures."""

import numpy as np
import pytest

from calibration.light.transport.gloss import GlossSeen, found_gloss

SURFACES, ROUGHNESSES, PHOTOGRAPHS, PLACES = 3, 4, 12, 240


def lobes(seed=1):
    """Light by each surface's gloss: the wider the lobe, the smoother over places and pictures."""
    random = np.random.default_rng(seed)
    found = random.normal(size=(SURFACES, 1, PHOTOGRAPHS, PLACES))
    steps = [np.stack([np.roll(found[:, 0], shift, axis=2) for shift in range(2 * a + 1)]).mean(0) for a in range(4)]
    return np.stack(steps, axis=1).astype(np.float32)


def seen(by_surface, truth, noise=0.05, seed=2):
    sigma = np.full((PHOTOGRAPHS, PLACES), noise)
    light = sum(share * by_surface[r, a] for r, (share, a) in enumerate(truth))
    off = np.random.default_rng(seed).normal(size=sigma.shape) * sigma
    return GlossSeen(by_surface=by_surface, difference=np.asarray(light + off, dtype=float), sigma=sigma)


def test_gloss_and_its_roughness_are_found_where_there_is_some():
    found = found_gloss(seen(lobes(), [(0.5, 1), (0.0, 0), (0.2, 3)]))
    assert found.ratio == pytest.approx([0.5, 0.0, 0.2], abs=0.02)
    assert found.roughness[[0, 2]].tolist() == [1, 3]
    assert (np.abs(found.ratio - [0.5, 0.0, 0.2]) < 4 * found.sigma + 1e-3).all()
    assert (found.least_roughness <= found.roughness).all()
    assert (found.roughness <= found.most_roughness).all()


def test_a_surface_in_which_nothing_is_mirrored_is_not_told():
    by_surface = lobes()
    by_surface[1] = 0
    found = found_gloss(seen(by_surface, [(0.5, 1), (0.0, 0), (0.2, 3)]))
    assert np.isinf(found.sigma[1])
    assert np.isfinite(found.sigma[[0, 2]]).all()


def test_light_that_is_wrong_alike_in_neighbours_counts_for_less():
    """A model that is off in parts of the picture leaves gloss less sure than noise alone would."""
    exact = seen(lobes(), [(0.3, 1), (0.0, 0), (0.2, 3)])
    part = np.repeat(np.random.default_rng(5).normal(size=(1, 12)), PLACES // 12, axis=1)
    wrong = GlossSeen(
        by_surface=exact.by_surface,
        difference=exact.difference + 0.3 * part * exact.by_surface[0, 1],
        sigma=exact.sigma,
    )
    assert found_gloss(wrong).sigma[0] > 5 * found_gloss(exact).sigma[0]


def test_few_photographs_tell_no_standard_deviation():
    whole = seen(lobes(), [(0.5, 1), (0.0, 0), (0.2, 3)])
    few = GlossSeen(by_surface=whole.by_surface[:, :, :3], difference=whole.difference[:3], sigma=whole.sigma[:3])
    assert np.isinf(found_gloss(few).sigma).all()


def test_what_was_not_measured_counts_for_nothing():
    whole = seen(lobes(), [(0.5, 1), (0.0, 0), (0.2, 3)])
    blind = np.where(np.arange(PLACES) < 40, np.inf, whole.sigma)
    off = np.where(np.isinf(blind), 1e6, whole.difference)
    found = found_gloss(GlossSeen(by_surface=whole.by_surface, difference=off, sigma=blind))
    assert found.ratio == pytest.approx([0.5, 0.0, 0.2], abs=0.03)
