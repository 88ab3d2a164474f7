"""Processes on this machine, each replaced when it dies: an executor that knows which point killed a worker."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from multiprocessing.connection import wait
from types import ModuleType
from typing import Any, ParamSpec, TypeVar

from rig.sweeps.work import THREADS

P = ParamSpec("P")
T = TypeVar("T")
_starting = threading.Lock()
"""Held while a worker is started: what it inherits is set for all of this process."""


class WorkerLost(BrokenExecutor):
    """The process that computed this died."""


@dataclass(frozen=True, eq=False)
class _Call:
    """A call, and where its result goes."""

    result: Future[Any]
    run: Callable[[], Any]


class LocalProcesses(Executor):
    """A number of worker processes: started fresh (never forked), with one thread each, and replaced when they die.

    Parameters
    ----------
    workers
        How many; at least 1.
    """

    def __init__(self, workers: int):
        self._workers = [_Worker() for _ in range(workers)]

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Give a call to the worker that has least to do; WorkerLost is the result when its process dies."""
        return min(self._workers, key=_Worker.waiting).submit(_Bound(fn, args, kwargs))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all workers; those at work end their point first."""
        for worker in self._workers:
            worker.shutdown(wait, cancel_futures)


@dataclass(frozen=True, eq=False)
class _Bound:
    """A function with its arguments, that can be pickled."""

    function: Callable[..., Any]
    positional: tuple[Any, ...]
    named: dict[str, object]

    def __call__(self) -> Any:
        return self.function(*self.positional, **self.named)


class _Worker:
    """One process, and the calls that it was given, in the order in which it does them."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._calls: deque[_Call] = deque()
        self._pool = _pool()
        self._started: ProcessPoolExecutor | None = None
        self._ended = False

    def waiting(self) -> int:
        """Return how many calls are not done."""
        return len(self._calls)

    def submit(self, run: Callable[[], T]) -> Future[T]:
        """Queue a call."""
        call = _Call(Future(), run)
        with self._lock:
            self._calls.append(call)
            self._give(call)
        return call.result

    def _give(self, call: _Call) -> None:
        pool = self._pool
        try:
            # Its process starts with its first call, and is the same from then on.
            with nullcontext() if pool is self._started else _fresh_start():
                inner = pool.submit(call.run)
            self._started = pool
        except BrokenExecutor:  # it died since its last answer; its calls learn of it here
            self._replace(pool)
            return
        inner.add_done_callback(lambda done: self._answered(call, done, pool))

    def _answered(self, call: _Call, done: Future[Any], pool: ProcessPoolExecutor) -> None:
        if done.cancelled():
            call.result.cancel()
            return
        error = done.exception()
        if isinstance(error, BrokenExecutor):
            self._replace(pool)
            return
        with self._lock:
            self._calls.remove(call)
        if not call.result.set_running_or_notify_cancel():
            return  # taken back while it was computed: Ctrl-C
        if error is None:
            call.result.set_result(done.result())
        else:
            call.result.set_exception(error)

    def _replace(self, pool: ProcessPoolExecutor) -> None:
        """Start a new process; the call that the old one was at is lost, those behind it are given to the new one."""
        with self._lock:
            if pool is not self._pool or self._ended:
                return
            pool.shutdown(wait=False)
            self._pool = _pool()
            lost = self._calls.popleft() if self._calls else None
            for call in tuple(self._calls):
                self._give(call)
        if lost is not None and lost.result.set_running_or_notify_cancel():
            lost.result.set_exception(WorkerLost("its process died"))

    def shutdown(self, wait_for_it: bool, cancel: bool) -> None:
        """End the process."""
        with self._lock:
            self._ended = True
            pool = self._pool
        pool.shutdown(wait=wait_for_it, cancel_futures=cancel)


def _pool() -> ProcessPoolExecutor:
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(1, mp_context=context, initializer=_begin)


@contextmanager
def _fresh_start() -> Iterator[None]:
    """Let a process that is started here have one thread in each library, and nothing of the script that calls.

    Its own NumPy loads after that. A new process would first import the script again, and so run one that has no
    ``if __name__ == "__main__":`` once more; it needs nothing of it.
    """
    with _starting:
        before = {name: os.environ.get(name) for name in THREADS}
        script = sys.modules["__main__"]
        os.environ.update(dict.fromkeys(THREADS, "1"))
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = script
            for name, value in before.items():
                os.environ.pop(name) if value is None else os.environ.update({name: value})


def _begin() -> None:
    """Leave Ctrl-C to the process that gives the points, and end when that one is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
