"""A study from its file to its page: what is not done yet is computed, the rest is read."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from rig.errors import ProfileError, UsageError
from rig.records import JsonObject
from rig.sweeps.columns import Columns, columns_of, spreads_of
from rig.sweeps.design import count_of, settings_of
from rig.sweeps.drive import PointEnd, drive
from rig.sweeps.executors import ExecutorChoice, opened
from rig.sweeps.folder import PAGE, TABLE, SweepFolder, is_complete, no_collections
from rig.sweeps.records import PointLine, StudyPoint, SweepResult, point_id
from rig.sweeps.study import MOST_POINTS, StudyTable, read_study
from rig.sweeps.subjects import Subject, subject_of
from rig.sweeps.tables import write_table
from rig.sweeps.work import PointTask
from rig.terminal import OnStep, silent
from rig.version import __version__

if TYPE_CHECKING:
    from pandas import DataFrame

_FAILURES = 20
"""Failed points that a result lists; all are in the table."""


@dataclass(frozen=True, kw_only=True)
class SweepRequest:
    """A study, and how it is to be computed."""

    study: Path
    folder: Path | None = None
    """Default: ``runs/`` and the study's name."""
    where: ExecutorChoice = field(default_factory=ExecutorChoice)
    tries: int | None = None
    """Of a point that kills its worker; None: as the study says."""
    retry: bool = False
    """Also points that were refused or killed before."""


@dataclass(frozen=True, kw_only=True)
class _Plan:
    """A study that was read: its points by name."""

    table: StudyTable
    text: bytes
    subject: Subject
    version: str
    base: str | None
    points: Mapping[str, StudyPoint]
    repeated: int


def run_sweep(request: SweepRequest, on_step: OnStep = silent) -> SweepResult:
    """Compute a study's points that are not done yet; write its table and its page.

    Parameters
    ----------
    request
        The study, and how it is to be computed.
    on_step
        Told how far it is: what is being done, how many points are done, of how many.

    Returns
    -------
    SweepResult

    Raises
    ------
    UsageError, ProfileError
        The study has mistakes, a line each; the scheduler cannot be used.
    SessionLocked, SessionError
        Another process works in the folder; the disk is full; workers are out of reach. Nothing that was computed is
        lost: run it again to go on.
    """
    return _swept(request, on_step)[0]


def sweep(
    study: str | Path,
    folder: str | Path | None = None,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    executor: Executor | None = None,
    on_step: OnStep = silent,
) -> DataFrame:
    """Compute a study's points that are not done yet, and return all of them as a table.

    Parameters
    ----------
    study
        File of the study.
    folder
        Where points are kept; default: ``runs/`` and the study's name.
    workers
        Processes on this machine; default: one a processor.
    scheduler
        Address of a Dask scheduler instead, such as ``tcp://head-node:8786``.
    executor
        Any other executor instead; it is not shut down.
    on_step
        Told how far it is.

    Returns
    -------
    pandas.DataFrame
        A row a point, by its name: inputs, figures, ``status`` and ``error``; ``attrs["result"]`` is the sweep's
        record as JSON.

    Raises
    ------
    RigError
        As :func:`rig.run_sweep`; UsageError when pandas is not installed.
    """
    try:
        import pandas
    except ImportError as error:
        raise UsageError("rig.sweep() returns a pandas data frame: pip install 'procam-rig[sweep]'") from error
    where = ExecutorChoice(workers=workers, scheduler=scheduler, executor=executor)
    request = SweepRequest(study=Path(study), folder=None if folder is None else Path(folder), where=where)
    result, columns = _swept(request, on_step)
    frame = pandas.DataFrame({name: list(values) for name, values in columns.values.items()}, index=columns.ids)
    frame.index.name = "point"
    frame.attrs["result"] = result.as_json()
    return frame


def _swept(request: SweepRequest, on_step: OnStep) -> tuple[SweepResult, Columns]:
    started_s = time.perf_counter()
    with no_collections():
        plan = _planned(request)
    with SweepFolder(request.folder or Path("runs") / request.study.stem) as folder:
        changed = folder.keep_study(plan.text)
        with no_collections():
            known = folder.lines()
        to_do = [point for name, point in plan.points.items() if _is_open(known.get(name), request.retry)]
        warnings = [*_about_the_study(plan, known, changed=changed)]
        if to_do:
            warnings += _compute(request, plan, to_do, folder, on_step=on_step)
            known = folder.lines()
        lines = [known[name] for name in plan.points if name in known]
        columns = columns_of(lines)
        result = _result(plan, lines, folder.path, computed_now=len(to_do))
        result = replace(
            result,
            others=len(known) - len(lines),
            warnings=tuple(warnings),
            spreads=spreads_of(columns, plan.table.page.figures),
        )
        result = _written(result, plan, columns, folder.path, is_new=bool(to_do) or changed, on_step=on_step)
    return replace(result, elapsed_s=time.perf_counter() - started_s), columns


