"""How many threads the native kernel works with."""

from __future__ import annotations

from sim import _kernel
from sim.errors import SimulationError


def threads() -> int:
    """Return how many threads the kernel's parallel loops use."""
    return _kernel.threads()


def set_threads(count: int) -> None:
    """Let the kernel's parallel loops use this many threads; results do not depend on it.

    Raises
    ------
    SimulationError
        If ``count`` is below 1.
    """
    if count < 1:
        raise SimulationError(f"{count} threads; give at least 1")
    _kernel.set_threads(count)
