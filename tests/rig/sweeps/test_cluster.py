"""A Dask cluster on this machine: the same bits, and refused where it would not give them."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rig.errors import UsageError
from rig.sweeps import cluster
from rig.sweeps.executors import ExecutorChoice, opened
from rig.sweeps.folder import read_lines
from rig.sweeps.run import SweepRequest, run_sweep
from rig.sweeps.work import THREADS, WorkerVersions, versions_here

pytest.importorskip("distributed")
ONE_THREAD = dict.fromkeys(THREADS, "1")


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a scheduler with one worker."""
    folder = tmp_path_factory.mktemp("dask")
    address, log = None, folder / "log"
    started = [_start("dask_scheduler", ["--port", "0", "--no-dashboard"], folder, log)]
    while address is None:
        assert started[0].poll() is None, log.read_text()
        address = re.search(r"Scheduler at:\s+(tcp://\S+)", log.read_text())
    where = f"tcp://127.0.0.1:{address[1].rpartition(':')[2]}"
    options = ["--nthreads", "1", "--no-dashboard", "--no-nanny"]
    started.append(_start("dask_worker", [where, *options], folder, folder / "worker-log"))
    while "Starting established connection" not in (folder / "worker-log").read_text():
        assert started[1].poll() is None, (folder / "worker-log").read_text()
    yield where
    for process in reversed(started):
        process.terminate()
        process.wait()


def _start(program: str, options: list[str], folder: Path, log: Path) -> subprocess.Popen:
    command = [sys.executable, "-m", f"distributed.cli.{program}", *options]
    with log.open("w") as output:
        environment = os.environ | ONE_THREAD
        return subprocess.Popen(command, stdout=output, stderr=output, cwd=folder, env=environment)


def test_a_cluster_gives_the_same_bits_as_processes_of_this_machine(scheduler, study, tmp_path):
    where = ExecutorChoice(scheduler=scheduler)
    result = run_sweep(SweepRequest(study=study, folder=tmp_path / "cluster", where=where))
    assert (result.computed_now, result.warnings) == (4, ())
    run_sweep(SweepRequest(study=study, folder=tmp_path / "points", where=ExecutorChoice(workers=1)))
    here = {line.id: line.figures for line in read_lines(tmp_path / "points")}
    assert {line.id: line.figures for line in read_lines(tmp_path / "cluster")} == here


def test_a_worker_of_another_version_is_named_before_a_point_is_begun(scheduler, monkeypatch):
    other = WorkerVersions(programs={**versions_here().programs, "numpy": "1.0"})
    monkeypatch.setattr(cluster, "versions_here", lambda: other)
    with pytest.raises(UsageError, match="numpy"), opened(ExecutorChoice(scheduler=scheduler), 4):
        pass


def test_a_scheduler_that_does_not_answer_is_named_before_a_point_is_begun(monkeypatch):
    monkeypatch.setattr(cluster, "_ANSWERS_WITHIN_S", 0.5)
    with (
        pytest.raises(UsageError, match=r"no Dask scheduler answers within 0\.5 s"),
        opened(ExecutorChoice(scheduler="tcp://127.0.0.1:9"), 4),
    ):
        pass


class OfAnotherVersion:
    """A client whose scheduler is older than it."""

    def get_versions(self):
        return {place: {"packages": {"distributed": f"2025.{k}"}} for k, place in enumerate(("scheduler", "client"))}


def test_a_scheduler_of_another_version_is_named_before_a_point_is_begun():
    with pytest.raises(UsageError, match=r"tcp://there runs distributed 2025\.0, here is 2025\.1; install the same"):
        cluster._check_scheduler(OfAnotherVersion(), "tcp://there")
