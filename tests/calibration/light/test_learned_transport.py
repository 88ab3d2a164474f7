"""Light transport by photographs on top of a model, in small rooms of which brute force knows everything."""

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.light.transport.choice import least_certain, next_photograph
from calibration.light.transport.low_rank import low_rank
from calibration.light.transport.posterior import Photographs, fitted, left_out, posterior
from calibration.light.transport.prior import TransportPrior
from sim.form_factors import form_factors
from sim.scenes.gridded import room

NOISE = 0.0003
"""Of white's global light, at each place, of one photograph."""


class SmallRoom:
    """A room of random size and reflectances, lit on two walls; the model has other reflectances than the truth."""

    def __init__(self, seed):
        random = np.random.default_rng(seed)
        scene = room(tuple(random.uniform(2.0, 5.0, 3)), 1.0, 0.5)
        self.areas, factors = scene.areas, form_factors(scene).matrix
        self.lit = np.flatnonzero(scene.region < 2)
        self.emission = random.uniform(0.5, 1.0, len(self.lit))
        rough = random.uniform(0.4, 0.8, scene.n_patches)
        self.reflectance = np.clip(rough * random.normal(1.0, 0.15, scene.n_patches), 0.1, 0.95)
        self.model, self.truth = (self._light(factors, rho) for rho in (rough, self.reflectance))
        # White was measured, and the model is scaled to it.
        self.model *= (self.truth.sum(axis=1) / self.model.sum(axis=1))[:, None]
        centres = scene.centres[self.lit]
        apart = np.linalg.norm(centres[:, None] - centres, axis=2)
        values, vectors = np.linalg.eigh(np.exp(-(apart**2) / (2 * 1.0**2)) + 0.1 * np.eye(len(self.lit)))
        self.kernel = vectors * np.sqrt(values)
        self.random = random

    def _light(self, factors, rho):
        """(P, L) what every patch sends back of the light that falls on each lit one."""
        whole = np.linalg.inv(np.eye(len(rho)) - rho[:, None] * factors) - np.eye(len(rho))
        return whole[:, self.lit] * self.emission

    def prior(self, spread=0.2, transport=None):
        n = len(self.model)
        transport = self.model if transport is None else transport
        return TransportPrior(
            transport=transport,
            base=0.8 * transport + 0.2 * transport.sum(axis=1, keepdims=True) / len(self.lit),
            kernel=self.kernel,
            spread=np.full(n, spread),
            lobes=np.zeros((n, 0, len(self.lit))),
            left=np.zeros((n, 0)),
            right=np.zeros((0, len(self.lit))),
            own=np.zeros(n),
        )

    def photographs(self, lit, noise=NOISE):
        white = self.truth.sum(axis=1)
        sigma = noise * np.broadcast_to(white, (len(lit), len(white)))
        seen = lit @ (self.truth - self.model).T + self.random.normal(size=sigma.shape) * sigma
        return Photographs(lit=lit, own=np.zeros(sigma.shape), difference=seen, variance=sigma**2)

    def pictures(self, count, seed=1):
        return np.random.default_rng(seed).uniform(size=(count, len(self.lit)))


@pytest.fixture(scope="module", params=[1, 2, 3])
def small(request):
    return SmallRoom(request.param)


def halves(small, count):
    return (np.random.default_rng(2).uniform(size=(count, len(small.lit))) > 0.5).astype(float)


def test_a_few_photographs_halve_the_error_and_say_how_sure_they_are(small):
    found, shown = fitted(small.prior(), small.photographs(halves(small, 24))), small.pictures(40)
    wrong = shown @ (small.truth - small.model).T
    own = np.zeros((len(shown), len(small.model)))
    left = wrong - found.expected(shown, own)
    assert np.sqrt((left**2).mean()) < 0.5 * np.sqrt((wrong**2).mean())
    assert (np.abs(left) < 3 * np.sqrt(found.variance(shown, own))).mean() > 0.93


def test_every_patch_alone_is_brute_force(small):
    alone = np.eye(len(small.lit))
    found = posterior(small.prior(spread=1.0), small.photographs(alone))
    off = (small.model + found.change - small.truth) / small.truth.sum(axis=1, keepdims=True)
    assert np.sqrt((off**2).mean()) < 1.2 * NOISE


def test_what_was_learned_is_as_reciprocal_as_light(small):
    """B_i by light on j, over ρ_i / A_i, is that of B_j by light on i."""
    found = posterior(small.prior(spread=1.0), small.photographs(np.eye(len(small.lit)), noise=1e-5))
    whole = (small.model + found.change)[small.lit] / small.emission
    symmetric = whole * (small.reflectance / small.areas)[small.lit][None, :]
    assert np.abs(symmetric - symmetric.T).max() < 0.01 * symmetric.max()
    before = (small.model[small.lit] / small.emission) * (small.reflectance / small.areas)[small.lit][None, :]
    assert np.abs(before - before.T).max() > 0.02 * before.max()


