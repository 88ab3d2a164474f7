"""What a worker does: one point. Loads nothing heavy itself, so that a worker's threads are set before NumPy loads."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rig.errors import RigError

if TYPE_CHECKING:
    from rig.records import JsonObject
    from rig.sweeps.records import Evaluated

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "NUMEXPR_NUM_THREADS")
"""Each names how many threads a library uses; a worker has one, else they fight for the cores, and sums may differ."""


@dataclass(frozen=True, kw_only=True)
class PointTask:
    """One point, as it travels to a worker."""

    subject: str
    inputs: JsonObject
    base: str | None
    arrays: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class PointAnswer:
    """What comes back from a worker."""

    evaluated: Evaluated | None = None
    error: str = ""
    """Why the point has no answer."""
    seconds: float = 0.0
    """Of processor time."""


@dataclass(frozen=True, kw_only=True)
class WorkerVersions:
    """What has to be the same on all machines, so that they compute the same bits."""

    programs: Mapping[str, str] = field(default_factory=dict)
    threads: str = ""
    """Variables that do not say 1 here."""


def evaluate(task: PointTask) -> PointAnswer:
    """Ask a task's subject; what it refuses is an answer, too."""
    from rig.stages.error_tree import one_error_tree
    from rig.sweeps.records import Evaluated
    from rig.sweeps.subjects import subject_of

    started_s = time.process_time()
    try:
        with one_error_tree():
            found = subject_of(task.subject).evaluate(task.inputs, task.base)
    except (RigError, MemoryError) as error:
        return PointAnswer(error=str(error) or type(error).__name__, seconds=time.process_time() - started_s)
    kept = found if task.arrays else Evaluated(figures=found.figures)
    return PointAnswer(evaluated=kept, seconds=time.process_time() - started_s)


def versions_here() -> WorkerVersions:
    """Return the versions of what computes, on the machine that runs this."""
    import platform

    import numpy
    import scipy

    from rig.version import __version__

    programs = {
        "procam-rig": __version__,
        "python": ".".join(platform.python_version_tuple()[:2]),
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
    }
    threaded = [f"{name}={os.environ.get(name, 'unset')}" for name in THREADS[:3] if os.environ.get(name) != "1"]
    return WorkerVersions(programs=programs, threads=", ".join(threaded))
