"""Who gets the processors first while pictures run: what the next refresh needs, before what can wait a little.

A frame of a show is a few milliseconds of work that has to be done now. Under the normal scheduler a thread that
decodes the next picture, or another program, may hold a processor for longer than that.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_LOWEST = 1
"""Of the real-time priorities: enough to come before all normal work, and behind what the system itself needs."""
_THREADS = Path("/proc/self/task")


@contextmanager
def realtime_priority() -> Iterator[bool]:
    """Let the threads that there are, and those that begin meanwhile, come before all normal work.

    Yields whether they do: systems that cannot, or users that may not (a limit of the system, rtprio), go on as
    before. Threads that begin meanwhile and can wait call :func:`normal_priority`.
    """
    policy = getattr(os, "SCHED_RR", None)
    changed = [] if policy is None else [thread for thread in _threads() if _change(thread, policy, _LOWEST)]
    try:
        yield bool(changed)
    finally:
        for thread in changed:
            _change(thread, os.SCHED_OTHER, 0)


def normal_priority() -> None:
    """Take this thread's place among all others."""
    if hasattr(os, "SCHED_OTHER"):
        _change(0, os.SCHED_OTHER, 0)


def _threads() -> list[int]:
    """Threads of the process, as the system numbers them; only the caller where it does not tell."""
    return [int(entry.name) for entry in _THREADS.iterdir()] if _THREADS.is_dir() else [0]


def _change(thread: int, policy: int, priority: int) -> bool:
    try:
        os.sched_setscheduler(thread, policy, os.sched_param(priority))
    except OSError:  # not allowed, or a thread that has ended
        return False
    return True
