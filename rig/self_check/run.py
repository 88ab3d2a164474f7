"""The check as a whole: which parts, in which order, and what comes out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TypeVar

from rig.capture.rig import Rig, open_rig
from rig.devices.protocols import Advising
from rig.errors import CalibrationFailed, CaptureTimeout, SettingRefused, UsageError
from rig.profile.schema import Profile, load_profile
from rig.records import Record, Verdict, all_met
from rig.self_check.parts.additivity import check_additivity
from rig.self_check.parts.checker import check_checker
from rig.self_check.parts.darkness import check_darkness
from rig.self_check.parts.exposure import PATIENCE_S, check_exposure, prepare_rig, with_generous_latency
from rig.self_check.parts.flicker import ROOM, Flicker, check_flicker
from rig.self_check.parts.latency import Latency, check_latency
from rig.self_check.parts.linearity import (
    CameraCurve,
    Sweep,
    camera_curve,
    check_linearity,
    measure_sweep,
    straight_curve,
)
from rig.self_check.parts.noise import check_noise
from rig.self_check.parts.pipeline import check_pipeline
from rig.self_check.parts.pixels import check_pixels
from rig.self_check.parts.ramp import check_ramp
from rig.self_check.parts.saturation import check_saturation, smallest_step_dn
from rig.self_check.parts.stability import check_stability, take_reference_image
from rig.self_check.parts.view import check_view
from rig.self_check.results import PartResult, SelfCheck
from rig.self_check.rig_under_test import RigUnderTest
from rig.stages.error_tree import one_error_tree
from rig.terminal import OnStep, silent


class _Check:
    """One check: the rig under test, and what several parts need."""

    def __init__(self, tested: RigUnderTest):
        self.tested = tested
        self.reference_image = take_reference_image(tested)

    @cached_property
    def sweep(self) -> Sweep:
        return measure_sweep(self.tested)

    @cached_property
    def curve(self) -> CameraCurve:
        return camera_curve(self.tested, self.sweep)

    @property
    def curve_or_straight(self) -> CameraCurve:
        """For a part that can be measured roughly without it."""
        try:
            with one_error_tree():
                return self.curve
        except CalibrationFailed:
            return straight_curve(self.tested)


_PARTS: Mapping[str, Callable[[_Check], PartResult[Record]]] = {
    "exposure": lambda check: check_exposure(check.tested),
    "pipeline": lambda check: check_pipeline(check.tested),
    "flicker": lambda check: check_flicker(check.tested),
    "linearity": lambda check: check_linearity(check.tested, check.sweep, check.curve),
    "noise": lambda check: check_noise(check.tested, check.curve, smallest_step_dn(check.tested)),
    "saturation": lambda check: check_saturation(check.tested),
    "pixels": lambda check: check_pixels(check.tested),
    "darkness": lambda check: check_darkness(check.tested, check.curve_or_straight),
    "additivity": lambda check: check_additivity(check.tested, check.curve),
    "checker": lambda check: check_checker(check.tested, check.curve),
    "ramp": lambda check: check_ramp(check.tested),
    "view": lambda check: check_view(check.tested, check.curve, check.sweep),
    "stability": lambda check: check_stability(check.tested, check.reference_image),
}
_SPOILED_BY_FLICKER = frozenset(_PARTS) - {"exposure", "pipeline", "flicker"}
PARTS = ("latency", *_PARTS)
"""What `--only` knows, in the order in which it is measured."""


def run_check(profile_name: str, on_step: OnStep = silent, only: Sequence[str] = ()) -> SelfCheck:
    """Measure a rig; value, limit and verdict of each row, values for its profile, and all raw numbers.

    Parameters
    ----------
    profile_name
        File or bare name of a profile that is not a replay.
    on_step
        Told how far it is.
    only
        Some of ``PARTS``; default: all.

    Returns
    -------
    SelfCheck
        Verdicts, values for the profile, and all raw numbers.

    Raises
    ------
    UsageError
        An unknown part, or a replay.
    CalibrationFailed
        No light of the projector reaches the camera.
    DeviceError
        A device fails.
    """
    parts = parts_of(only)
    profile = load_profile(profile_name)
    _refuse_replay(profile)
    with open_rig(with_generous_latency(profile)) as rig:
        return check_rig(rig, profile, on_step, parts)


def parts_of(only: Sequence[str]) -> tuple[str, ...]:
    """Names of parts in the order in which they are measured. Raises UsageError."""
    unknown = [name for name in only if name not in PARTS]
    if unknown:
        raise UsageError(f"rig check has no part {', '.join(map(repr, unknown))}; it has {', '.join(PARTS)}")
    return tuple(name for name in PARTS if name in only) if only else PARTS


def _refuse_replay(profile: Profile) -> None:
    if profile.camera.driver == "replay":
        raise UsageError(
            f"{profile.path}: a replay cannot be checked: it has no clock, so no latency, jitter, frame rate, flicker "
            "or drift, and it cannot show the pictures that a check needs (checkers, ramp, colours, series of one "
            "picture). Check the rig itself, with the profile that the recording was made with"
        )


def check_rig(rig: Rig, profile: Profile, on_step: OnStep, parts: Sequence[str] = PARTS) -> SelfCheck:
    """Measure an open rig whose profile has a generous latency (`run_check`); ``profile`` is the one to be judged."""
    started_s = rig.clock.now_s()
    measured: dict[str, PartResult[Record]] = {}
    tested = prepare_rig(rig)
    tested.promised_latency_s = profile.projector.latency_s
    latency: Latency | None = None
    if "latency" in parts:
        found = _measure("latency", on_step, partial(check_latency, tested))
        measured["latency"], latency = found, found.numbers
        # from here on the rig waits as long as was measured, and no longer
        safe_s = latency.safe_s if latency else PATIENCE_S
        rig.profile = with_generous_latency(rig.profile, min(safe_s, 2 * PATIENCE_S))
    check = _Check(tested)
    for name in parts:
        if name in _PARTS:
            tested.note_white()
            measured[name] = _measure(name, on_step, partial(_PARTS[name], check))
            if name == "view" and latency is not None and measured[name].numbers is None:
                measured |= _with_more_patience(check, measured, on_step)
    measured = _blaming_the_room(measured)
    measured["frames"] = _rejections(tested)
    if isinstance(rig.camera, Advising):
        measured["transport"] = _transport(rig.camera)
    return SelfCheck(
        profile=profile.name,
        exposure_s=tested.exposure_s,
        device_s=rig.clock.now_s() - started_s,
        parts=measured,
        frames_rejected=sum(tested.rejected().values()),
        latency_s=_distribution(latency) if latency else None,
    )


def _blaming_the_room(measured: Mapping[str, PartResult[Record]]) -> dict[str, PartResult[Record]]:
    """Where the room's light flickers, what it may have spoiled as well says so first: its own advice misleads."""
    flicker = measured.get("flicker")
    if flicker is None or not isinstance(flicker.numbers, Flicker) or flicker.numbers.where != ROOM:
        return dict(measured)
    if all_met(flicker.verdicts):
        return dict(measured)
    return {name: _blamed(part) if name in _SPOILED_BY_FLICKER else part for name, part in measured.items()}


