"""Reference exposure, black, and the two response curves: steps `exposure` and `response`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibration.patterns import flat, level_patterns
from calibration.photometry import fit_camera_response, fit_noise_model, fit_projector_response
from rig.errors import CalibrationFailed
from rig.pair import Rig
from rig.session import Session, Step
from rig.terminal import OnStep
from rig.workflows.capture import Shot, frame_name, photograph, shoot_one
from rig.workflows.light import Photometry, light_of, response_of, response_record

_AIM = 0.85
"""Where the brightest permille of projector white should lie, share of full scale."""
_SWEEP = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 0.75, 1.0, 1.1)
"""Exposures for the camera's response, multiples of the reference."""
_BLACK_REPEATS = 4
_MAX_TRIES = 10


def find_exposure(rig: Rig, session: Session, on_step: OnStep) -> None:
    """Step `exposure`: projector white just below saturation."""
    step = session.step("exposure", settings={"aim": _AIM, "start_s": rig.profile.camera.exposure_s})
    if step.done:
        return
    shortest, longest = rig.profile.camera.exposure_range_s
    white = flat(rig.projector.shape, 255, "white")
    exposure_s = rig.profile.camera.exposure_s
    full_scale = rig.camera.full_scale_dn
    for attempt in range(_MAX_TRIES):
        on_step("photograph: exposure", attempt, _MAX_TRIES)
        name = frame_name("white", attempt)
        if not step.has_frame(name):
            shoot_one(rig, session, step, white, name, exposure_s)
        level = float(np.quantile(step.load_frame(name).pixels, 0.999)) / full_scale
        if 0.9 * _AIM <= level <= 1.06 * _AIM:
            break
        factor = 0.25 if level > 0.98 else _AIM / max(level, 0.01)
        chosen = float(np.clip(exposure_s * factor, shortest, longest))
        if chosen == exposure_s:
            break
        exposure_s = chosen
    on_step("photograph: exposure", _MAX_TRIES, _MAX_TRIES)
    _refuse_darkness(rig, session, step, exposure_s, frame_name("white", attempt))
    step.save_record("exposure", {"exposure_s": exposure_s, "brightest_share_of_full_scale": level})
    step.finish()


def _refuse_darkness(rig: Rig, session: Session, step: Step, exposure_s: float, white_name: str) -> None:
    name = frame_name("black")
    if not step.has_frame(name):
        shoot_one(rig, session, step, flat(rig.projector.shape, 0, "black"), name, exposure_s)
    white, black = (step.load_frame(n).pixels.astype(np.float64) for n in (white_name, name))
    difference = float(np.quantile(white - black, 0.99))
    limit = 0.01 * rig.camera.full_scale_dn
    if difference < limit:
        raise CalibrationFailed(
            f"projector white is only {difference:.1f} dn brighter than black at {exposure_s:.4g} s, the limit is "
            f"{limit:.0f} dn: no light of the projector reaches the camera. Look at lens caps, aim and room light."
        )


def reference_exposure_s(session: Session) -> float:
    """The session's reference exposure."""
    return float(session.finished("exposure").load_record("exposure")["exposure_s"])


def measuring_shot(rig: Rig, session: Session, repeats: int | None = None) -> Shot:
    """Exposures that are merged for measurements of light."""
    reference = reference_exposure_s(session)
    longest = rig.profile.camera.exposure_range_s[1]
    exposures = tuple(min(reference * factor, longest) for factor in rig.profile.patterns.exposures)
    return Shot(exposures, rig.profile.patterns.frames_averaged if repeats is None else repeats)


def measure_responses(rig: Rig, session: Session, on_step: OnStep) -> None:
    """Step `response`: black at each exposure, camera response by exposure sweep, projector response by levels."""
    shot = measuring_shot(rig, session, repeats=1)
    levels = _levels(rig.profile.patterns.response_levels)
    settings = {"exposures_s": shot.exposures_s, "sweep": _SWEEP, "levels": levels}
    step = session.step("response", settings=settings, needs=("exposure",))
    if step.done:
        return
    shape = rig.projector.shape
    black = flat(shape, 0, "black")
    reference = reference_exposure_s(session)
    sweep = Shot(tuple(reference * factor for factor in _SWEEP), repeats=2)
    photograph(rig, session, step, [black], Shot(shot.exposures_s, _BLACK_REPEATS), 1, on_step)
    photograph(rig, session, step, [flat(shape, 0, "black-sweep")], Shot(sweep.exposures_s), 1, on_step)
    photograph(rig, session, step, [flat(shape, 255, "white-sweep")], sweep, 1, on_step)
    photograph(rig, session, step, level_patterns(shape, levels), shot, len(levels), on_step)
    photometry = _fit_camera(step, rig.camera.full_scale_dn, reference, shot, sweep)
    photometry = _fit_projector(step, photometry, levels, shot)
    _save(step, photometry)
    step.finish()


