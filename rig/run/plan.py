"""What a request comes to: its profile and target read once; and which steps are done, and what they cost."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

from rig.errors import SessionError
from rig.profile.schema import Profile, load_runnable_profile
from rig.records import JsonObject, Record, json_of
from rig.run.request import SessionRequest
from rig.run.steps import AnyStep, Verb, frames_of, needs_of, settings_of, steps_up_to
from rig.run.time_left import seconds_left
from rig.session import Session
from rig.session.folder import no_session_at, read_folder
from rig.stages.showing.dark import dark_settings
from rig.stages.target import CompensationRequest, check_strategies, last_target, requested_compensation
from rig.terminal.line import counted, in_words


@dataclass(frozen=True, kw_only=True)
class PlannedStep(Record):
    """A step, whether a run would skip it, and about how many frames it takes."""

    step: str
    done: bool
    frames: int


@dataclass(frozen=True, kw_only=True, eq=False)
class SessionPlan:
    """A request whose files were read and found good; no device was touched."""

    folder: Path
    verb: Verb
    """The last one whose steps belong to it."""
    profile: Profile
    is_new: bool
    """There is no session yet."""
    showing: CompensationRequest | None
    """None when the plan ends before anything is shown."""
    session: Session | None
    """As it is, to read; None of a new one."""

    @cached_property
    def steps(self) -> tuple[PlannedStep, ...]:
        """Which steps are done, and about how many frames each takes; looks at the session when it is first asked."""
        done = set() if self.session is None else self._done(self.session)
        n_strategies = 0 if self.showing is None else len(self.showing.strategies)
        measured = self.session if {"exposure", "response"} <= done else None
        count = partial(frames_of, profile=self.profile, n_strategies=n_strategies, measured=measured)
        return tuple(
            PlannedStep(step=each.name, done=each.name in done, frames=count(each))
            for each in steps_up_to(self.verb, self.profile)
        )

    @cached_property
    def seconds_left(self) -> float:
        """About how long the steps that are to do will take."""
        return seconds_left([(step.step, step.done, step.frames) for step in self.steps], self.profile, self.session)

    @property
    def title(self) -> str:
        """Where it is, with what, and how much is left."""
        to_do = [step for step in self.steps if not step.done]
        if not to_do:
            return f"{self.folder} with {self.profile.name}: all is done"
        frames = counted(sum(step.frames for step in to_do), "frame")
        return (
            f"{self.folder} with {self.profile.name}: {len(self.steps) - len(to_do)} of {len(self.steps)} steps done, "
            f"{frames} and {in_words(self.seconds_left)} to go"
        )

    def _done(self, session: Session) -> set[str]:
        """Names of the steps that would have nothing left to do; what follows an unfinished one is not among them."""
        done: set[str] = set()
        for definition in steps_up_to(self.verb, self.profile):
            if done.issuperset(definition.needs) and self._is_done(definition, session):
                done.add(definition.name)
        return done

    def _is_done(self, definition: AnyStep, session: Session) -> bool:
        settings = settings_of(definition, session, self.showing)
        return session.is_done(definition.name, settings=settings, needs=needs_of(definition, session))

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
            "seconds_left": self.seconds_left,
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
    is_new = not Session.exists(folder)
    profile = _profile(request, folder, is_new=is_new)
    session = None if is_new else Session.read(folder, profile)
    showing = _showing(request, profile, session) if verb in ("compensate", "compare") else None
    return SessionPlan(folder=folder, verb=verb, profile=profile, is_new=is_new, showing=showing, session=session)


def _profile(request: SessionRequest, folder: Path, *, is_new: bool) -> Profile:
    """The profile that was named, else that of the session; opening the session refuses another than its own."""
    none_there = no_session_at(folder) if is_new else ""
    if request.profile is not None:
        return load_runnable_profile(request.profile)
    if is_new:
        raise SessionError(f"{none_there}; name a profile to make one, e.g. -p sim-room")
    _, own = read_folder(folder, None)
    return own


def _showing(request: SessionRequest, profile: Profile, session: Session | None) -> CompensationRequest:
    """What was named; of a session that has shown something, its last target where none is named."""
    dark_settings(profile)  # a mask that is missing is said before anything is photographed
    is_named = request.target is not None or request.place is not None
    if not is_named and session is not None and (shown := last_target(session)) is not None:
        return CompensationRequest(shown, check_strategies(request.strategies))
    return requested_compensation(
        request.target, request.strategies, profile, fit=request.fit, is_linear=request.linear, place=request.place
    )
