"""The check as a whole: which parts, in which order, and what comes out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import Any

from rig.capture.rig import Rig, open_rig
from rig.errors import CalibrationFailed, CaptureTimeout, SettingRefused, UsageError
from rig.profile.schema import Profile, load_profile
from rig.self_check.parts.additivity import check_additivity
from rig.self_check.parts.checker import check_checker
from rig.self_check.parts.darkness import check_darkness
from rig.self_check.parts.exposure import PATIENCE_S, check_exposure, find_subject, with_generous_latency
from rig.self_check.parts.flicker import check_flicker
from rig.self_check.parts.latency import check_latency
from rig.self_check.parts.linearity import Linear, Sweep, check_linearity, linear_of, measure_sweep
from rig.self_check.parts.noise import check_noise
from rig.self_check.parts.pipeline import check_pipeline
from rig.self_check.parts.pixels import check_pixels
from rig.self_check.parts.ramp import check_ramp
from rig.self_check.parts.saturation import check_saturation, smallest_step_dn
from rig.self_check.parts.stability import check_stability, note_landmark
from rig.self_check.rig_under_test import RigUnderTest
from rig.self_check.rows import Measured, Row
from rig.terminal import OnStep


class _Check:
    """One check: its subject, and what several parts need."""

    def __init__(self, subject: RigUnderTest):
        self.subject = subject
        self.reference_image = note_landmark(subject)

    @cached_property
    def sweep(self) -> Sweep:
        return measure_sweep(self.subject)

    @cached_property
    def linear(self) -> Linear:
        return linear_of(self.subject, self.sweep)


_PARTS: Mapping[str, Callable[[_Check], Measured]] = {
    "exposure": lambda check: check_exposure(check.subject),
    "pipeline": lambda check: check_pipeline(check.subject),
    "flicker": lambda check: check_flicker(check.subject),
    "linearity": lambda check: check_linearity(check.subject, check.sweep),
    "noise": lambda check: check_noise(check.subject, check.linear, smallest_step_dn(check.subject)),
    "saturation": lambda check: check_saturation(check.subject),
    "pixels": lambda check: check_pixels(check.subject),
    "darkness": lambda check: check_darkness(check.subject),
    "additivity": lambda check: check_additivity(check.subject, check.linear),
    "checker": lambda check: check_checker(check.subject, check.linear),
    "ramp": lambda check: check_ramp(check.subject),
    "stability": lambda check: check_stability(check.subject, check.reference_image),
}
PARTS = ("latency", *_PARTS)
"""What `--only` knows, in the order in which it is measured."""


def run_check(profile_name: str, on_step: OnStep, only: Sequence[str] = ()) -> dict[str, Any]:
    """Measure a rig; value, limit and verdict of each row, values for its profile, and all raw numbers.

    Parameters
    ----------
    profile_name
        File or bare name of a profile that is not a replay.
    only
        Some of ``PARTS``; default: all.

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


def check_rig(rig: Rig, profile: Profile, on_step: OnStep, parts: Sequence[str] = PARTS) -> dict[str, Any]:
    """Measure an open rig whose profile has a generous latency (`run_check`); ``profile`` is the one to be judged."""
    started_s = rig.clock.now_s()
    measured: dict[str, Measured] = {}
    subject = find_subject(rig)
    subject.promised_latency_s = profile.projector.latency_s
    if "latency" in parts:
        measured["latency"] = _measure("latency", on_step, partial(check_latency, subject))
        # from here on the rig waits as long as was measured, and no longer
        safe_s = measured["latency"].numbers.get("safe_s", PATIENCE_S)
        rig.profile = with_generous_latency(rig.profile, min(safe_s, 2 * PATIENCE_S))
    check = _Check(subject)
    for name in parts:
        if name in _PARTS:
            subject.note_reference()
            measured[name] = _measure(name, on_step, partial(_PARTS[name], check))
    measured["frames"] = _rejections(subject)
    return _result(profile, subject, measured, rig.clock.now_s() - started_s)


def _measure(name: str, on_step: OnStep, part: Callable[[], Measured]) -> Measured:
    """A part that cannot be measured is a row that fails, and the others go on; a device that is lost ends it all."""
    on_step(f"check: {name}", 0, 1)
    try:
        result = part()
    except (CalibrationFailed, CaptureTimeout, SettingRefused) as error:
        result = Measured((Row(f"{name} could not be measured", 1.0, "failure", 0.0, advice=str(error)),))
    on_step(f"check: {name}", 1, 1)
    return result


def _rejections(subject: RigUnderTest) -> Measured:
    """Frames that the rig has refused while it was checked."""
    rejected = subject.rejected()
    percent = 100 * sum(rejected.values()) / subject.frames_given
    row = Row(
        "frames refused: stale, repeated, malformed",
        percent,
        "% of frames",
        subject.limits.rejected_percent,
        advice="too few buffers or too slow a bus: a smaller format, another port; the events name each frame",
    )
    return Measured((row,), {}, {"given": subject.frames_given, **rejected})


def _result(
    profile: Profile, subject: RigUnderTest, measured: Mapping[str, Measured], device_s: float
) -> dict[str, Any]:
    rows = [row.as_dict(name) for name, part in measured.items() for row in part.rows]
    suggested = {key: value for part in measured.values() for key, value in part.suggested.items()}
    result = {
        "profile": profile.name,
        "exposure_s": subject.exposure_s,
        "device_s": device_s,
        "checks": rows,
        "suggested": suggested,
        "stale_frames_rejected": sum(subject.rejected().values()),
        "numbers": {name: dict(part.numbers) for name, part in measured.items()},
        "within_limits": all(row["passed"] for row in rows),
    }
    numbers = measured["latency"].numbers if "latency" in measured else {}
    if numbers:
        result["latency_s"] = {key: numbers[key] for key in ("mean", "min", "median", "max", "sd")}
    return result
