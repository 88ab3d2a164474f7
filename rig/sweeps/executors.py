"""What points are given to: processes of this machine, a cluster, or an executor of the caller's."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass

from rig.errors import UsageError

AHEAD = 2
"""Points that each worker has at a time: one it computes, and one that it begins without waiting for this process."""


@dataclass(frozen=True, kw_only=True)
class OpenedExecutor:
    """An executor, ready to be given points."""

    executor: Executor
    ahead: int
    """Points that are given to it at a time: what is lost when this process is killed."""
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ExecutorChoice:
    """Where a sweep computes."""

    workers: int | None = None
    """Processes on this machine; None: one for each processor that this process may use."""
    scheduler: str | None = None
    """Address of a Dask scheduler; in place of processes."""
    executor: Executor | None = None
    """Any other executor; it is not shut down."""


@contextmanager
def opened(choice: ExecutorChoice, points: int) -> Iterator[OpenedExecutor]:
    """Open what a choice names, for so many points, and close what was opened.

    Raises
    ------
    UsageError
        It contradicts itself; the scheduler cannot be used.
    """
    given = [value for value in (choice.workers, choice.scheduler, choice.executor) if value is not None]
    if len(given) > 1:
        raise UsageError("workers, scheduler and executor exclude each other; give one")
    if choice.executor is not None:
        here = processors()
        yield OpenedExecutor(executor=choice.executor, ahead=AHEAD * here)
    elif choice.scheduler is not None:
        from rig.sweeps.cluster import opened_cluster  # here: Dask is an extra

        with opened_cluster(choice.scheduler) as cluster:
            yield cluster
    else:
        yield from _local(choice.workers, points)


def _local(wanted: int | None, points: int) -> Iterator[OpenedExecutor]:
    from rig.sweeps.local import LocalProcesses

    if wanted is not None and not 1 <= wanted <= _MOST_WORKERS:
        raise UsageError(f"{wanted} workers; give 1 ... {_MOST_WORKERS}")
    count = max(1, min(wanted or processors(), points))
    processes = LocalProcesses(count)
    try:
        yield OpenedExecutor(executor=processes, ahead=AHEAD * count)
    finally:
        processes.shutdown(wait=False, cancel_futures=True)


_MOST_WORKERS = 512
"""Each is a process with its own libraries in memory."""


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0))
