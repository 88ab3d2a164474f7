"""A session from its plan to its result; every step resumable at every frame."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

from calibration.errors import CalibrationError
from rig.capture.rig import Rig, open_rig
from rig.errors import RigError, SessionError
from rig.files.atomic import check_output
from rig.run.plan import SessionPlan, plan_session
from rig.run.request import SessionRequest
from rig.run.results import partial_result, session_result
from rig.run.steps import (
    AnyStep,
    CompensatingStep,
    ComputingStep,
    ShootingStep,
    Verb,
    needs_of,
    required,
    settings_of,
    steps_of,
    steps_up_to,
)
from rig.session import Session
from rig.session.folder import typed
from rig.stages.error_tree import one_error_tree
from rig.stages.results import PartialResult, SessionResult, TruthErrors
from rig.stages.target import CompensationRequest
from rig.stages.transport.earlier import gather_evidence
from rig.terminal import OnStep, silent
from rig.truth.scores import score
from sim.errors import SimulationError


def run_session(request: SessionRequest, on_step: OnStep = silent) -> SessionResult:
    """Do everything that is not done yet: calibrate, separate, model, compensate, compare, report.

    Parameters
    ----------
    request
        The session, and what is to be shown in it.
    on_step
        Told how far it is: what is being done, how many parts are done, of how many.

    Returns
    -------
    SessionResult
        What metrics.json holds, where the report is, and how long it took.

    Raises
    ------
    RigError
        See :mod:`rig.errors`; report.html then shows where it stopped, and the error's notes name it. An interruption
        loses nothing that was captured: run it again to go on.
    """
    started_s = time.perf_counter()
    plan = plan_session(request)
    with opened_session(plan) as work:
        with _page_if_it_stops(work.session):
            work.do_up_to("compare", on_step)
        result = work.result()
        report = _write_report(work.session, result, on_step)
        work.session.write_metrics(replace(result, report=report.name))
    return replace(result, report=str(report), elapsed_s=time.perf_counter() - started_s)


def _write_report(session: Session, result: SessionResult, on_step: OnStep, output: Path | None = None) -> Path:
    from rig.report.page import write_report  # here, for what draws takes its time to load

    return write_report(session, result, on_step, output)


@contextmanager
def _page_if_it_stops(session: Session) -> Iterator[None]:
    """Leave a page that shows where a session stopped and why; the error goes on, with the page's place."""
    try:
        yield
    except (RigError, CalibrationError, SimulationError) as error:
        from rig.report.stopped import write_stopped_page  # as above

        page = write_stopped_page(session, [step.name for step in steps_up_to("compare", session.profile)], error)
        error.add_note(f"what was photographed by then, and how to go on: {page}")
        raise


def run_part(request: SessionRequest, verb: Verb, on_step: OnStep = silent) -> PartialResult:
    """Do the steps up to a verb before the comparison, and return what is measured by then.

    metrics.json stays that of the last comparison, if there was one.
    """
    started_s = time.perf_counter()
    plan = plan_session(request, verb)
    with opened_session(plan) as work:
        work.do_up_to(verb, on_step)
        result = partial_result(work.session, verb, None if verb in ("calibrate", "separate") else work.truth())
        if not work.session.is_finished("compare"):
            work.session.write_metrics(result)
    return replace(result, elapsed_s=time.perf_counter() - started_s)


def rewrite_report(folder: str | Path, output: Path | None = None) -> Path:
    """Write the report of a compared session again, and return its path.

    Parameters
    ----------
    folder
        Of the session.
    output
        Another file than the session's own: the session is only read, be it another process's or on a disk that cannot
        be written.

    Raises
    ------
    SessionError
        There is no such session, nothing was compared yet, or its folder cannot be written and no file is named.
    UsageError
        The file cannot stand where it was asked for.
    """
    if output is not None:
        check_output(output)
        session = Session.read(folder)
        return _write_report(session, session.read_metrics(SessionResult), silent, output)
    if Session.exists(folder) and not os.access(folder, os.W_OK):
        raise SessionError(
            f"{folder}: this folder cannot be written; name a file elsewhere: "
            f"rig report {typed(Path(folder))} -o report.html"
        )
    with Session.open(folder) as session:
        return _write_report(session, session.read_metrics(SessionResult), silent)


class OpenSession:
    """A session at work, and the rig that opens when a step first has to photograph.

    Parameters
    ----------
    session
        Open to write.
    open_rig
        Called at most once, when a rig is needed.
    rig
        If it is open already.
    showing
        What is to be shown, for the steps that compensate.
    """

    def __init__(
        self,
        session: Session,
        open_rig: Callable[[], Rig],
        *,
        rig: Rig | None = None,
        showing: CompensationRequest | None = None,
    ):
        self.session = session
        self.showing = showing
        self._open_rig = open_rig
        self._rig = rig

    def rig(self) -> Rig:
        """Return the rig, open. Raises DeviceError."""
        if self._rig is None:
            self._rig = self._open_rig()
        return self._rig

    def do_up_to(self, verb: Verb, on_step: OnStep) -> None:
        """Do what is missing of the steps of a verb and of all verbs before it."""
        for definition in steps_up_to(verb, self.session.profile):
            self._do(definition, on_step)

    def do(self, verb: Verb, on_step: OnStep) -> None:
        """Do what is missing of a verb's own steps. Raises SessionError when those before it are not done."""
        for definition in steps_of(verb, self.session.profile):
            self._do(definition, on_step)

    def _do(self, definition: AnyStep, on_step: OnStep) -> None:
        if isinstance(definition, CompensatingStep):
            gather_evidence(self.session, required(self.showing).target, on_step)
        settings = settings_of(definition, self.session, self.showing)
        step = self.session.step(definition.name, settings=settings, needs=needs_of(definition, self.session))
        if step.done:
            return
        if isinstance(definition, ShootingStep):
            definition.shoot(self.rig(), self.session, step, on_step)
        elif isinstance(definition, ComputingStep):
            definition.compute(self.session, step, on_step)
        else:
            definition.compute(self.session, step, required(self.showing), on_step)
        step.finish()

    def truth(self) -> TruthErrors | None:
        """Return the errors against the simulated world; None of a session whose truth nobody knows."""
        return score(self.session, self._rig)

    def result(self) -> SessionResult:
        """Return what was measured; every step has to be done."""
        return session_result(self.session, self.truth())


@contextmanager
def opened_session(plan: SessionPlan) -> Iterator[OpenSession]:
    """Open a planned session, made if it is new, and its rig when that is first needed.

    Raises what opening either raises; errors inside the block come out as those of :mod:`rig.errors`.
    """
    with ExitStack() as stack, one_error_tree():
        # Devices that do not open leave no new session behind.
        begun = stack.enter_context(open_rig(plan.profile, resume_at_s=0.0)) if plan.is_new else None
        session = stack.enter_context(Session.open(plan.folder, plan.profile))

        def opened() -> Rig:
            return begun or stack.enter_context(open_rig(plan.profile, resume_at_s=session.last_clock_s))

        yield OpenSession(session, opened, showing=plan.showing)
