"""Seconds as the median of interleaved repeats in one process, and memory as what the process grew by."""

from __future__ import annotations

import ctypes
import gc
import statistics
import sys
import time
import tracemalloc
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

Work = Callable[[], Any]
_MB = 1e6
_SETTLE_S = 0.12
"""Each turn begins with calls that do not count until so much time has passed. [s]"""


def median_seconds(cases: Mapping[str, Work], budget_s: float = 2.0, repeats: int = 15) -> dict[str, float]:
    """Median seconds of each case: all take turns, so that a busy machine slows all of them alike.

    Parameters
    ----------
    cases : mapping of name to callable
        Each is called once before the clock starts (first calls compile, load and fault pages in).
    budget_s : float
        No further round begins once one has gone and this time is over. [s]
    repeats : int
        Largest number of rounds.
    """
    for work in cases.values():
        work()
    samples: dict[str, list[float]] = {name: [] for name in cases}
    end = time.perf_counter() + budget_s
    for done in range(repeats):
        if done and time.perf_counter() > end:
            break
        for name, work in cases.items():
            if not samples[name] or samples[name][-1] < _SETTLE_S:
                _settle(work)
            samples[name].append(seconds_of(work))
    return {name: statistics.median(taken) for name, taken in samples.items()}


def _settle(work: Work) -> None:
    """Call until the caches are this case's own, and the threads of the case before have gone to sleep."""
    end = time.perf_counter() + _SETTLE_S
    work()
    while time.perf_counter() < end:
        work()


def seconds_of(work: Work) -> float:
    """Seconds of one call."""
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def processor_seconds(work: Work, repeats: int = 5) -> float:
    """Least processor time of a call, of all threads together [s].

    What other programs take of a machine stretches seconds, not these; the least of some calls is that of warm caches.
    """
    taken = []
    for _ in range(repeats):
        started = time.process_time()
        work()
        taken.append(time.process_time() - started)
    return min(taken)


def peak_mb(work: Work) -> float:
    """Most memory that a call holds beyond what was held before [MB].

    The larger of what Python's allocators count and the growth of the resident set, where the system tells it
    (Linux): native code allocates past the first, freed memory that is used again escapes the second.
    """
    gc.collect()
    before = _resident_mb("VmRSS", reset=True)
    tracemalloc.start()
    try:
        result = work()
        counted = tracemalloc.get_traced_memory()[1] / _MB
    finally:
        tracemalloc.stop()
    grown = _resident_mb("VmHWM") - before
    del result
    return max(counted, grown)


def _resident_mb(field: str, reset: bool = False) -> float:
    """Resident memory now (VmRSS) or at its highest since the last reset (VmHWM); 0 where nothing tells [MB]."""
    if not sys.platform.startswith("linux"):
        return 0.0
    if reset:
        _give_back_and_reset()
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith(f"{field}:"):
            return int(line.split()[1]) * 1024 / _MB
    return 0.0


def _give_back_and_reset() -> None:
    """Return freed memory to the system, then let the high-water mark begin anew."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:  # a container may forbid it: the mark then only rises, and a peak is at worst too high
        return
