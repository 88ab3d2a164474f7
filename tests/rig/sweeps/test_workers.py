"""Worker processes: one thread each, replaced when they die, and only the point that they were at is asked again."""

import multiprocessing
import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import wait
from pathlib import Path

import pytest

from rig.errors import SessionError, UsageError
from rig.sweeps.drive import drive
from rig.sweeps.executors import ExecutorChoice, opened
from rig.sweeps.folder import read_lines
from rig.sweeps.local import LocalProcesses, WorkerLost
from rig.sweeps.records import StudyPoint
from rig.sweeps.run import SweepRequest, run_sweep
from rig.sweeps.work import THREADS, PointTask

POINTS = [StudyPoint(id=str(k), inputs={"k": k}) for k in range(8)]


@pytest.fixture(scope="module")
def processes() -> Iterator[LocalProcesses]:
    executor = LocalProcesses(2)
    yield executor
    executor.shutdown()


def task_of(point: StudyPoint) -> PointTask:
    return PointTask(subject="paper", inputs=point.inputs, base=None, arrays=False)


def test_a_worker_has_one_thread_in_each_library_and_this_process_keeps_its_own(processes, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert [processes.submit(os.getenv, name).result() for name in THREADS] == ["1"] * len(THREADS)
    assert os.environ["OMP_NUM_THREADS"] == "7"


def test_a_worker_that_dies_costs_the_call_that_it_was_at_and_no_other(processes):
    killing = processes.submit(os._exit, 9)
    others = [processes.submit(pow, 2, k) for k in range(6)]
    assert isinstance(killing.exception(), WorkerLost)
    assert [other.result() for other in others] == [2**k for k in range(6)]


class Killing:
    """Gives cheap calls to processes, and kills one of the workers at every tenth."""

    def __init__(self, processes):
        self.processes, self.given = processes, 0

    def submit(self, fn, task):
        self.given += 1
        if self.given % 10 == 5:
            # A child killed before may be listed for a moment after it is gone: os.kill would find no such process.
            for child in multiprocessing.active_children()[-1:]:
                child.kill()
        return self.processes.submit(pow, 3, task.inputs["k"])


def test_workers_killed_by_signal_at_ten_moments_lose_no_point_and_repeat_none(processes):
    points = [StudyPoint(id=str(k), inputs={"k": k}) for k in range(95)]
    killing = Killing(processes)
    ends = list(drive(points, task_of, killing, ahead=4, tries=6))
    assert killing.given >= 95
    assert {end.point.id: end.answer for end in ends} == {str(k): 3**k for k in range(95)}
    assert len(ends) == 95


def test_a_call_that_fails_tells_how(processes):
    assert isinstance(processes.submit(divmod, 1, 0).exception(), ZeroDivisionError)


def test_a_call_that_is_taken_back_while_it_is_computed_says_nothing(processes, caplog):
    taken_back = processes.submit(sum, range(10_000_000))
    assert taken_back.cancel()
    assert processes.submit(pow, 2, 5).result() == 32
    assert [processes.submit(pow, 2, k).result() for k in range(4)] == [1, 2, 4, 8]  # both have ended what they had
    while any(worker.waiting() for worker in processes._workers):
        wait([processes.submit(pow, 1, 1)])
    assert caplog.text == ""


class Dying:
    """An executor whose workers die at some points, each time."""

    def __init__(self, here, bad):
        self.here, self.bad, self.given = here, bad, []

    def submit(self, fn, task):
        self.given.append(task.inputs["k"])
        if task.inputs["k"] in self.bad:
            return self.here.submit(self._die)
        return self.here.submit(pow, 1, 1)

    def _die(self):
        raise WorkerLost("its process died")


def test_a_point_that_kills_its_worker_is_tried_so_often_and_then_reported(here):
    executor = Dying(here, {2})
    ends = list(drive(POINTS, task_of, executor, ahead=2, tries=3))
    assert [(end.point.id, end.tries) for end in ends if end.answer is None] == [("2", 3)]
    assert executor.given.count(2) == 3
    assert sorted(end.point.id for end in ends) == [str(k) for k in range(8)]


def test_workers_that_all_die_end_the_sweep_with_the_cause(here):
    with pytest.raises(SessionError, match="8 workers died and no point was computed"):
        list(drive(POINTS, task_of, Dying(here, set(range(8))), ahead=2, tries=3))


def test_choices_that_exclude_each_other_are_refused(here):
    with pytest.raises(UsageError, match="exclude each other"), opened(ExecutorChoice(workers=2, executor=here), 1):
        pass
    with pytest.raises(UsageError, match="0 workers"), opened(ExecutorChoice(workers=0), 1):
        pass


SCRIPT = """
import sys, numpy
from pathlib import Path
from rig.sweeps.executors import ExecutorChoice
from rig.sweeps.run import SweepRequest, run_sweep
run_sweep(SweepRequest(study=Path(sys.argv[1]), folder=Path(sys.argv[2]), where=ExecutorChoice(workers=1)))
"""


def test_a_script_without_a_guard_that_is_killed_goes_on_where_it_was_with_the_same_bits(study, tmp_path):
    script = tmp_path / "sweeping.py"
    script.write_text(SCRIPT, encoding="utf-8")
    folder = tmp_path / "by processes"
    sweeping = subprocess.Popen([sys.executable, str(script), str(study), str(folder)])
    while not _lines(folder):
        assert sweeping.poll() is None
    sweeping.kill()
    sweeping.wait()
    first = _lines(folder)
    subprocess.run([sys.executable, str(script), str(study), str(folder)], check=True)
    run_sweep(SweepRequest(study=study, folder=tmp_path / "points", where=ExecutorChoice(workers=2)))
    here = {line.id: line.figures for line in read_lines(tmp_path / "points")}
    assert {line.id: line.figures for line in read_lines(folder)} == here
    assert len(list(read_lines(folder))) == 4
    assert (folder / "points.jsonl").read_bytes().startswith(first)


def _lines(folder: Path) -> bytes:
    path = folder / "points.jsonl"
    data = path.read_bytes() if path.exists() else b""
    return data[: data.rfind(b"\n") + 1]
