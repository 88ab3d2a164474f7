"""What a re-check found, held against limits and put into words."""

from __future__ import annotations

from calibration.geometry.moved.records import Moved
from rig.recheck.records import LightResult, MotionResult, Realigned, Recheck, SurfaceChange
from rig.records import Verdict

MOST_IMAGE_PX = 0.5
"""Half a pixel: from there on edges of a compensated picture and those of the wall no longer fall together."""
_MOST_ELSEWHERE, _MOST_LOST = 0.02, 0.05
"""Shares of the picture: a chair's, not a cup's."""
MOST_GAIN, MOST_ROOM = 0.03, 0.01
"""Shares of white: 3 % are five grey levels at a target's usual brightness, 1 % of room light two and a half."""
MOST_RISE = 0.10
"""By which a realigned picture's error may exceed that of the session."""

_REALIGN = "put it back and check again, or follow it: rig recheck --realign"


def limits_of(
    moved: Moved, camera: MotionResult, projector: MotionResult, surface: SurfaceChange, light: LightResult
) -> tuple[Verdict, ...]:
    """Return the table of a re-check."""
    # Where one device's move explains all, the other stands still.
    of_camera = 0.0 if moved == "projector" else camera.image_px
    of_projector = 0.0 if moved == "camera" else projector.image_px
    return (
        Verdict(what="camera moved", value=of_camera, limit=MOST_IMAGE_PX, unit="camera px", advice=_REALIGN),
        Verdict(what="projector moved", value=of_projector, limit=MOST_IMAGE_PX, unit="projector px", advice=_REALIGN),
        Verdict(
            what="picture with something that stands elsewhere",
            value=surface.share,
            limit=_MOST_ELSEWHERE,
            unit="of the pixels",
            advice="see the map of residuals; put the thing back, or calibrate a new session if it is to stay",
        ),
        Verdict(
            what="pixels that are lost",
            value=surface.lost_share,
            limit=_MOST_LOST,
            unit="of the pixels",
            advice="something covers the picture or the camera; a lens may be out of focus (rig show focus)",
        ),
        Verdict(
            what="change of the lamp",
            value=abs(light.lamp_gain - 1),
            limit=MOST_GAIN,
            unit="of white",
            advice="let the projector warm up; check its lamp mode, its picture mode and the lens; else --realign",
        ),
        Verdict(
            what="change of the room's light",
            value=abs(light.room_light),
            limit=MOST_ROOM,
            unit="of white",
            advice="darken the room as it was when the session was calibrated; else --realign",
        ),
    )


def summary_of(
    moved: Moved, camera: MotionResult, projector: MotionResult, surface: SurfaceChange, light: LightResult
) -> str:
    """Return what moved and what drifted, in a sentence or two."""
    return " ".join([_what_moved(moved, camera, projector), *_what_else(surface), _brightness(light)])


def _what_moved(moved: Moved, camera: MotionResult, projector: MotionResult) -> str:
    if moved == "nothing":
        return "Camera and projector stand still."
    if moved == "either":
        return (
            f"Either the camera or the projector moved, which the photographs do not tell apart: {_motion(camera)} of "
            f"the camera, or {_motion(projector)} of the projector."
        )
    if moved == "together":
        return (
            "Camera and projector stand to each other as before. Both were moved together, or the walls that they see "
            f"were: the camera {_motion(camera)}, the projector {_motion(projector)}."
        )
    if moved == "both":
        return f"Both moved: the camera {_motion(camera)}, the projector {_motion(projector)}."
    own = camera if moved == "camera" else projector
    other = "projector" if moved == "camera" else "camera"
    return f"The {moved} moved, the {other} did not: {_motion(own)}."


def _motion(motion: MotionResult) -> str:
    return (
        f"turned by {motion.turned_deg:.3g} ± {motion.turned_sigma_deg:.1g}°, shifted by {motion.moved_mm:.3g} ± "
        f"{motion.moved_sigma_mm:.1g} mm, its picture by {motion.image_px:.2g} px"
    )


def _what_else(surface: SurfaceChange) -> list[str]:
    if surface.share <= _MOST_ELSEWHERE:
        return []
    where = f", most of it on {' and '.join(surface.walls)}" if surface.walls else ""
    return [f"Something else stands elsewhere, in {100 * surface.share:.0f} % of the picture{where}."]


def _brightness(light: LightResult) -> str:
    return (
        f"The lamp is at {100 * light.lamp_gain:.1f} ± {100 * light.lamp_gain_sigma:.1g} % of what it was, the room's "
        f"light changed by {100 * light.room_light:.2f} ± {100 * light.room_light_sigma:.1g} % of white."
    )


def with_realigned(result: Recheck, realigned: Realigned) -> tuple[Verdict, ...]:
    """Return the table with the error of the picture after realigning beside that before; moves no longer count."""
    kept = tuple(row for row in result.limits if row.limit is None or row.unit.endswith("of the pixels"))
    if realigned.error_before is None or realigned.error_after is None:
        return kept
    return (
        *kept,
        Verdict(
            what="error of the realigned picture over that before",
            value=realigned.error_after / realigned.error_before,
            limit=1 + MOST_RISE,
            advice="calibrate a new session: the room, the lenses or the lamp are not what they were",
        ),
    )
