"""A look at a rig that moved becomes a session of where it stands now: what depends on places is measured anew."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rig.recheck.records import LightResult, Realigned
from rig.recheck.verdicts import MOST_GAIN, MOST_ROOM
from rig.run.session import OpenSession
from rig.session import Session
from rig.session.alignment import next_recheck
from rig.stages.comparison import load_comparison
from rig.stages.compensation import load_compensation
from rig.stages.target import CompensationRequest, last_target, requested_compensation
from rig.terminal import OnStep


def realigned_session(
    look: OpenSession, before: Session, folder: Path, *, light: LightResult, on_step: OnStep
) -> Realigned:
    """Do what a look lacks to be a session: the rest of the code, geometry, separated light, model.

    Where the session was compared, its picture is computed, shown and photographed again. Where lamp or room light
    drifted beyond their limits, exposure and response are measured anew, in a session beside the look.

    Parameters
    ----------
    look
        With its rig; its code is photographed.
    before
        The session that it follows.
    folder
        Of the session in which later looks lie.
    light
        That was found.
    on_step
        Told how far it is.

    Returns
    -------
    Realigned
    """
    if abs(light.lamp_gain - 1) <= MOST_GAIN and abs(light.room_light) <= MOST_ROOM:
        return _followed(look, before, on_step)
    with Session.open(next_recheck(folder), look.session.profile, seed=before.seed) as session:
        return _followed(OpenSession(session, look.rig, rig=look.rig()), before, on_step)


def _followed(work: OpenSession, before: Session, on_step: OnStep) -> Realigned:
    work.do_up_to("model", on_step)
    found = Realigned(folder=str(work.session.path))
    if not before.is_finished("compare"):
        return found
    best = load_compensation(before).best
    showed = OpenSession(work.session, work.rig, rig=work.rig(), showing=_same_picture(before, best))
    showed.do_up_to("compare", on_step)
    work.session.write_metrics(showed.result())
    errors = [load_comparison(session).strategies[best].measured.mean for session in (before, work.session)]
    return replace(found, strategy=best, error_before=errors[0], error_after=errors[1])


def _same_picture(before: Session, strategy: str) -> CompensationRequest:
    """The session's last target, compensated by one strategy and not at all."""
    strategies, shown = ("none",) if strategy == "none" else ("none", strategy), last_target(before)
    if shown is not None:
        return CompensationRequest(shown, strategies)
    profile = before.profile
    return requested_compensation(None, strategies, profile, fit=False)
