"""A re-check from its photographs to its verdict, and the session that follows a rig that moved."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from calibration.structured_light.orientation import without_mirrored
from rig.capture.rig import Rig, open_rig
from rig.errors import SessionError, UsageError
from rig.profile.schema import Profile, load_runnable_profile
from rig.recheck.compare import Compared, compare, refuse_darkness, refuse_flood
from rig.recheck.known import KnownRig, known_rig, light_of_flats
from rig.recheck.page import write_recheck_page
from rig.recheck.realign import realigned_session
from rig.recheck.records import RECORD, LightResult, MotionResult, Recheck, RecheckRequest
from rig.recheck.verdicts import limits_of, summary_of, with_realigned
from rig.run.session import OpenSession
from rig.session import Session, Step
from rig.session.alignment import aligned_folder, next_recheck
from rig.session.folder import changed_devices
from rig.stages.correspondence import gray_settings, photograph_code_once, photograph_flats, read_code_once
from rig.stages.error_tree import one_error_tree
from rig.stages.photograph import frame_name
from rig.terminal import OnStep, silent

_TAKEN_OVER = ("exposure", "response")
"""Steps that do not depend on where devices stand."""
_LEAST_WHITE = 0.2
"""Of white as it was: no lamp loses as much between two shows."""
_MOST_CLIPPED = 0.2
"""Of the camera's pixels, while the projector shows black."""
_SIMULATED = "simulation"


def run_recheck(request: RecheckRequest, on_step: OnStep = silent) -> Recheck:
    """Photograph the code once more and say what moved and what drifted since the session was made.

    Parameters
    ----------
    request
        Which session, and whether it is to follow.
    on_step
        Told how far it is.

    Returns
    -------
    Recheck
        With the page's place; the photographs are a session of their own inside of the session's folder, in which
        `realign` measures anew what depends on where devices stand. The session itself stays as it is.

    Raises
    ------
    SessionError
        There is no session, it is not calibrated, or the profile is another rig's.
    CalibrationFailed
        Nothing explains what the camera sees; with the cause.
    DeviceError
        A device does not open, or no good frame came.
    """
    with one_error_tree():
        folder = aligned_folder(request.folder)
        with Session.read(folder) as before:
            profile = _profile_of(request, before)
            known = known_rig(before)
            with _opened(request.folder, before, profile) as work:
                return _checked(work, known, before, request=request, on_step=on_step)


def _profile_of(request: RecheckRequest, before: Session) -> Profile:
    """The session's profile, or one that differs in where simulated devices stand."""
    if before.profile.camera.driver == "replay":
        raise UsageError(
            f"{before.path}: a replayed session has no rig that could have moved; re-check a session of the rig itself"
        )
    if request.profile is None:
        return before.profile
    profile = load_runnable_profile(request.profile)
    changed = [name for name in changed_devices(before.profile, profile) if name not in (_SIMULATED, "name")]
    if changed:
        raise SessionError(
            f"{profile.path}: is not the rig of {before.path}: they differ in {', '.join(changed)}; leave the profile "
            f"out (it may differ in [{_SIMULATED}] alone)"
        )
    return profile


@contextmanager
def _opened(folder: Path, before: Session, profile: Profile) -> Iterator[OpenSession]:
    """Yield a session inside of a session's folder, that knows exposure and response, and its open rig."""
    with open_rig(profile, resume_at_s=before.last_clock_s) as rig:
        with Session.open(next_recheck(folder), profile, seed=before.seed) as session:
            yield OpenSession(session, lambda: rig, rig=rig)


def _checked(
    work: OpenSession, known: KnownRig, before: Session, *, request: RecheckRequest, on_step: OnStep
) -> Recheck:
    session, rig = work.session, work.rig()
    started_s = rig.clock.now_s()
    gray = _photographed(rig, session, before, known, on_step=on_step)
    device_s = rig.clock.now_s() - started_s
    on_step("compare with the session", 0, 2)
    now = without_mirrored(read_code_once(session, gray))
    white, black = light_of_flats(gray, known.radiometric)
    compared = compare(known, now, white, black)
    on_step("compare with the session", 1, 2)
    result = _result(compared, request, before, session, n_frames=len(gray.frame_names), device_s=device_s)
    on_step("compare with the session", 2, 2)
    if request.realign:
        realigned = realigned_session(work, before, request.folder, light=result.light, on_step=on_step)
        result = replace(result, realigned=realigned).with_limits(with_realigned(result, realigned))
    result = replace(result, report=str(write_recheck_page(result, compared, session.path)))
    _keep(session, result)
    return result


def _photographed(rig: Rig, session: Session, before: Session, known: KnownRig, *, on_step: OnStep) -> Step:
    """Take over what does not depend on places; photograph white and black, then, if they are well, the code."""
    for name in _TAKEN_OVER:
        earlier = before.finished(name)
        needs = () if name == "exposure" else ("exposure",)
        session.step(name, settings=earlier.settings, needs=needs).take_over(earlier)
    gray = session.step("gray", settings=gray_settings(session), needs=_TAKEN_OVER)
    photograph_flats(rig, session, gray, on_step)
    black_dn = gray.load_frame(frame_name("black")).pixels
    refuse_flood(black_dn, known.radiometric.saturation_dn, _MOST_CLIPPED)
    refuse_darkness(known, light_of_flats(gray, known.radiometric)[0], _LEAST_WHITE)
    photograph_code_once(rig, session, gray, on_step)
    return gray


def _result(
    compared: Compared, request: RecheckRequest, before: Session, session: Session, *, n_frames: int, device_s: float
) -> Recheck:
    motion, light = compared.motion, LightResult.of(compared.light)
    camera, projector = MotionResult.of(motion.camera), MotionResult.of(motion.projector)
    found = motion.moved, camera, projector, compared.surface, light
    empty = Recheck(
        session=str(request.folder),
        compared_with=str(before.path),
        folder=str(session.path),
        profile=session.profile.name,
        frames=n_frames,
        device_s=device_s,
        moved=motion.moved,
        summary=summary_of(*found),
        displacement_px=motion.displacement_px,
        noise_px=motion.noise_px,
        camera=camera,
        projector=projector,
        surface=compared.surface,
        light=light,
        limits=(),
        within_limits=True,
    )
    return empty.with_limits(limits_of(*found))


def _keep(session: Session, result: Recheck) -> None:
    """Write the result as a record of the look."""
    step = session.step(RECORD, settings={"report": result.report})
    step.save_record(RECORD, result)
    step.finish()
