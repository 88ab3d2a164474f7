"""The whole session: which step follows which, resumable at every frame."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from rig.capture.rig import Rig, open_rig
from rig.errors import SessionError
from rig.files.channels import PRIMARIES
from rig.files.journal import JOURNAL_NAME, Event, read_events
from rig.profile.schema import Profile, load_profile
from rig.report.page import write_report
from rig.run import script as verbs
from rig.run.results import collect_metrics
from rig.session import Session
from rig.stages.comparison import compare_all, project_and_photograph
from rig.stages.compensation import check_strategies, compute_compensation
from rig.stages.error_tree import one_error_tree
from rig.stages.target import Target, load_target
from rig.terminal import OnStep, silent

STAGES = ("calibrate", "separate", "model", "compensate", "compare")
"""The verbs of a session, in order; each includes those before it."""
STEPS = (
    "exposure",
    "response",
    "gray",
    "correspondence",
    "geometry",
    "separation",
    "model",
    "compensate",
    "project",
    "compare",
)
"""Steps in the order in which they are done."""


@dataclass(frozen=True, slots=True)
class Request:
    """What the user asked for."""

    folder: Path
    profile: str | None
    target: Path | None = None
    strategies: tuple[str, ...] = verbs.STRATEGIES
    fit: bool = False


def plan_session(request: Request) -> dict[str, Any]:
    """What a run would do; opens no device, and only reads the session.

    Raises what a run would raise before its first frame: ProfileError, UsageError, SessionError.
    """
    profile = _profile_of(request)
    target = load_target(request.target, profile.projector.shape, request.fit, profile.camera.channels)
    strategies = check_strategies(request.strategies)
    exists = (request.folder / "session.json").exists()
    done = _finished(request.folder, profile, target, strategies) if exists else set()
    frames = _frame_counts(profile, len(strategies))
    steps = [{"step": name, "done": name in done, "frames": frames.get(name, 0)} for name in STEPS]
    return {"session": str(request.folder), "profile": profile.name, "exists": exists, "steps": steps}


def _finished(folder: Path, profile: Profile, target: Target, strategies: tuple[str, ...]) -> set[str]:
    """Steps that a run would skip, from the journal alone; another process may be working on the session."""
    if (folder / "profile.toml").read_bytes() != profile.raw:
        raise SessionError(
            f"{folder}: was made with another profile than {profile.path}; leave the profile out, or give a new folder"
        )
    begun: dict[str, Event] = {}
    done: set[str] = set()
    for event in read_events(folder / JOURNAL_NAME):
        if event["event"] == "begin":
            begun[event["step"]] = event["settings"]
        if event["event"] == "finish":
            done.add(event["step"])
        elif "step" in event:
            done.discard(event["step"])
    wanted = {"target_sha256": target.sha256, "strategies": list(strategies)}
    computed = begun.get("compensate", {})
    if any(computed.get(key) != value for key, value in wanted.items()):
        done -= {"compensate", "project", "compare"}
    return done


def _frame_counts(profile: Profile, n_strategies: int) -> dict[str, int]:
    patterns, exposures = profile.patterns, len(profile.patterns.exposures)
    bits = sum((n - 1).bit_length() for n in profile.projector.shape)
    primaries = len(PRIMARIES[profile.camera.channels])
    return {
        "exposure": 3,
        "response": 4 * exposures + 24 + (patterns.response_levels + primaries) * exposures,
        "gray": 2 + 2 * bits,
        "separation": (4 + patterns.checker_shifts) * exposures,
        "project": (n_strategies + 2) * exposures * patterns.frames_averaged,
    }


def run_session(request: Request, on_step: OnStep) -> dict[str, Any]:
    """Do everything that is not done yet; returns what metrics.json holds.

    Raises RigError; an interruption loses nothing that was captured.
    """
    started_s = time.perf_counter()
    return _run(request, "compare", on_step, started_s)


def run_part(request: Request, upto: str, on_step: OnStep) -> dict[str, Any]:
    """Do the steps up to a verb."""
    return _run(request, upto, on_step, time.perf_counter())


def _run(request: Request, upto: str, on_step: OnStep, started_s: float) -> dict[str, Any]:
    check_strategies(request.strategies)
    stages = STAGES[: STAGES.index(upto) + 1]
    needs_target = "compensate" in stages
    target = target_of(request) if needs_target else None
    with opened_session(request) as (rig, session):
        for stage in stages:
            _STAGE_RUNS[stage](rig, session, target, request, on_step)
        metrics = collect_metrics(session, rig, upto)
        if upto != "compare":
            if not session.is_finished("compare"):  # else metrics.json stays that of the last comparison
                session.write_metrics(metrics)
            return {**metrics, "elapsed_s": time.perf_counter() - started_s}
        report = write_report(session, metrics, on_step)
        session.write_metrics({**metrics, "report": report.name})
    return {**metrics, "report": str(report), "elapsed_s": time.perf_counter() - started_s}


def target_of(request: Request) -> Target:
    """The picture that was asked for. Raises UsageError, ProfileError, SessionError."""
    profile = _profile_of(request)
    return load_target(request.target, profile.projector.shape, request.fit, profile.camera.channels)


@contextmanager
def opened_session(request: Request) -> Iterator[tuple[Rig, Session]]:
    """The session, made if it is new, and its rig, whose devices open when they are first needed.

    Raises what opening either raises; errors inside the block come out as those of :mod:`rig.errors`.
    """
    named = _profile_of(request)
    with ExitStack() as stack, one_error_tree():
        opening = _Opening(named, stack)
        if not (request.folder / "session.json").exists():
            opening.rig()  # devices that do not open leave no session behind
        session = stack.enter_context(Session.open(request.folder, named if request.profile else None))
        opening.profile = named if request.profile else session.profile
        opening.resume_at_s = session.last_clock_s
        yield cast("Rig", opening), session


class _Opening:
    """Stands for a rig: has its profile, and opens it when a step asks for more.

    A session whose steps are all done needs no device.
    """

    def __init__(self, profile: Profile, stack: ExitStack):
        self.profile = profile
        self.resume_at_s = 0.0
        self._stack = stack
        self._rig: Rig | None = None

    def rig(self) -> Rig:
        """Open once, until the stack unwinds."""
        if self._rig is None:
            self._rig = self._stack.enter_context(open_rig(self.profile, resume_at_s=self.resume_at_s))
        return self._rig

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rig(), name)


def _profile_of(request: Request) -> Profile:
    copy = request.folder / "profile.toml"
    if request.profile is not None:
        return load_profile(request.profile)
    if not copy.exists():
        raise SessionError(f"{request.folder}: there is no session here; name a profile, e.g. -p sim-room")
    return load_profile(copy)


def _calibrate(rig: Rig, session: Session, target: Target | None, request: Request, on_step: OnStep) -> None:
    verbs.calibrate(rig, session, on_step)


def _separate(rig: Rig, session: Session, target: Target | None, request: Request, on_step: OnStep) -> None:
    verbs.separate(rig, session, on_step)


def _model(rig: Rig, session: Session, target: Target | None, request: Request, on_step: OnStep) -> None:
    verbs.model(rig, session, on_step)


def _compensate(rig: Rig, session: Session, target: Target | None, request: Request, on_step: OnStep) -> None:
    if target is None:
        raise SessionError("compensation needs a target")
    compute_compensation(session, target, request.strategies, on_step)


def _compare(rig: Rig, session: Session, target: Target | None, request: Request, on_step: OnStep) -> None:
    project_and_photograph(rig, session, on_step)
    compare_all(session, on_step)


_STAGE_RUNS: Mapping[str, Callable[[Rig, Session, Target | None, Request, OnStep], None]] = {
    "calibrate": _calibrate,
    "separate": _separate,
    "model": _model,
    "compensate": _compensate,
    "compare": _compare,
}


def rewrite_report(folder: Path) -> Path:
    """Write the report of a compared session again."""
    with Session.open(folder) as session:
        return write_report(session, session.read_metrics(), silent)
