"""About how long the rest of a session takes: by its own pace where it has one, else by what its rig can do at best."""

from __future__ import annotations

from collections.abc import Sequence

from rig.profile.schema import Profile
from rig.session import Session
from rig.session.timing import seconds_by_step

_SAVING_S = 0.05
"""To write a frame of a few megapixels to a disk."""
_FRAMES_TO_SETTLE = 2.0
"""Camera frames between a new picture and the first that was exposed to all of it."""
_SIMULATED_S_PER_MPX = 0.5
"""A simulated photograph, projector and camera pixels together: a rough figure of sessions on a busy machine."""
_COMPUTING_S = {"geometry": (10.0, 1.0), "separation": (0.5, 5.0), "correspondence": (0.5, 10.0), "model": (2.0, 3.0)}
_COMPUTING_S |= {"compensate": (1.0, 8.0), "compare": (1.0, 3.0)}
"""(seconds, seconds a megapixel of the camera) that a step computes: as rough; a session's own steps replace them."""


def seconds_left(steps: Sequence[tuple[str, bool, int]], profile: Profile, session: Session | None) -> float:
    """Return about how many seconds are left.

    Parameters
    ----------
    steps
        Name, whether it is done, and frames, of each.
    profile
        Of the rig.
    session
        Whose pace so far counts; None of a new one.
    """
    pace_s = _own_pace(session) or _frame_s(profile)
    megapixels = profile.camera.width_px * profile.camera.height_px / 1e6
    total = 0.0
    for name, done, frames in steps:
        if not done:
            fixed_s, by_size_s = _COMPUTING_S.get(name, (0.0, 0.0))
            total += frames * pace_s + fixed_s + by_size_s * megapixels
    return total


def _own_pace(session: Session | None) -> float | None:
    """Seconds a frame of the step with the most frames; None where nothing was photographed yet."""
    if session is None:
        return None
    counts: dict[str, int] = {}
    for event in session.frame_log():
        if event["event"] == "frame":
            counts[event["step"]] = counts.get(event["step"], 0) + 1
    # steps that also compute would make frames look slow
    counts = {name: count for name, count in counts.items() if name in ("response", "gray", "project")}
    most = max(counts, key=lambda name: counts[name], default=None)
    return None if most is None else seconds_by_step(session).get(most, 0.0) / counts[most]


def _frame_s(profile: Profile) -> float:
    camera, projector = profile.camera, profile.projector
    if camera.driver in ("simulated", "replay"):
        pixels = camera.width_px * camera.height_px + projector.width_px * projector.height_px
        return _SIMULATED_S_PER_MPX * pixels / 1e6
    exposures = profile.patterns.exposures
    exposure_s = camera.exposure_s * sum(exposures) / len(exposures)
    return projector.latency_s + exposure_s + _FRAMES_TO_SETTLE / camera.frame_rate_hz + _SAVING_S
