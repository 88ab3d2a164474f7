"""The loop that shows live pictures: in virtual time, with everything around it standing in."""

import itertools

import numpy as np
import pytest

from rig.devices.protocols import Codes, Shown
from rig.errors import DeviceLost
from rig.live.show.controls import Controls
from rig.live.show.frame_pacing import DisplayClock, LatchTimer
from tests.rig.live.stand_ins import PERIOD_S, RATE_HZ, Doubler, stage


def every(interval_s: float, seconds: float, first_s: float = 0.004) -> list[float]:
    return [first_s + k * interval_s for k in range(int(seconds / interval_s))]


def test_a_source_in_the_displays_pace_gets_every_frame_on_screen_in_time() -> None:
    show = stage(every(PERIOD_S, 2.0), busy_s=0.005)
    show.run()
    figures = show.loop.statistics.figures()
    assert figures.frames == 120
    assert (show.queue.dropped, figures.late_frames, figures.repeated, figures.out_of_order) == (0, 0, 0, 0)
    assert figures.fps_median == pytest.approx(RATE_HZ)
    assert show.codes[:3] == [2, 4, 6]


def test_each_refresh_has_one_frame_and_no_frame_comes_twice() -> None:
    show = stage(every(PERIOD_S, 1.0), busy_s=0.006)
    show.run()
    times = [frame.on_screen_s for frame in show.shown]
    assert np.allclose(np.diff(times), PERIOD_S)
    assert [frame.number for frame in show.shown] == sorted({frame.number for frame in show.shown})


def test_a_slow_source_leaves_its_picture_on_screen_and_no_frame_is_late() -> None:
    show = stage(every(1 / 15, 2.0), busy_s=0.005)
    show.run()
    figures = show.loop.statistics.figures()
    assert figures.frames == 30
    assert figures.late_frames == 0
    assert figures.repeated == 3 * 29


def test_a_fast_source_is_shown_at_the_displays_pace_newest_frames_first() -> None:
    show = stage(every(1 / 240, 1.0), busy_s=0.002)
    show.run()
    figures = show.loop.statistics.figures()
    assert figures.fps_median == pytest.approx(RATE_HZ)
    assert figures.frames + show.queue.dropped == 240
    assert show.queue.dropped > 150
    assert figures.latency_ms.p99 < 1.5 * 1000 * PERIOD_S


def test_under_load_frames_are_dropped_and_what_is_shown_is_new() -> None:
    show = stage(every(PERIOD_S, 2.0), busy_s=0.030)
    show.run()
    figures = show.loop.statistics.figures()
    assert show.queue.dropped > 50
    assert figures.late_frames > 0
    assert figures.latency_ms.p99 < 1000 * (0.030 + 2 * PERIOD_S)
    assert figures.out_of_order == 0


@pytest.mark.parametrize("phase", [0.0, 0.1, 0.3, 0.5, 0.7, 0.9])
def test_latency_stays_below_one_and_a_half_frames_in_every_phase_of_the_source(phase: float) -> None:
    show = stage(every(PERIOD_S, 1.0, first_s=0.1 + phase * PERIOD_S), busy_s=0.005)
    show.run()
    assert show.loop.statistics.figures().latency_ms.p99 <= 1.5 * 1000 * PERIOD_S
    assert show.loop.statistics.late == 0


def test_frames_in_wrong_order_are_counted() -> None:
    show = stage(every(PERIOD_S, 0.1), numbers=[1, 2, 4, 3, 5, 6])
    show.run()
    assert show.loop.statistics.out_of_order == 1


def test_the_end_of_the_source_ends_the_loop() -> None:
    show = stage(every(PERIOD_S, 0.1))
    show.run()
    assert show.loop.ended == "source"


def test_the_key_q_ends_the_loop_at_once() -> None:
    show = stage(itertools.islice(itertools.count(0.0, PERIOD_S), 10_000))
    show.run_until_s(0.5)
    show.pressed.append("q")
    frames = show.loop.statistics.frames
    show.loop.step()
    assert show.loop.ended == "quit"
    assert show.loop.statistics.frames == frames


def test_keys_switch_compensation_strategy_gain_freeze_and_black() -> None:
    show = stage(every(PERIOD_S, 10.0))
    show.run_until_s(0.5)
    assert show.codes[-1] == 2 * show.shown[-1].number
    for keys, factor in (("c", 1), ("c", 2), ("s", 1), ("s", 2), ("b", 0), ("b", 2)):
        show.pressed.extend(keys)
        show.run_until_s(show.clock.now_s() + 0.1)
        assert show.codes[-1] == factor * show.shown[-1].number % 256, keys
    show.pressed.append("+")
    show.run_until_s(show.clock.now_s() + 0.1)
    assert show.shown[-1].gain == pytest.approx(2 ** (1 / 8))


def test_a_frozen_picture_stays_although_the_source_goes_on() -> None:
    show = stage(every(PERIOD_S, 2.0))
    show.run_until_s(0.5)
    show.pressed.append("f")
    frozen = show.shown[-1].number
    show.run_until_s(1.0)
    assert show.shown[-1].number == frozen
    show.pressed.append("f")
    show.run_until_s(1.2)
    assert show.shown[-1].number > frozen + 25


