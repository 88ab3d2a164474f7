"""The verbs of the command line for scripts: each does what is missing of one stage of an open session.

Those that photograph take an open rig, the others none. Errors are those of :mod:`rig.errors`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rig.capture.rig import Rig
from rig.capture.rig import open_rig as open_described
from rig.errors import SessionError
from rig.profile.schema import Profile, load_profile, refuse_what_comes_later
from rig.run.request import DEFAULT_STRATEGIES
from rig.run.session import OpenSession
from rig.run.steps import Verb
from rig.session import Session
from rig.stages.error_tree import one_error_tree
from rig.stages.results import SessionResult
from rig.stages.target import CompensationRequest, check_strategies, last_target, requested_compensation
from rig.terminal import OnStep, silent


def open_rig(profile: Profile | str | Path, *, resume_at_s: float = 0.0) -> Rig:
    """Open the devices that a profile describes.

    Parameters
    ----------
    profile
        A profile, its file, or the bare name of one in ``hw_profiles``.
    resume_at_s
        Where virtual clocks start: ``session.last_clock_s`` when a session goes on.

    Returns
    -------
    Rig
        Open, each camera's exposure at its ``exposure_s``; use it in a ``with`` statement, or close it.

    Raises
    ------
    ProfileError
        The profile cannot be used.
    DeviceError
        A device does not open.
    """
    described = profile if isinstance(profile, Profile) else load_profile(profile)
    refuse_what_comes_later(described)
    return open_described(described, resume_at_s=resume_at_s)


def calibrate(rig: Rig, session: Session, on_step: OnStep = silent) -> None:
    """Find exposure, response curves, correspondence, lenses, poses and walls.

    Parameters
    ----------
    rig
        Open.
    session
        Open; what it has already is kept.
    on_step
        Told how far it is: what is being done, how many parts are done, of how many.

    Raises
    ------
    CalibrationFailed
        The captures do not determine what is sought.
    DeviceError, SessionError
        A device gave no good frame; the disk refuses.
    """
    _do(OpenSession(session, lambda: rig, rig=rig), "calibrate", on_step)


def separate(rig: Rig, session: Session, on_step: OnStep = silent) -> None:
    """Tell direct from global light by shifted checkers. Needs :func:`calibrate`.

    Parameters
    ----------
    rig, session, on_step
        As for :func:`calibrate`.

    Raises
    ------
    SessionError
        The session is not calibrated.
    """
    _do(OpenSession(session, lambda: rig, rig=rig), "separate", on_step)


def model(session: Session, on_step: OnStep = silent) -> None:
    """Model the scene in patches: reflectance, vignetting, brightness scale. Needs :func:`separate`; no device.

    Parameters
    ----------
    session, on_step
        As for :func:`calibrate`.

    Raises
    ------
    CalibrationFailed
        The light does not determine the scene.
    SessionError
        The session's light is not separated.
    """
    _do(OpenSession(session, _no_rig), "model", on_step)


def compensate(
    session: Session,
    target: str | Path | None = None,
    strategies: Sequence[str] = DEFAULT_STRATEGIES,
    on_step: OnStep = silent,
    *,
    fit: bool = False,
    linear: bool = False,
) -> None:
    """Compute each strategy's projector image for a target and predict its camera image. Needs :func:`model`.

    Parameters
    ----------
    session, on_step
        As for :func:`calibrate`.
    target
        A picture of the projector's size, in sRGB (EXR: in linear light); default: the session's last one, at first a
        photograph that ships with scikit-image.
    strategies
        Names, or ``all``; ``none`` is always among them.
    fit
        Scale and crop a picture of another size.
    linear
        The picture's codes are linear light.

    Raises
    ------
    UsageError
        The target cannot be used, or a strategy is not known.
    SessionError
        The session has no model.
    """
    profile = session.profile
    shown = last_target(session) if target is None else None
    if shown is not None:
        showing = CompensationRequest(shown, check_strategies(tuple(strategies)))
    else:
        showing = requested_compensation(target, tuple(strategies), profile, fit=fit, is_linear=linear)
    _do(OpenSession(session, _no_rig, showing=showing), "compensate", on_step)


def compare(rig: Rig, session: Session, on_step: OnStep = silent) -> SessionResult:
    """Project and photograph every strategy, write metrics.json, and return it. Needs :func:`compensate`.

    Parameters
    ----------
    rig, session, on_step
        As for :func:`calibrate`.

    Returns
    -------
    SessionResult
        Errors of pictures in grey levels of 255.

    Raises
    ------
    SessionError
        Nothing was compensated yet.
    """
    work = OpenSession(session, lambda: rig, rig=rig)
    _do(work, "compare", on_step)
    result = work.result()
    session.write_metrics(result)
    return result


def write_report(session: Session, on_step: OnStep = silent) -> Path:
    """Write report.html of a compared session.

    Parameters
    ----------
    session, on_step
        As for :func:`calibrate`.

    Returns
    -------
    Path
        Of the page.

    Raises
    ------
    SessionError
        Nothing was compared yet.
    """
    from rig.report import page  # here, for what draws takes its time to load

    result = session.read_metrics(SessionResult)
    path = page.write_report(session, result, on_step)
    session.write_metrics(replace(result, report=path.name))
    return path


@one_error_tree()
def _do(work: OpenSession, verb: Verb, on_step: OnStep) -> None:
    work.do(verb, on_step)


def _no_rig() -> Rig:
    raise SessionError("this stage photographs nothing, so it has no rig")
