"""What is asked of a live show, and all that is settled before its devices open: profile, model, strategies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rig.errors import UsageError
from rig.live.model import LiveModel, guessed_model, session_model
from rig.live.results import LightLatency
from rig.live.show.compensator import STRATEGIES, Compensator, warm_compensators
from rig.live.show.controls import Controls
from rig.profile.schema import Profile, load_profile
from rig.session import Session
from rig.session.alignment import aligned_folder
from rig.stages.error_tree import one_error_tree
from rig.terminal import OnStep, silent

_HIGHEST_GAIN = 4.0
"""As far as the keys go, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveRequest:
    """What the user asks for."""

    folder: Path | None = None
    """Session with a model."""
    profile: str | None = None
    """File or name; default: the session's."""
    sources: tuple[str, ...] = ("pattern",)
    """Words of :func:`rig.live.sources.choose.make_source`."""
    strategy: str = "bounded"
    """One of STRATEGIES, or none."""
    seconds: float | None = None
    size: tuple[int, int] | None = None
    """(height, width) of raw pictures without header. [px]"""
    rate_hz: float | None = None
    """Pictures a second of a folder or the test pattern."""
    endless: bool = False
    """Begin again after the last source."""
    keeps_going: bool = False
    """A source that fails is tried again, and black is shown meanwhile."""
    gain: float = 1.0
    """Times the target's brightness."""
    auto_gain: bool = False
    is_linear: bool = False
    """Codes are linear light, and not sRGB."""
    record: Path | None = None
    """New folder for what was shown and photographed."""
    flashes: bool = False
    """Measure the latency by light before the show."""
    threads: int = 2
    """Of the frame kernel."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LivePlan:
    """A show that may begin."""

    request: LiveRequest
    profile: Profile
    model_origin: str
    """Where the model comes from, in words."""
    notes: tuple[str, ...]
    compensators: Mapping[str, Compensator]
    """By strategy; empty without a model."""
    controls: Controls
    """What the show begins with."""
    light_latency_ms: LightLatency | None = None
    """Where it was measured: :func:`rig.live.latency.with_light_latency`."""


def plan_live(request: LiveRequest, on_step: OnStep = silent) -> LivePlan:
    """Settle what a show needs.

    Parameters
    ----------
    request
        What is asked for.
    on_step
        Told how far it is.

    Returns
    -------
    LivePlan

    Raises
    ------
    UsageError, ProfileError, SessionError
        It cannot begin.
    CalibrationFailed
        The session's model cannot be used for frames.
    """
    check_request(request)
    with one_error_tree():
        on_step("prepare frames", 0, 1)
        profile, model = _profile_and_model(request)
        _check_fit(profile, model)
        on_step("prepare frames", 1, 1)
        compensators = warm_compensators(model.frames, request.threads) if model else {}
        return LivePlan(
            request=request,
            profile=profile,
            model_origin=model.origin if model else "none",
            notes=model.notes if model else ("no session: pictures are shown as they are",),
            compensators=compensators,
            controls=_controls(request, is_possible=bool(compensators)),
        )


def check_request(request: LiveRequest) -> None:
    """Raise UsageError for what makes no sense before anything is opened."""
    if request.strategy not in (*STRATEGIES, "none"):
        raise UsageError(f"live strategy {request.strategy!r}; there are {', '.join(STRATEGIES)} and none")
    if request.seconds is not None and request.seconds <= 0:
        raise UsageError(f"--seconds {request.seconds:g}; give more than 0")
    if not 0 < request.gain <= _HIGHEST_GAIN:
        raise UsageError(f"--gain {request.gain:g}; it lies between 0 and {_HIGHEST_GAIN:g}")


def _profile_and_model(request: LiveRequest) -> tuple[Profile, LiveModel | None]:
    """The profile, and the session's model, or a guess where only a simulated room is at stake."""
    profile = load_profile(request.profile) if request.profile is not None else None
    if request.folder is not None:
        with Session.read(aligned_folder(request.folder)) as session:
            return profile or session.profile, session_model(session, is_linear=request.is_linear)
    if profile is None:
        raise UsageError("rig live needs a session, or a profile with -p: rig live -p sim-room --source pattern")
    is_simulated = profile.projector.driver == "simulated"
    return profile, guessed_model(profile, is_linear=request.is_linear) if is_simulated else None


def _check_fit(profile: Profile, model: LiveModel | None) -> None:
    if profile.projector.driver == "replay":
        raise UsageError(f"{profile.path}: a recording shows nothing live; give a real or simulated rig's profile")
    if model is not None and model.frames.shape != profile.projector.shape:
        raise UsageError(
            f"{profile.path}: the projector has {profile.projector.shape} px, the session's {model.frames.shape}; "
            "leave the profile out"
        )


def _controls(request: LiveRequest, *, is_possible: bool) -> Controls:
    return Controls(
        strategy=request.strategy if request.strategy in STRATEGIES else STRATEGIES[0],
        compensating=is_possible and request.strategy != "none",
        gain=request.gain,
        auto_gain=request.auto_gain,
    )
