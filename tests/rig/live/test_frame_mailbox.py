"""Between the reader's thread and the loop: newest frame wins, nothing queues up; one source after the other."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from rig.devices.clock import SystemClock, VirtualClock
from rig.errors import DeviceLost
from rig.live.show.frame_mailbox import FrameMailbox, LiveFrame
from rig.live.sources.reader import Reader, locked_rate
from rig.live.sources.source import Picture, SourceBroken, SourceEnded

SHAPE = (4, 6)
PERIOD_S = 1 / 60


def mailbox_in_virtual_time() -> tuple[FrameMailbox, VirtualClock]:
    clock = VirtualClock(100.0)
    return FrameMailbox(SHAPE, PERIOD_S, clock), clock


def put(mailbox: FrameMailbox, code: int, media_s: float | None = None) -> None:
    mailbox.writable()[:] = code
    mailbox.offer(media_s)


def code_of(frame: LiveFrame | None) -> int | None:
    return None if frame is None else int(frame.codes[0, 0, 0])


def test_the_newest_frame_wins_and_the_others_are_counted() -> None:
    mailbox, clock = mailbox_in_virtual_time()
    for code in (1, 2, 3):
        put(mailbox, code)
    assert code_of(mailbox.take(clock.now_s(), 100.01)) == 3
    assert mailbox.dropped == 2
    assert mailbox.take(clock.now_s(), 100.01) is None


def test_a_taken_frame_is_not_written_over_by_those_that_come() -> None:
    mailbox, clock = mailbox_in_virtual_time()
    put(mailbox, 1)
    taken = mailbox.take(clock.now_s(), 100.01)
    for code in (2, 3, 4):
        put(mailbox, code)
    assert code_of(taken) == 1
    assert code_of(mailbox.take(clock.now_s(), 100.02)) == 4


def test_a_frame_that_is_being_filled_stays_what_it_is_while_another_is_taken() -> None:
    mailbox, clock = mailbox_in_virtual_time()
    put(mailbox, 1)
    mailbox.writable()[:] = 2
    assert code_of(mailbox.take(clock.now_s(), 100.01)) == 1
    mailbox.offer(None)
    assert code_of(mailbox.take(clock.now_s(), 100.02)) == 2


def test_numbers_rise_also_over_dropped_frames() -> None:
    mailbox, clock = mailbox_in_virtual_time()
    numbers = []
    for count in (1, 3, 2):
        for _ in range(count):
            put(mailbox, 0)
        frame = mailbox.take(clock.now_s(), 100.01)
        assert frame is not None
        numbers.append(frame.number)
    assert numbers == [1, 4, 6]


def test_the_first_frame_of_a_film_is_due_at_once_and_sets_its_clock() -> None:
    mailbox, clock = mailbox_in_virtual_time()
    put(mailbox, 1, 0.0)
    first = mailbox.take(clock.now_s(), 100.01)
    assert first is not None
    assert first.due_s == pytest.approx(100.01)
    put(mailbox, 2, 0.5)
    assert mailbox.take(clock.now_s(), 100.01 + PERIOD_S) is None
    assert code_of(mailbox.take(clock.now_s(), 100.51)) == 2


def test_a_frame_is_due_at_the_refresh_nearest_to_its_time() -> None:
    mailbox, clock = mailbox_in_virtual_time()
    put(mailbox, 1, 0.0)
    mailbox.take(clock.now_s(), 100.0)
    put(mailbox, 2, 1.0)
    assert mailbox.take(clock.now_s(), 101.0 - 0.6 * PERIOD_S) is None
    assert code_of(mailbox.take(clock.now_s(), 101.0 - 0.4 * PERIOD_S)) == 2


@contextmanager
def reading(work: Callable[[], None]) -> Iterator[None]:
    thread = threading.Thread(target=work)
    thread.start()
    yield
    thread.join(10.0)
    assert not thread.is_alive()


def test_a_film_in_the_displays_pace_loses_no_frame_although_the_reader_is_ahead() -> None:
    clock = SystemClock()
    mailbox = FrameMailbox(SHAPE, 0.01, clock)
    codes: list[int | None] = []

    def read() -> None:
        for k in range(30):
            put(mailbox, k, k * 0.01)
        mailbox.finish()

    with reading(read):
        target_s = clock.now_s() + 10.0  # on a display whose refreshes are far apart in real time
        while not mailbox.ended:
            frame = mailbox.take(clock.now_s() + 5.0, target_s)
            if frame is not None:
                codes.append(code_of(frame))
                target_s += 0.01
    assert codes == list(range(30))
    assert mailbox.dropped == 0


def test_a_loop_that_is_late_gets_the_frame_that_is_due_now() -> None:
    clock = SystemClock()
    mailbox = FrameMailbox(SHAPE, 0.01, clock)

    def read() -> None:
        for k in range(3):
            put(mailbox, k, k * 0.01)

    with reading(read):
        target_s = clock.now_s() + 10.0
        assert code_of(mailbox.take(clock.now_s() + 5.0, target_s)) == 0
        while code_of(mailbox.take(clock.now_s() + 5.0, target_s + 0.02)) != 2:
            pass


def test_closing_frees_a_reader_that_waits_for_its_turn() -> None:
    mailbox, _ = mailbox_in_virtual_time()

    def read() -> None:
        for k in range(5):
            put(mailbox, k, float(k))

    with reading(read):
        mailbox.close()


class Pictures:
    """A source of single-coloured pictures that ends, breaks or goes on for ever."""

    def __init__(self, name: str, codes: list[int], end: Exception | None = None, *, opens: bool = True):
        self.name = name
        self.frame_rate_hz = 100.0
        self.opened = 0
        self.closed = 0
        self._codes, self._opens = codes, opens
        self._end = end or SourceEnded()
        self._left: list[int] = []

    def open(self) -> None:
        self.opened += 1
        if not self._opens:
            raise SourceBroken(f"{self.name} does not open")
        self._left = list(self._codes)

    def read(self, timeout_s: float) -> Picture | None:
        if not self._left:
            raise self._end
        return Picture(np.full((*SHAPE, 3), self._left.pop(0), np.uint8))

    def close(self) -> None:
        self.closed += 1


def play(
    *sources: Pictures, endless: bool = False, frames: int = 1000, press_after: int = -1
) -> tuple[list[int], Reader]:
    clock = SystemClock()
    mailbox = FrameMailbox(SHAPE, 0.01, clock)
    reader = Reader(sources, mailbox, shape=SHAPE, refresh_rate_hz=100.0, clock=clock, endless=endless)
    reader.start()
    codes: list[int] = []
    target_s = clock.now_s()
    while not mailbox.ended and len(codes) < frames:
        frame = mailbox.take(clock.now_s() + 0.05, target_s)
        target_s = max(target_s + 0.01, clock.now_s())
        if frame is not None:
            codes.append(int(frame.codes[0, 0, 0]))
        if len(codes) == press_after:
            reader.next_source()
            press_after = -1
    reader.close()
    return codes, reader


def test_sources_are_played_one_after_the_other_to_their_ends() -> None:
    first, second = Pictures("first", [1, 2, 3]), Pictures("second", [11, 12])
    codes, reader = play(first, second)
    assert codes[0] == 1
    assert codes[-1] == 12
    assert codes == sorted(codes)
    assert reader.notes == []
    assert (first.closed, second.closed) == (1, 1)


@pytest.mark.parametrize("error", [SourceBroken("the file is damaged"), DeviceLost("the camera is away")])
def test_a_source_that_breaks_is_told_and_the_next_one_is_played(error: Exception) -> None:
    codes, reader = play(Pictures("first", [1, 2], error), Pictures("second", [11]))
    assert codes[-1] == 11
    assert reader.notes == [str(error)]


def test_a_source_that_does_not_open_is_told_and_the_next_one_is_played() -> None:
    codes, reader = play(Pictures("first", [1], opens=False), Pictures("second", [11]))
    assert codes == [11]
    assert reader.notes == ["first does not open"]


def test_an_endless_show_begins_again_without_the_source_that_gave_nothing() -> None:
    broken, good = Pictures("broken", [1], opens=False), Pictures("good", [11, 12])
    codes, _ = play(broken, good, endless=True, frames=5)
    assert broken.opened == 1
    assert good.opened >= 2
    assert set(codes) == {11, 12}


def test_the_next_source_comes_when_asked_for_and_the_first_one_again_after_it() -> None:
    codes, _ = play(Pictures("first", [1] * 500), Pictures("second", [11]), frames=9, press_after=3)
    assert codes[:3] == [1, 1, 1]
    assert 11 in codes
    assert codes[-1] == 1


@pytest.mark.parametrize(
    ("rate_hz", "played_hz"), [(59.94, 60.0), (29.97, 30.0), (24.0, 24.0), (60.0, 60.0), (100.0, 100.0)]
)
def test_a_film_whose_pace_is_nearly_the_displays_is_played_in_it(rate_hz: float, played_hz: float) -> None:
    assert locked_rate(rate_hz, 60.0) == pytest.approx(played_hz)
