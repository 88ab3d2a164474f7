"""Software triggers: each has its one frame before the next is sent, and a frame of an earlier one is no answer."""

from __future__ import annotations

from rig.devices.genicam.opened import OpenGenicam
from rig.devices.genicam.stream import FilledBuffer, GenicamSearch
from rig.devices.protocols import Clock

ANSWER_S = 1.0
"""From a trigger to the frame, on top of its exposure: readout and transfer of any camera that this is for."""
_GIVEN_UP = 0.5
"""Of that: a frame that is stamped earlier by so much is of a trigger that was given up."""
_NEXT_S = 0.25
"""After a frame that may be of an earlier trigger, besides the exposure: until then the right one comes, if ever."""
SENT_ONCE_S = 0.4
"""A command that was answered sooner was sent once: Aravis sends it again after half a second."""
SILENCE_S = 2.0
"""After a frame that nobody asked for, besides the exposure: if none followed for so long, none will."""
_EARLY_SHARE = 0.97
"""Of the exposure: a frame that arrives sooner after the trigger was exposed before it; exposures are true to 3 %."""


def is_quiet(opened: OpenGenicam, clock: Clock, times_s: tuple[float, float], seen: GenicamSearch) -> bool:
    """Wait until a frame may be triggered, and none is on its way; False when there is no time for that.

    Parameters
    ----------
    opened
        The camera.
    clock
        The rig's.
    times_s
        From when on a frame may be exposed, and when waiting ends.
    seen
        Counts frames that nobody asked for.
    """
    after_s, until_s = times_s
    clock.wait_until_s(min(after_s, until_s))
    while (now_s := clock.now_s()) < until_s:
        dropped = opened.stream.drop_waiting()
        if dropped:
            seen.frames, seen.early = seen.frames + dropped, seen.early + dropped
            opened.stay_quiet(now_s + opened.exposure_s + SILENCE_S)
        if now_s >= opened.quiet_until_s:
            return True
        clock.wait_until_s(min(opened.quiet_until_s, until_s))
    return False


def answer(
    opened: OpenGenicam, clock: Clock, times_s: tuple[float, float], seen: GenicamSearch
) -> tuple[FilledBuffer | None, float | None]:
    """Wait for the frame of a trigger, not for one that was exposed before it.

    Parameters
    ----------
    opened
        The camera.
    clock
        The rig's.
    times_s
        When the command was sent, and when waiting ends.
    seen
        Counts frames that were exposed too early, or came without their first packet.

    Returns
    -------
    FilledBuffer | None
        The frame; None when none came.
    float | None
        The time stamp of a frame after which none came, though it was earlier than answers are.
    """
    began_s, limit_s = times_s
    doubted: float | None = None
    while (filled := opened.stream.next(limit_s)) is not None:
        if not filled.has_leader:  # nothing tells of which trigger it is
            seen.frames, seen.incomplete = seen.frames + 1, seen.incomplete + 1
            opened.stream.give_back(filled)
            continue
        early_s = opened.answers.early_s(filled.device_s, began_s, opened.exposure_s)
        came_too_soon = filled.arrived_s < began_s + _EARLY_SHARE * opened.exposure_s
        is_by_little = early_s < _GIVEN_UP * ANSWER_S
        if not came_too_soon and is_by_little and opened.answers.explains(early_s, began_s, opened.exposure_s):
            return filled, None
        seen.frames, seen.early = seen.frames + 1, seen.early + 1
        opened.stream.give_back(filled)
        if not came_too_soon and is_by_little:
            doubted = filled.device_s
            limit_s = min(limit_s, clock.now_s() + opened.exposure_s + _NEXT_S)
    return None, doubted
