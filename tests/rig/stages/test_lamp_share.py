"""A lamp that gets brighter while a session lasts: told from noise by white, and taken out of the pictures between."""

from __future__ import annotations

import numpy as np
import pytest

from rig.stages.light.lamp import LampRecord, lamp_share, without_drift
from rig.stages.linear_light import LightImage

SHAPE = (48, 64, 1)
WHITE = np.linspace(0.3, 0.8, 48 * 64).reshape(SHAPE)


def white(share: float, *, seed: int, noise: float = 0.01) -> LightImage:
    value = share * WHITE + np.random.default_rng(seed).normal(0, noise, SHAPE)
    return LightImage(value.astype(np.float32), np.full(SHAPE, noise**2, np.float32), np.zeros(SHAPE, dtype=bool))


@pytest.mark.parametrize("share", [0.97, 1.004, 1.03])
def test_a_change_that_noise_cannot_explain_is_the_lamps(share: float) -> None:
    assert lamp_share(white(share, seed=1), white(1.0, seed=2)) == pytest.approx(share, abs=0.0015)


@pytest.mark.parametrize("seed", range(3, 9))
def test_noise_is_no_change_of_the_lamp(seed: int) -> None:
    assert lamp_share(white(1.0, seed=seed), white(1.0, seed=20 + seed)) == 1.0


def test_what_is_clipped_says_nothing_of_the_lamp() -> None:
    bright = white(1.02, seed=1)
    clipped = np.zeros(SHAPE, dtype=bool)
    clipped[:, 40:] = True
    cut = LightImage(np.where(clipped, np.float32(0.1), bright.value), bright.variance, clipped)
    assert lamp_share(cut, white(1.0, seed=2)) == pytest.approx(1.02, abs=0.002)
    nothing = LightImage(bright.value, bright.variance, np.ones(SHAPE, dtype=bool))
    assert lamp_share(nothing, white(1.0, seed=2)) == 1.0


def test_a_pictures_light_is_that_of_the_lamp_as_it_was_for_the_model() -> None:
    lamp = LampRecord(times_s=(10.0, 20.0), shares=(1.02, 1.04))
    assert lamp.at(15.0) == pytest.approx(1.03)
    mended = without_drift(white(1.03, seed=1, noise=1e-6), lamp.at(15.0))
    np.testing.assert_allclose(mended.value, WHITE, rtol=1e-4)
    np.testing.assert_allclose(mended.variance, (1e-6 / 1.03) ** 2, rtol=1e-5)


@pytest.mark.parametrize("time_s", [9.0, 21.0])
def test_of_pictures_that_no_white_surrounds_nothing_is_taken_out(time_s: float) -> None:
    """Taken over from an earlier run of the step: nobody knows what the lamp did then."""
    assert LampRecord(times_s=(10.0, 20.0), shares=(1.02, 1.04)).at(time_s) == 1.0


def test_between_three_whites_the_lamp_changes_evenly_from_one_to_the_next() -> None:
    lamp = LampRecord(times_s=(10.0, 20.0, 40.0), shares=(0.98, 1.0, 1.01))
    assert [lamp.at(time_s) for time_s in (10.0, 15.0, 20.0, 30.0, 40.0)] == pytest.approx(
        [0.98, 0.99, 1.0, 1.005, 1.01]
    )
    assert lamp.at(41.0) == 1.0


def test_of_drift_that_is_taken_out_no_more_is_left_than_changed_between_two_looks() -> None:
    """A jump just after the first look is the worst: the line knows nothing of it there."""
    lamp = LampRecord(times_s=(10.0, 20.0, 40.0), shares=(0.98, 1.0, 1.01))
    jumped = 1.0
    assert lamp.left == pytest.approx(jumped - lamp.at(10.0))


def test_what_nobody_looked_at_says_nothing_of_what_is_left() -> None:
    assert LampRecord(times_s=(0.0, 0.0), shares=(1.0, 1.0)).left is None
