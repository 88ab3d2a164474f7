"""Self-test of a rig: what calibration takes for granted, measured. Verb `check`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import CalibrationFailed, CaptureTimeout
from rig.pair import Rig, open_rig
from rig.profile import Profile, load_profile
from rig.terminal import OnStep

FloatArray = NDArray[np.float64]

_LATENCY_TRIALS = 12
_PARTS = 5
_LEAST_SIGNAL = 0.01
"""White has to be brighter than black by this share of full scale, or there is nothing to measure."""
_PATIENCE_S = 0.5
"""No display known to us takes longer from its time stamp to light."""
_FRAMES_WAITED = 200
_LEAST_CHANGE = 0.02
"""Share of a change of brightness by which a frame shows it; noise of a frame's mean is far below."""


def run_check(profile_name: str, on_step: OnStep) -> dict[str, Any]:
    """Measure latency, darkness, saturation, noise, additivity; a value, a limit and a verdict each."""
    profile = load_profile(profile_name)
    with open_rig(_patient(profile)) as rig:
        exposure_s = _expose(rig)
        _refuse_darkness(rig, exposure_s)
        on_step("check", 1, _PARTS)
        latency = _latency(rig, exposure_s)
        rig.set_exposure(exposure_s)
        on_step("check", 2, _PARTS)
        noise = _noise(rig)
        on_step("check", 3, _PARTS)
        drift = _repeatability(rig)
        on_step("check", 4, _PARTS)
        additivity = _additivity(rig)
        on_step("check", 5, _PARTS)
        stale = sum(event.kind == "stale" for event in rig.events)
    rows = [
        _row("white above black, share of full scale", noise["signal_share"], 0.05, least=True),
        _row("clipped pixels with white on, share", noise["clipped_share"], 0.002),
        _row("temporal noise at white, % of signal", noise["noise_percent"], 5.0),
        _row("latency of the display, s", latency["max"], profile.projector.latency_s),
        _row("change of white between first and last frame, %", drift, 1.0),
        _row("left half + right half against white, %", additivity, 1.0),
    ]
    return {
        "profile": profile.name,
        "exposure_s": exposure_s,
        "latency_s": latency,
        "checks": rows,
        "stale_frames_rejected": stale,
        "suggested": {"projector.latency_s": round(latency["max"] + 0.25 / profile.projector.refresh_rate_hz, 4)},
        "within_limits": all(row["passed"] for row in rows),
    }


def _patient(profile: Profile) -> Profile:
    """The profile with a latency that is surely long enough: the promised one is to be checked, not trusted."""
    latency_s = max(profile.projector.latency_s, _PATIENCE_S)
    return profile.model_copy(update={"projector": profile.projector.model_copy(update={"latency_s": latency_s})})


def _row(what: str, value: float, limit: float, least: bool = False) -> dict[str, Any]:
    return {"what": what, "value": value, "limit": limit, "passed": value >= limit if least else value <= limit}


def _shoot(rig: Rig, code: int | NDArray[np.uint8], name: str) -> FloatArray:
    codes = np.full(rig.projector.shape, code, np.uint8) if isinstance(code, int) else code
    return rig.shoot(codes, name=name).pixels[..., 0].astype(np.float64)


def _expose(rig: Rig) -> float:
    """White at about 80 % of full scale."""
    exposure_s = rig.set_exposure(rig.profile.camera.exposure_s)
    shortest, longest = rig.profile.camera.exposure_range_s
    for _ in range(6):
        level = float(np.quantile(_shoot(rig, 255, "white"), 0.999)) / rig.camera.full_scale_dn
        if 0.7 < level < 0.9:
            break
        factor = 0.25 if level > 0.98 else 0.8 / max(level, 0.02)
        exposure_s = rig.set_exposure(float(np.clip(exposure_s * factor, shortest, longest)))
    return exposure_s


