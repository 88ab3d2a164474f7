"""A second guess of what nobody saw tells how far the light behind things is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.light.reflectance import ReflectanceFit
from rig.stages.light import other_backs
from rig.stages.light.other_backs import known_as_well_as, probability_of, sigma_of_backs

SHAPE = (2, 4)
DIRECT = np.zeros((2, SHAPE[0] * SHAPE[1]))
DIRECT[0, 0] = DIRECT[1, 3] = 1.0
"""Two camera pixels, lit by the left and by the right upper corner."""


def model(global_):
    """A scene whose camera sees so much global light (2 pixels, n of the projector)."""
    lens = SimpleNamespace(shape=SHAPE, n_pixels=SHAPE[0] * SHAPE[1])
    device = SimpleNamespace(lens=lens)
    one = SimpleNamespace(projector=device, camera=SimpleNamespace(lens=SimpleNamespace(shape=(1, 2))))
    one.transport = SimpleNamespace(direct=DIRECT, global_=np.asarray(global_, float))
    one.with_global_gain = lambda _gain: one
    return one


@pytest.fixture(autouse=True)
def seen_through(monkeypatch):
    monkeypatch.setattr(other_backs, "camera_view", lambda scene_model, _active: scene_model.transport)


EVEN = np.full((2, 8), 0.1)
LEANS = EVEN * np.where(np.arange(8) % 4 < 2, 1.5, 0.5)
"""As much light of white, but three quarters of it from the left half."""


def test_guesses_that_agree_add_nothing():
    assert sigma_of_backs(model(EVEN), model(EVEN), 0.5) == pytest.approx(0.0)


def test_where_guesses_differ_half_pictures_are_uncertain_by_it():
    # Left and right half differ by a quarter of white's global light; all four are half of it from direct light's.
    expected = np.sqrt(0.25 * 2 * 0.25**2 / (4 * 0.5**2))
    assert sigma_of_backs(model(EVEN), model(LEANS), 0.25) == pytest.approx(expected)


def test_what_scales_all_light_alike_is_no_uncertainty_since_white_was_measured():
    assert sigma_of_backs(model(EVEN), model(1.7 * EVEN), 0.5) == pytest.approx(0.0)


def test_a_guess_that_light_speaks_against_still_counts_as_one_end_of_what_may_be():
    low = sigma_of_backs(model(EVEN), model(LEANS), 1e-6)
    assert low == pytest.approx(sigma_of_backs(model(EVEN), model(LEANS), 1 / 12))


def test_a_pixel_that_no_light_reaches_has_a_number():
    dark = EVEN * np.array([[1.0], [0.0]])
    assert np.isfinite(sigma_of_backs(model(dark), model(dark), 0.5)).all()


@pytest.mark.parametrize(("other", "least", "most"), [(0.05, 0.5, 0.5), (0.1, 0.0, 0.05), (0.04, 0.7, 0.95)])
def test_the_guess_that_leaves_more_light_unexplained_is_the_less_likely(other, least, most):
    assert least - 1e-9 <= probability_of(other, 0.05) <= most + 1e-9


def fit(*, lit, unseen, flux):
    """Two patches that are lit and seen, and some of which the light tells nothing; known to a hundredth."""
    rho = np.array([*lit, *unseen])
    return ReflectanceFit(
        reflectance=rho,
        source=np.array([0] * len(lit) + [2] * len(unseen), dtype=np.uint8),
        flux=flux,
        sigma=np.full(len(rho), 0.01),
        unseen_reflectance=float(np.mean(unseen)),
        global_rms=0.05,
        flux_sigma=0.1,
        unseen_sigma=0.01,
    )


THIN = fit(lit=(0.4, 0.8), unseen=(0.5,), flux=10.0)
DEEP = fit(lit=(0.5, 1.0), unseen=(0.6, 0.6, 0.6), flux=8.0)
"""As much direct light from a weaker lamp: walls a quarter brighter, and more of what nobody saw."""


def test_reflectances_are_known_no_better_than_the_other_guess_of_backs_lets_them():
    known = known_as_well_as(THIN, DEEP, 0.25)
    assert known.sigma == pytest.approx(np.hypot(0.01, 0.5 * np.array([0.1, 0.2, 0.1])))
    assert known.flux_sigma == pytest.approx(np.hypot(0.1, 0.5 * 2.0))
    assert known.unseen_sigma == pytest.approx(np.hypot(0.01, 0.5 * 0.1))


def test_the_other_guess_widens_sigmas_and_moves_no_value():
    known = known_as_well_as(THIN, DEEP, 0.25)
    assert (known.reflectance == THIN.reflectance).all()
    assert known.flux == THIN.flux


def test_guesses_with_the_same_reflectances_leave_sigmas_as_they_are():
    assert known_as_well_as(THIN, THIN, 0.5).sigma == pytest.approx(THIN.sigma)