def _blamed(part: PartResult[Record]) -> PartResult[Record]:
    first = "the room's light that flickers (above) can do this alone: switch it off and check again; if it stays, "
    return replace(part, verdicts=tuple(v if v.met else replace(v, advice=first + v.advice) for v in part.verdicts))


def _with_more_patience(
    check: _Check, measured: Mapping[str, PartResult[Record]], on_step: OnStep
) -> dict[str, PartResult[Record]]:
    """The view again, waiting longer and longer for each picture, and the latency that it needs.

    Latency is measured with two pictures that are shown again and again; some displays and emulations take longer for
    one that they never showed, and a session shows little else. Nothing, where waiting does not help.
    """
    rig = check.tested.rig
    measured_s = waited_s = rig.profile.projector.latency_s
    while waited_s < PATIENCE_S:
        waited_s = min(2 * waited_s, PATIENCE_S)
        rig.profile = with_generous_latency(rig.profile, waited_s)
        view = _measure("view", on_step, partial(_PARTS["view"], check))
        if view.numbers is not None:
            needed = Verdict(
                what="latency that pictures need which were never shown before",
                value=waited_s,
                limit=check.tested.promised_latency_s,
                unit="s",
                advice="give projector.latency_s the value suggested below; no compositor; a quicker graphics card",
            )
            latency = measured["latency"]
            suggested = {**latency.suggested, "projector.latency_s": round(waited_s, 4)}
            more = replace(latency, verdicts=(*latency.verdicts, needed), suggested=suggested)
            return {"latency": more, "view": view}
    rig.profile = with_generous_latency(rig.profile, measured_s)
    return {}


Numbers = TypeVar("Numbers", bound=Record)


def _measure(name: str, on_step: OnStep, part: Callable[[], PartResult[Numbers]]) -> PartResult[Numbers]:
    """A part that cannot be measured is a row that fails, and the others go on; a device that is lost ends it all."""
    on_step(f"check: {name}", 0, 1)
    try:
        with one_error_tree():
            result = part()
    except (CalibrationFailed, CaptureTimeout, SettingRefused) as error:
        failed = Verdict(what=f"{name} could not be measured", value=1.0, limit=0.0, unit="failure", advice=str(error))
        result = PartResult(verdicts=(failed,))
    on_step(f"check: {name}", 1, 1)
    return result


@dataclass(frozen=True, kw_only=True)
class RejectedFrames(Record):
    """Frames that the rig has refused while it was checked."""

    given: int
    """All that the camera has delivered."""
    stale: int
    ahead: int
    repeated: int
    malformed: int


def _rejections(tested: RigUnderTest) -> PartResult[RejectedFrames]:
    rejected = tested.rejected()
    verdict = Verdict(
        what="frames refused: stale, repeated, malformed",
        value=100 * sum(rejected.values()) / tested.frames_given,
        limit=tested.limits.rejected_percent,
        unit="% of frames",
        advice="too few buffers or too slow a bus: a smaller format, another port; the events name each frame",
    )
    return PartResult(verdicts=(verdict,), numbers=RejectedFrames(given=tested.frames_given, **rejected))


@dataclass(frozen=True, kw_only=True)
class TransportAdvice(Record):
    """What the way from the camera to this machine lacks."""

    advice: tuple[str, ...]


def _transport(camera: Advising) -> PartResult[TransportAdvice]:
    """Rows without a limit: a rig whose frames all arrive need not be tuned."""
    lines = camera.advice()
    verdict = Verdict(
        what="settings of the camera's transport that could be better",
        value=float(len(lines)),
        unit="settings",
        advice="; ".join(lines),
    )
    return PartResult(verdicts=(verdict,), numbers=TransportAdvice(advice=lines))


def _distribution(latency: Latency) -> dict[str, float]:
    return {"mean": latency.mean, "min": latency.min, "median": latency.median, "max": latency.max, "sd": latency.sd}