def _planned(request: SweepRequest) -> _Plan:
    table = read_study(request.study)
    count = count_of(table)
    if count > MOST_POINTS:
        raise UsageError(f"{request.study}: has {count} points, the limit is {MOST_POINTS}; thin its grid out")
    subject = subject_of(table.subject)
    base = subject.base_of(table.base, request.study.parent)
    version = f"{subject.version}, procam-rig {__version__.partition('+')[0]}"
    points: dict[str, StudyPoint] = {}
    for settings in settings_of(table):
        inputs = _complete(subject, settings, base, request.study)
        name = point_id(table.subject, version, inputs)
        points[name] = StudyPoint(id=name, inputs=inputs)
    return _Plan(
        table=table,
        text=request.study.read_bytes(),
        subject=subject,
        version=version,
        base=base,
        points=points,
        repeated=count - len(points),
    )


def _complete(subject: Subject, settings: Mapping[str, object], base: str | None, study: Path) -> JsonObject:
    try:
        return subject.complete(settings, base)
    except ProfileError as error:
        raise ProfileError("\n".join(f"{study}: {line}" for line in str(error).splitlines())) from error


def _is_open(line: PointLine | None, retry: bool) -> bool:
    return line is None or (retry and line.status != "done")


def _about_the_study(plan: _Plan, known: Mapping[str, PointLine], *, changed: bool) -> Iterable[str]:
    """Say what a user would wonder about: points that are there twice, or that belong to another study."""
    if plan.repeated:
        yield f"{plan.repeated} points of the study are the same as others; each is computed once"
    versions = {line.version for name, line in known.items() if name not in plan.points}
    others = sum(name not in plan.points for name in known)
    if others and versions - {plan.version}:
        yield f"{others} points in the folder are of version {'; '.join(sorted(versions))}: they stay, and are not used"
    elif others:
        again = "the study was changed: " if changed else ""
        yield f"{again}{others} points in the folder are not of this study; they stay, and are not shown"


def _compute(
    request: SweepRequest, plan: _Plan, to_do: list[StudyPoint], folder: SweepFolder, *, on_step: OnStep
) -> tuple[str, ...]:
    total, done = len(plan.points), len(plan.points) - len(to_do)
    on_step("points", done, total)

    def task_of(point: StudyPoint) -> PointTask:
        return PointTask(subject=plan.table.subject, inputs=point.inputs, base=plan.base, arrays=plan.table.arrays)

    with opened(request.where, len(to_do)) as work:
        tries = request.tries or plan.table.tries
        for end in drive(to_do, task_of, work.executor, ahead=work.ahead, tries=tries):
            folder.add(_line(end, plan, folder))
            done += 1
            on_step("points", done, total)
        return work.warnings


def _line(end: PointEnd, plan: _Plan, folder: SweepFolder) -> PointLine:
    own = PointLine(
        id=end.point.id,
        subject=plan.table.subject,
        version=plan.version,
        inputs=end.point.inputs,
        status="killed",
        tries=end.tries,
        error=f"its worker died, {end.tries} times of {end.tries}",
    )
    if end.answer is None:
        return own
    found = end.answer.evaluated
    if found is None:
        return replace(own, status="refused", error=end.answer.error, seconds=end.answer.seconds)
    arrays = folder.add_arrays(end.point.id, found.arrays) if found.arrays else None
    return replace(own, status="done", error=None, figures=found.figures, arrays=arrays, seconds=end.answer.seconds)


def _result(plan: _Plan, lines: list[PointLine], folder: Path, *, computed_now: int) -> SweepResult:
    failed = (line for line in lines if line.status != "done")
    counts = {status: sum(line.status == status for line in lines) for status in ("done", "refused", "killed")}
    return SweepResult(
        title=plan.table.title or plan.table.subject,
        subject=plan.table.subject,
        version=plan.version,
        folder=str(folder),
        points=len(plan.points),
        computed_now=computed_now,
        computed_before=len(lines) - computed_now,
        refused=counts["refused"],
        killed=counts["killed"],
        left=len(plan.points) - len(lines),
        others=0,
        failures=tuple(islice(failed, _FAILURES)),
    )


def _written(
    result: SweepResult, plan: _Plan, columns: Columns, folder: Path, *, is_new: bool, on_step: OnStep
) -> SweepResult:
    """Write table and page where there is something new, and name them."""
    if is_new or not (is_complete(folder, PAGE) and is_complete(folder, TABLE)):
        from rig.sweeps.page import sweep_page  # here: a second start draws nothing

        on_step("table and page", 0, 2)
        write_table(folder / TABLE, columns)
        on_step("table and page", 1, 2)
        sweep_page(folder / PAGE, result, plan.table.page, columns)
        on_step("table and page", 2, 2)
    return replace(result, report=str(folder / PAGE), table=str(folder / TABLE))
