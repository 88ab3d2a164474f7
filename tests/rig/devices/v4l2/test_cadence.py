"""Which time stamps of a camera came too late to be believed."""

import numpy as np
import pytest

from rig.devices.v4l2.cadence import Cadence

PERIOD_S = 1 / 30


def late(stamps_s, numbers=None, *, exposure_s: float = 0.01, period_s: float = PERIOD_S) -> list[int]:
    """Numbers of the stamps that are called late."""
    cadence = Cadence(period_s)
    counted = range(len(stamps_s)) if numbers is None else numbers
    return [n for n, stamp_s in zip(counted, stamps_s, strict=True) if cadence.is_late(n, stamp_s, exposure_s)]


def test_a_steady_camera_is_never_late() -> None:
    assert late(np.arange(10_000) * PERIOD_S) == []


@pytest.mark.parametrize("delay_s", [0.6 * PERIOD_S, 3 * PERIOD_S, 1.0])
def test_one_late_stamp_is_found_and_the_next_one_is_believed(delay_s: float) -> None:
    stamps_s = np.arange(20) * PERIOD_S
    stamps_s[7] += delay_s
    assert late(stamps_s) == [7]


def test_jitter_of_a_third_of_a_period_is_no_lateness() -> None:
    random = np.random.default_rng(4)
    stamps_s = np.arange(2000) * PERIOD_S + random.uniform(0, PERIOD_S / 3, 2000)
    assert late(stamps_s) == []


def test_counted_losses_are_no_lateness() -> None:
    numbers = [0, 1, 5, 6, 30, 31, 331]
    assert late([n * PERIOD_S for n in numbers], numbers) == []


def test_a_late_stamp_after_losses_is_found() -> None:
    assert late([0.0, PERIOD_S, 6 * PERIOD_S, 7 * PERIOD_S], [0, 1, 5, 7]) == [5]


def test_a_rate_one_percent_off_the_set_one_is_no_lateness() -> None:
    numbers = [0, 1, 2, 3, 103, 104]
    assert late([n * PERIOD_S * 1.01 for n in numbers], numbers) == []


def test_a_camera_that_slows_down_without_a_word_costs_three_frames() -> None:
    slow_s = [1.0 + k * 2 * PERIOD_S for k in range(10)]
    fast_s = [1.0 + (k - 10) * PERIOD_S for k in range(10)]
    assert late([*fast_s, *slow_s]) == [11, 12, 13]


def test_long_exposures_slow_a_camera_down_and_are_expected_to() -> None:
    assert late(np.arange(20) * 0.25, exposure_s=0.24) == []


def test_a_counter_that_begins_anew_is_not_judged_by_the_old_one() -> None:
    assert late([0.0, PERIOD_S, 5.0, 5.0 + PERIOD_S], [100, 101, 0, 1]) == []
