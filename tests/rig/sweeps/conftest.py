"""A small study of the paper's room, and an executor that computes where it is asked."""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path

import pytest

from rig.sweeps.executors import ExecutorChoice
from rig.sweeps.records import SweepResult
from rig.sweeps.run import SweepRequest, run_sweep

STUDY = """
schema = 1
title = "Two walls' paints"
subject = "paper"

[fixed]
width_px = 24
height_px = 18
strategies = ["paper"]

[grid]
reflectance = [0.3, 0.7]
photograph = ["outdoor", "grey"]
"""


class Here(Executor):
    """Computes a call when it is given; counts them."""

    def __init__(self) -> None:
        self.calls = 0

    def submit(self, fn, /, *args, **kwargs):
        self.calls += 1
        future = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - that is what executors do
            future.set_exception(error)
        return future


@pytest.fixture
def here() -> Here:
    return Here()


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "paints.toml"
    path.write_text(STUDY, encoding="utf-8")
    return path


@pytest.fixture
def swept(study: Path, tmp_path: Path) -> Callable[..., SweepResult]:
    """Sweeps the study as it is now, here, into one folder."""

    def run(executor: Executor | None = None, **further: object) -> SweepResult:
        where = ExecutorChoice(executor=executor or Here())
        return run_sweep(SweepRequest(study=study, folder=tmp_path / "points", where=where, **further))

    return run
