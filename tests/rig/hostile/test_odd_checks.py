"""Pictures of checks that the others contradict: a few are left out and named, more end the step with what to do."""

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.light.cross_check import CrossCheck
from rig.stages.light.odd_checks import are_few, first_names, odd_among, refuse_odd

NAMES = [f"checker-{k:02}" for k in range(25)]


def crossed(**off_percent: float) -> CrossCheck:
    """Pictures of which some are off, by name."""
    off = np.array([off_percent.get(name.replace("-", "_"), 0.05) for name in NAMES])
    return CrossCheck(middle_percent=0.1, off_percent=off, rms_ratio=np.ones(25))


def test_pictures_that_agree_are_all_kept() -> None:
    assert not odd_among(crossed()).any()
    refuse_odd(crossed(), NAMES)


def test_nothing_is_odd_where_too_few_pixels_were_compared() -> None:
    assert not odd_among(None).any()
    refuse_odd(None, NAMES)


@pytest.mark.parametrize("by", [4.0, -4.0])
def test_a_darker_and_a_brighter_picture_are_odd(by: float) -> None:
    assert np.flatnonzero(odd_among(crossed(checker_07=by))).tolist() == [7]


def test_a_picture_that_leaves_much_is_odd_though_its_mean_is_right() -> None:
    ratio = np.ones(25)
    ratio[3] = 2.6
    found = CrossCheck(middle_percent=None, off_percent=np.zeros(25), rms_ratio=ratio)
    assert np.flatnonzero(odd_among(found)).tolist() == [3]


@pytest.mark.parametrize(("n_odd", "few"), [(1, True), (5, True), (6, False), (25, False)])
def test_one_in_five_may_be_left_out(n_odd: int, few: bool) -> None:
    assert are_few(np.arange(25) < n_odd) is few


def test_of_four_pictures_none_may_be_left_out() -> None:
    assert not are_few(np.arange(4) < 1)


def test_a_refusal_names_pictures_figures_limits_and_what_to_do() -> None:
    with pytest.raises(CalibrationError) as refused:
        refuse_odd(crossed(checker_01=5.0, checker_02=-12.5), NAMES)
    said = str(refused.value)
    assert "2 of 25 pictures" in said
    assert "(checker-01, checker-02)" in said
    assert "checker-02 is -12.5 % of direct light off (limit 3 %)" in said
    assert "begin a new session" in said


def test_of_many_names_the_first_few_are_listed() -> None:
    assert first_names(NAMES[:6]) == "checker-00, checker-01, checker-02, checker-03, … and 2 more"
