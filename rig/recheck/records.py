"""What is asked of a re-check, and what it found."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from calibration.geometry.moved.records import DeviceMotion, Moved
from calibration.radiometry.steadiness import LightChange
from rig.records import JsonObject, Record, Verdict, all_met

RECORD = "recheck"
"""Step and record of a look that hold what it found."""
PAGE = "recheck.html"
"""In a look's folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecheckRequest:
    """What is to be looked at again."""

    folder: Path
    """Of the session."""
    profile: str | None = None
    """File or name; default: the session's. It may differ from that in `[simulation]` alone."""
    realign: bool = False
    """Measure anew what depends on where the devices stand."""


@dataclass(frozen=True, kw_only=True)
class MotionResult(Record):
    """How far one device is from where it was calibrated; sigma is a standard deviation."""

    turned_deg: float
    turned_sigma_deg: float
    moved_mm: float
    moved_sigma_mm: float
    image_px: float
    """By how much walls moved in its picture, at the median, in its own pixels."""
    image_sigma_px: float
    turn_deg: tuple[float, float, float]
    """About the device's axes: right, down, forward."""
    shift_mm: tuple[float, float, float]
    """Along the room's axes."""

    @classmethod
    def of(cls, motion: DeviceMotion) -> MotionResult:
        """Return the record of a motion."""
        turn, shift = motion.turn_deg.tolist(), (1000 * motion.shift_m).tolist()
        return cls(
            turned_deg=motion.turned_deg,
            turned_sigma_deg=motion.turned_sigma_deg,
            moved_mm=1000 * motion.shifted_m,
            moved_sigma_mm=1000 * motion.shifted_sigma_m,
            image_px=motion.image_px,
            image_sigma_px=motion.image_sigma_px,
            turn_deg=(turn[0], turn[1], turn[2]),
            shift_mm=(shift[0], shift[1], shift[2]),
        )


@dataclass(frozen=True, kw_only=True)
class SurfaceChange(Record):
    """What neither device's move explains: a thing that was moved, brought or taken away."""

    share: float
    """Of the compared pixels: see something that stands elsewhere."""
    lost_share: float
    """Of the pixels that had a projector pixel, and where the projector still reaches: have none now."""
    walls: tuple[str, ...]
    """Walls on which most of these pixels lie, the first with the most."""


@dataclass(frozen=True, kw_only=True)
class LightResult(Record):
    """Whether lamp and room light are what they were."""

    lamp_gain: float
    """Projector's light now over before."""
    lamp_gain_sigma: float
    room_light: float
    """Light of the room now minus before, as a share of projector white."""
    room_light_sigma: float

    @classmethod
    def of(cls, change: LightChange) -> LightResult:
        """Return the record of a change."""
        return cls(
            lamp_gain=change.lamp_gain,
            lamp_gain_sigma=change.lamp_gain_sigma,
            room_light=change.room_light,
            room_light_sigma=change.room_light_sigma,
        )


@dataclass(frozen=True, kw_only=True)
class Realigned(Record):
    """The session that was measured where the devices stand now."""

    folder: str
    strategy: str | None = None
    """Whose picture was photographed before and after; None where the session was never compared."""
    error_before: float | None = None
    """Mean absolute error against the target in grey levels of 255, when the session was made ..."""
    error_after: float | None = None
    """... and realigned."""


@dataclass(frozen=True, kw_only=True)
class Recheck(Record):
    """What a re-check found; `rig recheck --json` prints it."""

    session: str
    compared_with: str
    """The session whose map was compared: a later, realigned one takes the first one's place."""
    folder: str
    """Where this look's photographs and its page are."""
    profile: str
    frames: int
    device_s: float
    """How long the look took, on the rig's clock."""
    moved: Moved
    summary: str
    """What moved, in words."""
    displacement_px: float
    """Median distance between what camera pixels see now and before, in projector pixels."""
    noise_px: float
    """Standard deviation of what is left of an undisturbed pixel, in projector pixels."""
    camera: MotionResult
    projector: MotionResult
    surface: SurfaceChange
    light: LightResult
    limits: tuple[Verdict, ...]
    within_limits: bool
    report: str | None = None
    realigned: Realigned | None = None

    def with_limits(self, limits: tuple[Verdict, ...]) -> Recheck:
        """Return the same with other rows in the table.

        Parameters
        ----------
        limits
            The rows; ``within_limits`` says whether all are met.

        Returns
        -------
        Recheck
        """
        return replace(self, limits=limits, within_limits=all_met(limits))

    def as_json(self) -> JsonObject:
        """Return all fields, each limit with what came of it.

        Returns
        -------
        JsonObject
        """
        return super().as_json()
