"""A Dask cluster as an executor: reached in time, the same versions everywhere, one thread a worker."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from rig.errors import UsageError
from rig.sweeps import work
from rig.sweeps.executors import AHEAD, OpenedExecutor
from rig.sweeps.work import WorkerVersions, versions_here

_ANSWERS_WITHIN_S = 10.0
"""A scheduler on a network; one that needs longer is overloaded or another program."""


@contextmanager
def opened_cluster(address: str) -> Iterator[OpenedExecutor]:
    """Reach a scheduler, and let go of it.

    Parameters
    ----------
    address
        Such as ``tcp://head-node:8786``.

    Raises
    ------
    UsageError
        Dask is not installed; nothing answers; there is no worker; a machine has other versions.
    """
    client = _client(address)
    try:
        threads, warnings = _checked(client, address)
        executor: Executor = client.get_executor(pure=False)
        yield OpenedExecutor(executor=executor, ahead=AHEAD * threads, warnings=warnings)
    finally:
        client.close(timeout=2)


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise UsageError("--scheduler needs Dask: pip install 'procam-rig[cluster]'") from error
    try:
        reach: Callable[..., Any] = Client
        return reach(address, timeout=_ANSWERS_WITHIN_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError, TypeError, RuntimeError) as error:
        raise UsageError(
            f"scheduler {address}: no Dask scheduler answers within {_ANSWERS_WITHIN_S:g} s "
            f"({type(error).__name__}); start one (dask scheduler), or correct the address. No point was begun"
        ) from error


def _checked(client: Any, address: str) -> tuple[int, tuple[str, ...]]:
    """Return how many threads the workers have together, and what may make their bits differ."""
    here = versions_here()
    _check_scheduler(client, address)
    threads: dict[str, int] = dict(client.nthreads())
    if not threads:
        raise UsageError(f"scheduler {address} has no worker; start one: dask worker {address} --nthreads 1")
    try:
        found: dict[str, WorkerVersions] = client.run(work.versions_here)
    except (ImportError, AttributeError) as error:
        raise UsageError(
            f"scheduler {address}: a worker cannot load procam-rig ({error}); install procam-rig "
            f"{here.programs['procam-rig']} in its environment"
        ) from error
    for worker, versions in found.items():
        _check_versions(worker, versions, here)
    return sum(threads.values()), tuple(_thread_warnings(found, threads))


def _check_scheduler(client: Any, address: str) -> None:
    found = client.get_versions()
    there, here = (found[place]["packages"]["distributed"] for place in ("scheduler", "client"))
    if there != here:
        raise UsageError(
            f"scheduler {address} runs distributed {there}, here is {here}; install the same "
            "version on all machines. No point was begun"
        )


def _check_versions(worker: str, versions: WorkerVersions, here: WorkerVersions) -> None:
    for name, version in here.programs.items():
        other = versions.programs.get(name, "none")
        if other != version:
            raise UsageError(
                f"worker {worker} has {name} {other}, here is {version}: results would not be the same bits; install "
                "the same versions on all machines. No point was begun"
            )


def _thread_warnings(found: dict[str, WorkerVersions], threads: dict[str, int]) -> Iterator[str]:
    for worker, versions in found.items():
        if versions.threads:
            yield f"worker {worker}: {versions.threads}: with more than one thread, last digits may differ"
        if threads.get(worker, 1) > 1:
            yield f"worker {worker} computes {threads[worker]} points at once in one process; --nthreads 1 is faster"