def _refuse_darkness(rig: Rig, exposure_s: float) -> None:
    difference = float(np.quantile(_shoot(rig, 255, "white") - _shoot(rig, 0, "black"), 0.99))
    limit = _LEAST_SIGNAL * rig.camera.full_scale_dn
    if difference < limit:
        raise CalibrationFailed(
            f"projector white is only {difference:.1f} dn brighter than black at {exposure_s:.4g} s, the limit is "
            f"{limit:.0f} dn: no light of the projector reaches the camera. Look at lens caps, aim and room light."
        )


def _latency(rig: Rig, exposure_s: float) -> dict[str, float]:
    """From the display's time stamp to light: frames are taken without waiting, until they show the change.

    The light's share of an exposure that the change cuts tells when it came, so the exposures last as long as
    the camera's period and leave no gap; a darker code keeps them from saturating.
    """
    longest_s = rig.camera.exposure_range_s[1]
    rig.set_exposure(max(exposure_s, min(1 / rig.profile.camera.frame_rate_hz, longest_s)))
    dark = float(_shoot(rig, 0, "black").mean())
    code, bright = _unsaturated(rig)
    delays = []
    for trial in range(_LATENCY_TRIALS):
        shown_code, before, after = (0, bright, dark) if trial % 2 == 0 else (code, dark, bright)
        shown = rig.projector.show(np.full(rig.projector.shape, shown_code, np.uint8), name=f"latency-{trial}")
        delays.append(_change_s(rig, shown.on_screen_s, before, after) - shown.on_screen_s)
    return {"mean": float(np.mean(delays)), "max": float(np.max(delays))}


def _unsaturated(rig: Rig) -> tuple[int, float]:
    """Brightest of a few codes that does not saturate, still shown, and the mean of its frame."""
    for code in (255, 192, 128, 64):
        frame = _shoot(rig, code, f"level-{code:03d}")
        if np.quantile(frame, 0.999) < 0.9 * rig.camera.full_scale_dn:
            break
    return code, float(frame.mean())


def _change_s(rig: Rig, on_screen_s: float, before: float, after: float) -> float:
    """When the light changed, on the rig's clock. [s]."""
    seen: set[int] = set()
    for _ in range(_FRAMES_WAITED):
        frame = rig.camera.capture(after_s=on_screen_s, timeout_s=rig.profile.timing.timeout_s)
        if frame.sequence in seen or frame.started_s < on_screen_s:
            continue
        seen.add(frame.sequence)
        share = (float(frame.pixels.mean()) - before) / (after - before)
        if share > _LEAST_CHANGE:
            return frame.started_s + (1 - min(share, 1.0)) * frame.exposure_s
    raise CaptureTimeout(
        f"a new picture was not seen in {_FRAMES_WAITED} frames after it was shown; does the camera see the projector?"
    )


def _noise(rig: Rig) -> dict[str, float]:
    black = _shoot(rig, 0, "black")
    first, second = _shoot(rig, 255, "white"), _shoot(rig, 255, "white")
    signal = (first + second) / 2 - black
    lit = signal > 0.3 * np.quantile(signal, 0.99)
    noise = (first - second)[lit].std() / np.sqrt(2)
    return {
        "signal_share": float(np.quantile(signal, 0.99)) / rig.camera.full_scale_dn,
        "clipped_share": float((first >= rig.camera.full_scale_dn).mean()),
        "noise_percent": 100 * float(noise / signal[lit].mean()),
    }


def _repeatability(rig: Rig) -> float:
    means = [float(_shoot(rig, 255, "white").mean()) for _ in range(8)]
    return 100 * abs(means[-1] - means[0]) / means[0]


def _additivity(rig: Rig) -> float:
    """Light of two halves against light of the whole, black counted once: linearity of the whole chain."""
    height, width = rig.projector.shape
    left = np.zeros((height, width), np.uint8)
    left[:, : width // 2] = 255
    black = _shoot(rig, 0, "black")
    whole = _shoot(rig, 255, "white") - black
    halves = _shoot(rig, left, "left-half") + _shoot(rig, 255 - left, "right-half") - 2 * black
    lit = whole > 0.3 * np.quantile(whole, 0.99)
    return 100 * abs(float(np.median(halves[lit] / whole[lit])) - 1)
