"""The steps of a session, in the order in which they are done: one table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, get_args

from rig.capture.rig import Rig
from rig.errors import UsageError
from rig.profile.schema import Profile
from rig.records import JsonObject
from rig.session import Session, Step
from rig.stages import comparison, compensation, correspondence, geometry, model, radiometry, separation
from rig.stages.light import exposure
from rig.stages.showing.dark import dark_settings
from rig.stages.target import CompensationRequest
from rig.stages.transport import learn
from rig.stages.transport.evidence import EVIDENCE, model_steps
from rig.terminal import OnStep

Verb = Literal["calibrate", "separate", "model", "compensate", "compare"]
"""The verbs of a session, in order; each includes those before it."""
VERBS: tuple[Verb, ...] = get_args(Verb)


@dataclass(frozen=True, kw_only=True)
class StepDefinition:
    """A step of every session."""

    name: str
    verb: Verb
    """To which it belongs."""
    needs: tuple[str, ...] = ()
    """Steps whose results it reads."""
    wanted: Callable[[Profile], bool] = lambda _: True
    """Whether a profile asks for it."""


@dataclass(frozen=True, kw_only=True)
class ShootingStep(StepDefinition):
    """A step that photographs, and may compute something from its frames."""

    settings: Callable[[Session], JsonObject]
    """What it depends on, beside the results of the steps that it needs."""
    shoot: Callable[[Rig, Session, Step, OnStep], None]
    frames: Callable[[Profile], int]
    frames_per_strategy: Callable[[Profile], int] = lambda _: 0
    extra_frames: Callable[[Session, int], int] = lambda _session, _strategies: 0
    """How many more a session takes, with so many strategies, whose steps `exposure` and `response` are done: they tell
    how noisy photographs are, and whether room light swells."""


@dataclass(frozen=True, kw_only=True)
class ComputingStep(StepDefinition):
    """A step that needs no device."""

    settings: Callable[[Session], JsonObject]
    compute: Callable[[Session, Step, OnStep], None]


@dataclass(frozen=True, kw_only=True)
class CompensatingStep(StepDefinition):
    """A step that computes what is to be shown."""

    settings: Callable[[CompensationRequest], JsonObject]
    compute: Callable[[Session, Step, CompensationRequest, OnStep], None]


AnyStep = ShootingStep | ComputingStep | CompensatingStep

STEPS: tuple[AnyStep, ...] = (
    ShootingStep(
        name="exposure",
        verb="calibrate",
        settings=exposure.exposure_settings,
        shoot=exposure.find_exposure,
        frames=exposure.exposure_frames,
    ),
    ShootingStep(
        name="response",
        verb="calibrate",
        needs=("exposure",),
        settings=radiometry.response_settings,
        shoot=radiometry.measure_responses,
        frames=radiometry.response_frames,
    ),
    ShootingStep(
        name="gray",
        verb="calibrate",
        needs=("exposure", "response"),
        settings=correspondence.gray_settings,
        shoot=correspondence.photograph_gray_code,
        frames=correspondence.gray_frames,
    ),
    ComputingStep(
        name="correspondence",
        verb="calibrate",
        needs=("gray", "response"),
        settings=correspondence.correspondence_settings,
        compute=correspondence.decode_gray_code,
    ),
    ComputingStep(
        name="geometry",
        verb="calibrate",
        needs=("correspondence",),
        settings=geometry.geometry_settings,
        compute=geometry.fit_geometry,
    ),
    ShootingStep(
        name="separation",
        verb="separate",
        needs=("response", "gray", "correspondence"),
        settings=separation.separation_settings,
        shoot=separation.separate_light,
        frames=separation.separation_frames,
        extra_frames=separation.extra_frames,
    ),
    ComputingStep(
        name="model",
        verb="model",
        needs=("geometry", "separation", "correspondence"),
        settings=model.model_settings,
        compute=model.build_model,
    ),
    ShootingStep(
        name="transport",
        verb="model",
        needs=("response", "model"),
        wanted=learn.learns_transport,
        settings=learn.transport_settings,
        shoot=learn.learn_transport,
        frames=learn.transport_frames,
    ),
    CompensatingStep(
        name="compensate",
        verb="compensate",
        needs=("response", "model", "transport"),
        settings=compensation.compensation_settings,
        compute=compensation.compute_compensation,
    ),
    ShootingStep(
        name="project",
        verb="compare",
        needs=("compensate",),
        settings=comparison.project_settings,
        shoot=comparison.project_and_photograph,
        frames=comparison.held_out_frames,
        frames_per_strategy=comparison.frames_per_picture,
        extra_frames=comparison.extra_frames,
    ),
    ComputingStep(
        name="compare",
        verb="compare",
        needs=("response", "model", "transport", "compensate", "project"),
        settings=comparison.comparison_settings,
        compute=comparison.compare_all,
    ),
)


def steps_of(verb: Verb, profile: Profile) -> tuple[AnyStep, ...]:
    """Return the steps that belong to a verb itself, of those that a profile asks for."""
    return tuple(step for step in _wanted_steps(profile) if step.verb == verb)


def steps_up_to(verb: Verb, profile: Profile) -> tuple[AnyStep, ...]:
    """Return the steps of a verb and of all verbs before it, of those that a profile asks for."""
    included = VERBS[: VERBS.index(verb) + 1]
    return tuple(step for step in _wanted_steps(profile) if step.verb in included)


def _wanted_steps(profile: Profile) -> tuple[AnyStep, ...]:
    names = {step.name for step in STEPS if step.wanted(profile)}
    return tuple(
        replace(step, needs=tuple(name for name in step.needs if name in names)) for step in STEPS if step.name in names
    )


def needs_of(definition: AnyStep, session: Session) -> tuple[str, ...]:
    """Return the steps whose results a step reads: with the model of pictures also what earlier ones have told."""
    reads_model = definition.verb in ("compensate", "compare") and "model" in definition.needs
    return (*definition.needs, *(name for name in model_steps(session) if reads_model and name == EVIDENCE))


def settings_of(definition: AnyStep, session: Session, showing: CompensationRequest | None) -> JsonObject:
    """Return what a step depends on, beside the results of the steps that it needs."""
    if isinstance(definition, CompensatingStep):
        return {**definition.settings(required(showing)), **dark_settings(session.profile)}
    return definition.settings(session)


def required(showing: CompensationRequest | None) -> CompensationRequest:
    """Return what is to be shown. Raises UsageError when nothing was named."""
    if showing is None:
        raise UsageError("compensation needs a target; name a picture and strategies")
    return showing


def frames_of(definition: AnyStep, profile: Profile, n_strategies: int, measured: Session | None = None) -> int:
    """Return about how many frames a step takes; `measured` is a session whose noise and room light are known."""
    if not isinstance(definition, ShootingStep):
        return 0
    extra = 0 if measured is None else definition.extra_frames(measured, n_strategies)
    return definition.frames(profile) + n_strategies * definition.frames_per_strategy(profile) + extra
