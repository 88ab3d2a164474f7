"""What a request comes to: its profile and target read once, and which steps are done, to do, and cost frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rig.errors import SessionError
from rig.profile.schema import Profile, load_runnable_profile
from rig.records import JsonObject, Record, json_of
from rig.run.request import SessionRequest
from rig.run.steps import AnyStep, Verb, frames_of, settings_of, steps_up_to
from rig.session import Session
from rig.stages.compensation import CompensationRequest, check_strategies
from rig.stages.target import load_target


@dataclass(frozen=True, kw_only=True)
class PlannedStep(Record):
    """A step, whether a run would skip it, and about how many frames it takes."""

    step: str
    done: bool
    frames: int


@dataclass(frozen=True, kw_only=True)
class SessionPlan:
    """A request whose files were read and found good; no device was touched."""

    folder: Path
    profile: Profile
    is_new: bool
    """There is no session yet."""
    showing: CompensationRequest | None
    """None when the plan ends before anything is shown."""
    steps: tuple[PlannedStep, ...]

    def as_json(self) -> JsonObject:
        """Return the plan as `rig run --dry-run --json` prints it.

        Returns
        -------
        dict
        """
        return {
            "session": str(self.folder),
            "profile": self.profile.name,
            "exists": not self.is_new,
            "steps": json_of(self.steps),
        }


def plan_session(request: SessionRequest, verb: Verb = "compare") -> SessionPlan:
    """Resolve a request, as far as a verb; opens no device, and only reads the session.

    Parameters
    ----------
    request
        What was asked for.
    verb
        The last one whose steps belong to the plan.

    Returns
    -------
    SessionPlan
        Profile and target, and which steps are done.

    Raises
    ------
    ProfileError, UsageError, SessionError
        What a run would raise before its first frame.
    """
    folder = Path(request.folder)
    named = None if request.profile is None else load_runnable_profile(request.profile)
    session = Session.read(folder, named) if Session.exists(folder) else None
    profile = named if session is None else session.profile
    if profile is None:
        raise SessionError(f"{folder}: there is no session here; name a profile, e.g. -p sim-room")
    showing = _showing(request, profile) if verb in ("compensate", "compare") else None
    definitions = steps_up_to(verb)
    done = set() if session is None else _done_steps(definitions, session, showing)
    n_strategies = 0 if showing is None else len(showing.strategies)
    steps = tuple(
        PlannedStep(step=each.name, done=each.name in done, frames=frames_of(each, profile, n_strategies))
        for each in definitions
    )
    return SessionPlan(folder=folder, profile=profile, is_new=session is None, showing=showing, steps=steps)


def _showing(request: SessionRequest, profile: Profile) -> CompensationRequest:
    strategies = check_strategies(request.strategies)
    target = load_target(request.target, profile.projector.shape, request.fit, channels=profile.camera.channels)
    return CompensationRequest(target, strategies)


def _done_steps(definitions: Sequence[AnyStep], session: Session, showing: CompensationRequest | None) -> set[str]:
    """Names of the steps that would have nothing left to do; what follows an unfinished one is not among them."""
    done: set[str] = set()
    for definition in definitions:
        if done.issuperset(definition.needs) and session.is_done(
            definition.name, settings=settings_of(definition, session, showing), needs=definition.needs
        ):
            done.add(definition.name)
    return done