def test_a_key_changes_the_picture_of_a_source_that_stands_still() -> None:
    show = stage([0.001, 5.0])
    show.run_until_s(0.5)
    assert show.display.picture.max() == 2
    show.pressed.append("b")
    show.run_until_s(0.6)
    assert show.display.picture.max() == 0
    assert show.loop.statistics.frames == 1


def test_the_key_n_asks_for_the_next_source_and_frames_begin_anew() -> None:
    show = stage(every(PERIOD_S, 1.0))
    show.run_until_s(0.3)
    show.pressed.append("n")
    show.run_until_s(0.4)
    assert len(show.switched) == 1
    assert show.compensators["exact"].resets == 1


def test_an_unplugged_display_is_waited_for_and_the_show_goes_on() -> None:
    show = stage(every(PERIOD_S, 4.0))
    show.run_until_s(1.0)
    show.display.is_plugged = False
    real_open = show.display.open

    def open_after_a_while() -> None:
        show.display.is_plugged = show.clock.now_s() > 2.0
        real_open()

    show.display.open = open_after_a_while  # type: ignore[method-assign]
    show.run()
    assert show.loop.statistics.unplugged == 1
    assert [note.split(":")[0] for note in show.notes] == ["unplugged", "replugged"]
    assert show.shown[-1].number > 200
    assert show.shown[-1].on_screen_s > 3.9


def test_a_display_that_stays_away_ends_the_show_with_its_loss() -> None:
    show = stage(every(PERIOD_S, 100.0), replug_timeout_s=3.0)
    show.run_until_s(1.0)
    show.display.is_plugged = False
    with pytest.raises(DeviceLost, match="did not come back within 3 s"):
        show.run()


def test_an_unplugged_display_is_noticed_while_the_source_stands_still() -> None:
    show = stage([0.001, 60.0], replug_timeout_s=3.0)
    show.run_until_s(1.0)
    show.display.is_plugged = False
    with pytest.raises(DeviceLost):
        show.run_until_s(30.0)
    assert show.clock.now_s() < 10.0


def test_a_display_that_misses_its_refreshes_makes_late_frames() -> None:
    show = stage(every(PERIOD_S, 1.0))
    real_show = show.display.show

    def slow_show(codes: Codes, *, name: str) -> Shown:
        show.clock.wait_until_s(show.clock.now_s() + 1.5 * PERIOD_S)
        return real_show(codes, name=name)

    show.display.show = slow_show  # type: ignore[method-assign]
    show.run()
    assert show.loop.statistics.late > 10
    assert show.loop.statistics.figures().on_time_share < 0.7


def test_automatic_gain_darkens_a_picture_that_clips_and_the_users_gain_is_its_limit() -> None:
    bright = stage(
        every(PERIOD_S, 6.0), numbers=[99] * 360, controls=Controls(strategy="exact", auto_gain=True, gain=4.0)
    )
    bright.run()
    gains = bright.compensators["exact"].gains
    assert max(gains) == 4.0
    assert gains[-1] < 1.4
    assert max(np.abs(np.diff(gains[60:]))) < 0.05


def test_without_automatic_gain_the_gain_never_moves() -> None:
    show = stage(every(PERIOD_S, 1.0), numbers=[99] * 60, controls=Controls(strategy="exact", gain=4.0))
    show.run()
    assert set(show.compensators["exact"].gains) == {4.0}


def test_without_any_strategy_pictures_are_shown_as_they_are() -> None:
    show = stage(every(PERIOD_S, 0.2), controls=Controls(strategy="exact", compensating=False))
    show.run()
    assert show.codes == [frame.number for frame in show.shown]
    assert show.loop.statistics.figures().error_mean is None


def test_the_expected_error_is_told_in_grey_levels() -> None:
    show = stage(every(PERIOD_S, 0.2))
    show.run()
    assert show.loop.statistics.figures().error_mean == pytest.approx(25.5)


def test_a_compensator_is_handed_one_of_two_pieces_of_memory_for_every_frame() -> None:
    show = stage(every(PERIOD_S, 0.5))
    show.run()
    assert len({id(frame.codes) for frame in show.shown}) == 2


def test_a_refresh_that_was_let_pass_is_not_aimed_at_again() -> None:
    display = DisplayClock(0.1)
    display.note(1.0)
    assert display.target_s(1.05) == pytest.approx(1.1)
    display.let_pass(1.1)
    assert display.target_s(1.05) == pytest.approx(1.2)
    display.note(1.2)
    assert display.target_s(1.2) == pytest.approx(1.3)


def test_work_begins_earlier_after_pictures_that_took_long_or_came_late() -> None:
    latch_timer = LatchTimer(0.1)
    idle_s = latch_timer.lead_s
    latch_timer.note(0.04, is_late=False)
    busy_s = latch_timer.lead_s
    latch_timer.note(0.04, is_late=True)
    assert idle_s < busy_s < latch_timer.lead_s < 0.1


def test_the_stand_in_counts_its_time() -> None:
    show = stage([0.0], busy_s=0.25)
    show.run()
    assert isinstance(show.compensators["exact"], Doubler)
    assert show.loop.statistics.figures().compute_ms.p50 == pytest.approx(250)