def test_white_keeps_its_light(small):
    found = fitted(small.prior(), small.photographs(halves(small, 10)))
    assert np.abs(found.change.sum(axis=1) / small.truth.sum(axis=1)).max() < 0.005


def test_lights_add_up(small):
    found = fitted(small.prior(), small.photographs(halves(small, 6)))
    first, second = (small.pictures(1, seed) for seed in (5, 6))
    none = np.zeros((1, len(small.model)))
    together = found.expected(first + 2 * second, none)
    assert np.allclose(together, found.expected(first, none) + 2 * found.expected(second, none))
    assert np.allclose(together, (first + 2 * second) @ found.change.T)


def test_what_one_more_would_bring_falls_below_the_noise(small):
    white, n = small.truth.sum(axis=1), len(small.model)
    noise, usual, known = (NOISE * white) ** 2, small.pictures(12, 7), Photographs.none(small.prior())
    brings = []
    for _ in range(25):
        found = fitted(small.prior(), known)
        shown = np.concatenate([np.eye(len(small.lit)), least_certain(found, 4)])
        candidates, wanted = (small.prior().of_one(each, np.zeros((len(each), n))) for each in (shown, usual))
        best = next_photograph(found, candidates, wanted, noise)
        brings.append(best.brings)
        known = known.and_(small.photographs(shown[best.index : best.index + 1]))
    assert brings[-1] < 0.2 * max(brings)
    assert brings[-1] < 3 * np.sqrt(noise.mean())


def test_direct_light_that_was_taken_for_global_light_is_found(small):
    n = len(small.model)
    prior = small.prior()
    prior = TransportPrior(**{**vars(prior), "own": np.full(n, 0.05)})
    lit, own = halves(small, 12), (np.random.default_rng(8).uniform(size=(12, n)) > 0.5).astype(float)
    share = (small.model @ lit.T / small.model.sum(axis=1)[:, None]).T
    exact = small.photographs(lit)
    moved = Photographs(lit=lit, own=own, difference=exact.difference + 0.05 * (own - share), variance=exact.variance)
    assert np.median(posterior(prior, moved).direct_change) == pytest.approx(0.05, rel=0.1)


def test_few_columns_keep_a_change_of_low_rank():
    random = np.random.default_rng(9)
    change = random.normal(size=(50, 3)) @ random.normal(size=(3, 20))
    few = low_rank(change, np.eye(20), 10)
    assert few.by_patch.shape == (3, 20)
    assert np.allclose(few.by_place @ few.by_patch, change)


def test_what_was_not_measured_tells_nothing(small):
    taken = small.photographs(halves(small, 4))
    blind = Photographs(**{**vars(taken), "variance": np.full_like(taken.variance, np.inf)})
    assert np.allclose(posterior(small.prior(), blind).change, 0)


def test_photographs_that_do_not_fit_are_refused(small):
    taken = small.photographs(halves(small, 4))
    with pytest.raises(CalibrationError, match="a row each"):
        Photographs(**{**vars(taken), "own": taken.own[:2]})
    with pytest.raises(CalibrationError, match="uncertain"):
        Photographs(**{**vars(taken), "variance": np.zeros_like(taken.variance)})


def test_what_the_others_make_of_a_photograph_is_what_they_make_without_it(small):
    taken, prior = small.photographs(halves(small, 6)), small.prior()
    apart = left_out(prior, taken)
    others = Photographs(**{name: values[1:] for name, values in vars(taken).items()})
    without = posterior(prior, others)
    assert np.allclose(apart.off[0], taken.difference[0] - without.expected(taken.lit[:1], taken.own[:1])[0])
    assert np.allclose(apart.expected[0], without.variance(taken.lit[:1], taken.own[:1])[0], rtol=1e-5)


def test_photographs_that_contradict_each_other_are_told_by_what_they_make_of_each_other(small):
    """Light that moved between photographs, of which neither noise nor prior know, cannot be hidden by a good fit."""
    taken = small.photographs(halves(small, 16))
    moved = 0.05 * small.truth.sum(axis=1) * np.random.default_rng(3).normal(size=taken.difference.shape)
    disturbed = Photographs(**{**vars(taken), "difference": taken.difference + moved})
    quiet, shaken = (fitted(small.prior(), each) for each in (taken, disturbed))
    apart = left_out(shaken.prior, disturbed)
    assert np.sqrt((apart.off**2 - apart.noise).mean()) > np.sqrt((moved**2).mean())
    assert shaken.wider.mean() > 1.5 * quiet.wider.mean()
