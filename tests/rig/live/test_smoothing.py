"""Brightness that follows the picture without pumping; keys; counting."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.live.show.controls import Controls, pressed
from rig.live.show.frame_statistics import FrameStatistics, Ring, resident_mb
from rig.live.show.smoothing import (
    TIME_CONSTANT_S,
    GainState,
    is_scene_cut,
    next_gain,
    share_at_white,
    smoothed,
    thumbnail,
    wanted_gain,
)

FRAME_S = 1 / 60


def gains(white_share_of: float, frames: int, *, start: GainState, slope: float = 4.0, cut_at: int = -1) -> list[float]:
    """Gain over time for a picture whose share at white grows with the gain."""
    state, found = start, []
    for k in range(frames):
        share = min(white_share_of * state.gain**slope, 1.0)
        state = next_gain(state, share, 1.0, FRAME_S, is_cut=k == cut_at)
        found.append(state.gain)
    return found


@given(st.floats(0, 4), st.floats(0, 4), st.floats(0, 10), st.floats(0, 10))
def test_the_filter_forgets_as_time_passes_however_it_is_cut_into_frames(
    value: float, wanted: float, first_s: float, second_s: float
) -> None:
    twice = smoothed(smoothed(value, wanted, first_s, 1.0), wanted, second_s, 1.0)
    assert twice == pytest.approx(smoothed(value, wanted, first_s + second_s, 1.0), abs=1e-9)


def test_after_one_time_constant_the_filter_has_gone_63_percent_of_the_way() -> None:
    assert smoothed(0.0, 1.0, 1.5, 1.5) == pytest.approx(1 - 1 / math.e)


def test_gain_settles_where_one_percent_is_at_white_and_does_not_swing() -> None:
    found = gains(0.16, 1200, start=GainState(1.0))
    assert 0.16 * found[-1] ** 4 == pytest.approx(0.01, rel=0.3)
    assert np.all(np.diff(found) <= 1e-12)


def test_gain_never_changes_by_more_than_one_percent_a_frame_within_a_scene() -> None:
    found = np.array([1.0, *gains(1.0, 600, start=GainState(1.0))])
    assert np.abs(np.diff(found) / found[:-1]).max() < 0.01


def test_gain_comes_back_to_the_users_when_nothing_clips() -> None:
    found = gains(0.0, 1200, start=GainState(0.3))
    assert found[-1] == pytest.approx(1.0, abs=1e-3)
    assert max(found) <= 1.0


def test_after_a_cut_gain_is_there_within_half_a_second() -> None:
    slow = gains(1.0, 30, start=GainState(1.0))
    quick = gains(1.0, 30, start=GainState(1.0), cut_at=0)
    assert quick[-1] < 0.45 < 0.8 < slow[-1]


def test_between_too_much_and_hardly_any_white_gain_stays() -> None:
    assert wanted_gain(0.7, 0.008, 1.0) == 0.7
    assert wanted_gain(0.7, 0.02, 1.0) < 0.7 < wanted_gain(0.7, 0.001, 1.0)
    assert wanted_gain(1.5, 0.008, 1.0) == 1.0


def test_a_pan_is_no_cut_and_another_scene_is() -> None:
    random = np.random.default_rng(1)
    scene = np.kron(random.integers(0, 256, (12, 20, 3)), np.ones((64, 64, 1))).astype(np.uint8)
    other = np.kron(random.integers(0, 256, (12, 20, 3)), np.ones((64, 64, 1))).astype(np.uint8)
    assert not is_scene_cut(thumbnail(scene), thumbnail(np.roll(scene, 8, axis=1)))
    assert is_scene_cut(thumbnail(scene), thumbnail(other))
    assert is_scene_cut(np.zeros((0, 0, 3), np.uint8), thumbnail(scene))


def test_the_share_at_white_is_that_of_the_picture() -> None:
    codes = np.zeros((640, 640, 3), np.uint8)
    codes[:160] = 255
    assert share_at_white(codes) == pytest.approx(0.25)


def test_gain_by_keys_stays_within_its_range_and_other_keys_change_nothing() -> None:
    controls = Controls(strategy="exact")
    for _ in range(100):
        controls = pressed(controls, "+", ("exact",))
    assert controls.gain == 4.0
    assert pressed(controls, "x", ("exact",)) == controls
    assert pressed(Controls(strategy="exact"), "s", ()) == Controls(strategy="exact")
    assert TIME_CONSTANT_S > 0.5


def test_a_ring_holds_the_last_numbers_only() -> None:
    ring = Ring(4)
    assert ring.quantile(0.5) is None
    for value in range(10):
        ring.add(value)
    assert sorted(ring.values) == [6, 7, 8, 9]


def test_a_frame_that_was_never_shown_was_not_on_time() -> None:
    statistics = FrameStatistics(0.01)
    for k in range(1, 10):
        statistics.note_frame(k, ready_s=0.01 * k, busy_s=0.001, deadline_s=0.01 * k, on_screen_s=0.01 * k)
    assert statistics.figures().on_time_share == 1.0
    assert statistics.figures(dropped=1).on_time_share == pytest.approx(0.9)
    statistics.note_error(float("nan"))
    assert statistics.figures().error_mean is None
    assert resident_mb() > 1
