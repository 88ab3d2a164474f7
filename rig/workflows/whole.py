"""The whole session: which step follows which, resumable at every frame."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibration.records import CalibrationError
from rig.errors import CalibrationFailed, SessionError
from rig.pair import Rig, open_rig
from rig.profile import Profile, load_profile
from rig.report.page import write_report
from rig.session import Session
from rig.terminal import OnStep
from rig.workflows.calibrate import decode_gray_code, fit_geometry, photograph_gray_code
from rig.workflows.compare import compare_all, project_and_photograph
from rig.workflows.compensate import check_strategies, compute_compensation
from rig.workflows.metrics import collect_metrics
from rig.workflows.model import build_model
from rig.workflows.photometric import find_exposure, measure_responses
from rig.workflows.separate import separate_light
from rig.workflows.target import Target, load_target
from sim.errors import SimulationError

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
    strategies: tuple[str, ...] = ("none", "direct", "paper", "exact", "bounded")
    fit: bool = False


def plan_session(request: Request) -> dict[str, Any]:
    """What a run would do, without opening a device or touching the session."""
    profile = _profile_of(request)
    load_target(request.target, profile.projector.shape, request.fit)
    strategies = check_strategies(request.strategies)
    exists = (request.folder / "session.json").exists()
    done = set()
    if exists:
        with Session.open(request.folder, profile) as session:
            done = {name for name in STEPS if session.is_finished(name)}
    frames = _frame_counts(profile, len(strategies))
    steps = [{"step": name, "done": name in done, "frames": frames.get(name, 0)} for name in STEPS]
    return {"session": str(request.folder), "profile": profile.name, "exists": exists, "steps": steps}


def _frame_counts(profile: Profile, n_strategies: int) -> dict[str, int]:
    patterns, exposures = profile.patterns, len(profile.patterns.exposures)
    bits = sum((n - 1).bit_length() for n in profile.projector.shape)
    return {
        "exposure": 3,
        "response": 4 * exposures + 24 + patterns.response_levels * exposures,
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
    profile = _profile_of(request)
    check_strategies(request.strategies)
    stages = STAGES[: STAGES.index(upto) + 1]
    needs_target = "compensate" in stages
    target = load_target(request.target, profile.projector.shape, request.fit) if needs_target else None
    with Session.open(request.folder, profile) as session:
        with open_rig(profile, resume_at_s=session.last_clock_s) as rig, _one_error_tree():
            for stage in stages:
                _STAGE_RUNS[stage](rig, session, target, request, on_step)
            metrics = collect_metrics(session, rig, upto)
        if upto == "compare":
            metrics["report"] = str(write_report(session, metrics, on_step))
        session.write_metrics(metrics)
    return {**metrics, "elapsed_s": time.perf_counter() - started_s}


def _profile_of(request: Request) -> Profile:
    copy = request.folder / "profile.toml"
    if request.profile is not None:
        return load_profile(request.profile)
    if not copy.exists():
        raise SessionError(f"{request.folder}: there is no session here; name a profile, e.g. -p sim-room")
    return load_profile(copy)


@contextmanager
def _one_error_tree() -> Iterator[None]:
    """`calibration` and `sim` do not know the rig's error tree: here, and only here, theirs become part of it."""
    try:
        yield
    except (CalibrationError, SimulationError) as error:
        raise CalibrationFailed(str(error)) from error


def _calibrate(rig: Rig, session: Session, target: Target | None, request: Request, on_step: OnStep) -> None:
    find_exposure(rig, session, on_step)
    measure_responses(rig, session, on_step)
    photograph_gray_code(rig, session, on_step)
    decode_gray_code(rig, session, on_step)
    fit_geometry(rig, session, on_step)


def _separate(rig: Rig, session: Session, target: Target | None, request: Request, on_step: OnStep) -> None:
    separate_light(rig, session, on_step)


def _model(rig: Rig, session: Session, target: Target | None, request: Request, on_step: OnStep) -> None:
    build_model(rig.profile, session, on_step)


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
        return write_report(session, session.read_metrics(), lambda label, done, total: None)