def _levels(count: int) -> list[int]:
    """Codes from 0 to 255 in an order that does not rise with time, so that drift does not look like response."""
    codes = np.unique(np.rint(np.linspace(0, 255, count)).astype(int))
    return [int(c) for c in np.concatenate([codes[::2], codes[1::2][::-1]])]


def _samples(step: Step, name: str, stride: int) -> NDArray[np.float64]:
    return step.load_frame(name).pixels[::stride, ::stride, 0].ravel().astype(np.float64)


def _fit_camera(step: Step, full_scale_dn: int, reference_s: float, shot: Shot, sweep: Shot) -> Photometry:
    stride = max(1, round((step.load_frame(frame_name("black")).pixels.size / 6000) ** 0.5))
    exposures = np.array(sweep.exposures_s)
    dark = [_samples(step, frame_name("black-sweep", k), stride) for k in range(len(exposures))]
    offset = np.polyfit(exposures, [d.mean() for d in dark], 1)[1]
    bright = np.array(
        [[_samples(step, frame_name("white-sweep", k, r), stride) for r in (0, 1)] for k in range(len(exposures))]
    )
    response = fit_camera_response(bright.mean(axis=1) - offset, exposures / reference_s, full_scale_dn - offset)
    noise = fit_noise_model(bright[:, 0] - offset, bright[:, 1] - offset, 0.97 * (full_scale_dn - offset))
    bare = Photometry(
        reference_s, float(offset), full_scale_dn, response, response, noise.gain_e_per_dn, noise.read_noise_dn, {}
    )
    table = bare.table()
    black = {
        exposure_s: np.mean(
            [table[step.load_frame(frame_name("black", e, r)).pixels[..., 0]] for r in range(_BLACK_REPEATS)], axis=0
        ).astype(np.float32)
        for e, exposure_s in enumerate(shot.exposures_s)
    }
    return replace(bare, black=black)


def _fit_projector(step: Step, photometry: Photometry, levels: list[int], shot: Shot) -> Photometry:
    """Global light scales with the code's light as direct light does, so every lit pixel is a witness."""
    images = {code: light_of(step, f"level-{code:03d}", shot, photometry).value for code in levels}
    white = images[255]
    lit = white > 0.2 * np.quantile(white, 0.99)
    codes = sorted(images)
    weight = white[lit].astype(np.float64).sum()
    linear = np.array([images[code][lit].astype(np.float64).sum() / weight for code in codes])
    return replace(photometry, projector=fit_projector_response(np.array(codes), linear))


def _save(step: Step, photometry: Photometry) -> None:
    record = {
        "reference_exposure_s": photometry.reference_exposure_s,
        "offset_dn": photometry.offset_dn,
        "full_scale_dn": photometry.full_scale_dn,
        "camera": response_record(photometry.camera),
        "projector": response_record(photometry.projector),
        "gain_e_per_dn": photometry.gain_e_per_dn,
        "read_noise_dn": photometry.read_noise_dn,
        "black_exposures_s": list(photometry.black),
    }
    step.save_image("black", {f"e{k}": image for k, image in enumerate(photometry.black.values())})
    step.save_record("photometry", record)


def load_photometry(session: Session) -> Photometry:
    """The finished step's result."""
    step = session.finished("response")
    record, black = step.load_record("photometry"), step.load_image("black")
    return Photometry(
        record["reference_exposure_s"],
        record["offset_dn"],
        record["full_scale_dn"],
        response_of(record["camera"]),
        response_of(record["projector"]),
        record["gain_e_per_dn"],
        record["read_noise_dn"],
        {exposure_s: black[f"e{k}"] for k, exposure_s in enumerate(record["black_exposures_s"])},
    )
