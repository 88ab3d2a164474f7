"""Points to an executor and answers back: as many at work as it wants, and again those whose worker died."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from dataclasses import dataclass

from rig.errors import SessionError
from rig.sweeps.records import StudyPoint
from rig.sweeps.work import PointAnswer, PointTask, evaluate

_HOPELESS = 8
"""Workers that died, with no point computed: then it is not the points."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PointEnd:
    """How a point ended: with an answer, or with the death of each worker that it was given to."""

    point: StudyPoint
    tries: int
    answer: PointAnswer | None


class _Driver:
    """Points that wait, those at work, and how often each was tried."""

    def __init__(self, executor: Executor, points: Iterable[StudyPoint], task_of: Callable[[StudyPoint], PointTask]):
        self._executor, self._task_of = executor, task_of
        self.waiting = deque((point, 1) for point in points)
        self.working: dict[Future[PointAnswer], tuple[StudyPoint, int]] = {}
        self.deaths = 0

    def give(self) -> None:
        """Give the next point to the executor."""
        point, tried = self.waiting.popleft()
        try:
            future = self._executor.submit(evaluate, self._task_of(point))
        except (BrokenExecutor, RuntimeError) as error:
            raise SessionError(
                f"the executor takes no more points ({error or type(error).__name__}); those that are done are kept: "
                "run the same command again"
            ) from error
        self.working[future] = (point, tried)

    def ended(self, tries: int) -> Iterable[PointEnd]:
        """Wait for the next points, and yield those that ended; others are queued again."""
        done, _ = wait(self.working, return_when=FIRST_COMPLETED)
        for future in done:
            point, tried = self.working.pop(future)
            answer = _answer_of(future, point)
            self.deaths += answer is None
            if answer is None and tried < tries:
                self.waiting.append((point, tried + 1))
            else:
                yield PointEnd(point=point, tries=tried, answer=answer)

    def cancel(self) -> None:
        """Take back what has not begun."""
        for future in self.working:
            future.cancel()


def drive(
    points: Iterable[StudyPoint],
    task_of: Callable[[StudyPoint], PointTask],
    executor: Executor,
    *,
    ahead: int,
    tries: int,
) -> Iterable[PointEnd]:
    """Yield how each point ended, in the order in which they end.

    Parameters
    ----------
    points
        To be computed.
    task_of
        What is sent to a worker for a point.
    executor
        Any; one that is broken after a worker's death ends the sweep.
    ahead
        Points that it has at a time.
    tries
        How often a point is tried that kills its worker.

    Raises
    ------
    SessionError
        The executor takes no more points, or loses every one.
    """
    driver, computed = _Driver(executor, points, task_of), 0
    try:
        while driver.waiting or driver.working:
            while driver.waiting and len(driver.working) < ahead:
                driver.give()
            for end in driver.ended(tries):
                computed += end.answer is not None
                yield end
            if driver.deaths >= _HOPELESS and not computed and driver.waiting:
                raise SessionError(
                    f"{driver.deaths} workers died and no point was computed: workers end before they do anything. Is "
                    "there memory enough for them? Try --workers 1"
                )
    finally:
        driver.cancel()


def _answer_of(future: Future[PointAnswer], point: StudyPoint) -> PointAnswer | None:
    """Return a point's answer, None when its worker died; an error that nobody expected is an answer, named."""
    try:
        error = future.exception()
    except CancelledError as cancelled:
        raise SessionError(
            "the connection to the workers is lost; points that are done are kept: run the same command again"
        ) from cancelled
    if error is None:
        return future.result()
    if isinstance(error, BrokenExecutor) or _is_killed_by_dask(error):
        return None
    if isinstance(error, CancelledError):
        raise SessionError(
            "the connection to the workers is lost; points that are done are kept: run the same command again"
        ) from error
    return PointAnswer(error=f"{type(error).__name__}: {error} (point {point.id}); this is a fault of the program")


def _is_killed_by_dask(error: BaseException) -> bool:
    """Whether Dask gave a point up because its workers died; its class is not known where Dask is not installed."""
    return type(error).__name__ == "KilledWorker"
