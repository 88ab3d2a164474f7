"""Reference exposure, black, response curves and colour mixing: steps `exposure` and `response`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.exposure import ExposureAim, brightest_share, next_exposure, refuse_darkness
from calibration.radiometry.mixing import Mixing, fit_mixing
from calibration.radiometry.photon_transfer import fit_photon_transfer, transfer_points
from calibration.radiometry.response import Response, fit_camera_response, fit_channel_responses
from calibration.structured_light.patterns import Pattern, flat, level_patterns, primary
from rig.capture.rig import Rig
from rig.files.channels import PRIMARIES, by_band, image_of, layers, of_bands
from rig.session import Session, Step
from rig.stages.linear_light import LightImage, RadiometricCalibration, merge_exposures, response_of, response_record
from rig.stages.photograph import ExposureBracket, frame_name, photograph, shoot_one
from rig.terminal import OnStep

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]

_AIM = ExposureAim(share=0.85, accepted=(0.9 * 0.85, 1.06 * 0.85))
"""Of the brightest permille of projector white: the sweep goes to 1.1 times this exposure and must not clip."""
_SWEEP = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 0.75, 1.0, 1.1)
"""Exposures for the camera's response, multiples of the reference."""
_BLACK_REPEATS = 4
_MAX_TRIES = 10


def find_exposure(rig: Rig, session: Session, on_step: OnStep) -> None:
    """Step `exposure`: projector white just below saturation."""
    step = session.step("exposure", settings={"aim": _AIM.share, "start_s": rig.profile.camera.exposure_s})
    if step.done:
        return
    white = flat(rig.projector.shape, 255, "white")
    exposure_s = rig.profile.camera.exposure_s
    for attempt in range(_MAX_TRIES):
        on_step("photograph: exposure", attempt, _MAX_TRIES)
        name = frame_name("white", attempt)
        if not step.has_frame(name):
            shoot_one(rig, session, step, white, name, exposure_s)
        level = brightest_share(step.load_frame(name).pixels, rig.camera.full_scale_dn)
        chosen_s = next_exposure(exposure_s, level, _AIM, rig.profile.camera.exposure_range_s)
        if chosen_s is None:
            break
        exposure_s = chosen_s
    on_step("photograph: exposure", _MAX_TRIES, _MAX_TRIES)
    _refuse_darkness(rig, session, step, exposure_s, frame_name("white", attempt))
    step.save_record("exposure", {"exposure_s": exposure_s, "brightest_share_of_full_scale": level})
    step.finish()


def _refuse_darkness(rig: Rig, session: Session, step: Step, exposure_s: float, white_name: str) -> None:
    name = frame_name("black")
    if not step.has_frame(name):
        shoot_one(rig, session, step, flat(rig.projector.shape, 0, "black"), name, exposure_s)
    white, black = (step.load_frame(n).pixels for n in (white_name, name))
    refuse_darkness(white, black, full_scale_dn=rig.camera.full_scale_dn, exposure_s=exposure_s)


def reference_exposure_s(session: Session) -> float:
    """The session's reference exposure."""
    return float(session.finished("exposure").load_record("exposure")["exposure_s"])


def measuring_bracket(rig: Rig, session: Session, repeats: int | None = None) -> ExposureBracket:
    """Exposures that are merged for measurements of light."""
    reference = reference_exposure_s(session)
    longest = rig.profile.camera.exposure_range_s[1]
    exposures = tuple(min(reference * factor, longest) for factor in rig.profile.patterns.exposures)
    return ExposureBracket(exposures, rig.profile.patterns.frames_averaged if repeats is None else repeats)


def measure_responses(rig: Rig, session: Session, on_step: OnStep) -> None:
    """Step `response`: black, camera response by exposure sweep, projector response by levels.

    With a colour camera also red, green and blue: how they mix, and with it a response for each channel.
    """
    shot = measuring_bracket(rig, session, repeats=1)
    levels = _levels(rig.profile.patterns.response_levels)
    settings = {"exposures_s": shot.exposures_s, "sweep": _SWEEP, "levels": levels}
    step = session.step("response", settings=settings, needs=("exposure",))
    if step.done:
        return
    shape = rig.projector.shape
    black = flat(shape, 0, "black")
    reference = reference_exposure_s(session)
    sweep = ExposureBracket(tuple(reference * factor for factor in _SWEEP), repeats=2)
    photograph(rig, session, step, [black], ExposureBracket(shot.exposures_s, _BLACK_REPEATS), 1, on_step)
    photograph(rig, session, step, [flat(shape, 0, "black-sweep")], ExposureBracket(sweep.exposures_s), 1, on_step)
    photograph(rig, session, step, [flat(shape, 255, "white-sweep")], sweep, 1, on_step)
    photograph(rig, session, step, level_patterns(shape, levels), shot, len(levels), on_step)
    colours = pure_colours(shape, rig.camera.shape[2])
    photograph(rig, session, step, colours, shot, len(colours), on_step)
    radiometric = _fit_camera(step, rig.camera.full_scale_dn, reference, shot, sweep)
    white = merge_exposures(step, "level-255", shot, radiometric)
    lit = _lit(white)
    mixing = _fit_mixing([merge_exposures(step, pattern.name, shot, radiometric) for pattern in colours], white, lit)
    sums = {code: _sums(merge_exposures(step, f"level-{code:03d}", shot, radiometric), lit) for code in levels}
    radiometric = replace(radiometric, mixing=mixing.matrix, balance=_balance(white, lit))
    _save(step, replace(radiometric, projector=_responses(sums, mixing)), mixing)
    step.finish()


def pure_colours(shape: tuple[int, int], channels: int) -> list[Pattern]:
    """Flat pictures of each of the projector's channels; none for a grey camera."""
    return [primary(shape, channel, name, channels) for channel, name in enumerate(PRIMARIES[channels])]


def _levels(count: int) -> list[int]:
    """Codes from 0 to 255 in an order that does not rise with time, so that drift does not look like response."""
    codes = np.unique(np.rint(np.linspace(0, 255, count)).astype(int))
    return [int(c) for c in np.concatenate([codes[::2], codes[1::2][::-1]])]


def _samples(step: Step, name: str, stride: int) -> NDArray[np.float64]:
    return step.load_frame(name).pixels[::stride, ::stride].ravel().astype(np.float64)


def _fit_camera(
    step: Step, full_scale_dn: int, reference_s: float, shot: ExposureBracket, sweep: ExposureBracket
) -> RadiometricCalibration:
    stride = max(1, round((step.load_frame(frame_name("black")).pixels.size / 6000) ** 0.5))
    exposures = np.array(sweep.exposures_s)
    dark = [_samples(step, frame_name("black-sweep", k), stride) for k in range(len(exposures))]
    offset = np.polyfit(exposures, [d.mean() for d in dark], 1)[1]
    bright = np.array(
        [[_samples(step, frame_name("white-sweep", k, r), stride) for r in (0, 1)] for k in range(len(exposures))]
    )
    response = fit_camera_response(bright.mean(axis=1) - offset, exposures / reference_s, full_scale_dn - offset)
    above = bright - offset
    points = transfer_points(above[:, 0], above[:, 1], range_dn=(0.0, 0.97 * (full_scale_dn - offset)))
    noise = fit_photon_transfer(points, rounds=0)
    bands = step.load_frame(frame_name("black")).pixels.shape[2]
    bare = RadiometricCalibration(
        reference_s,
        float(offset),
        full_scale_dn,
        response,
        (),
        noise.gain_e_per_dn,
        noise.read_noise_dn,
        {},
        np.eye(bands),
        np.ones(bands),
    )
    table = bare.table()
    black = {
        exposure_s: np.mean(
            [table[step.load_frame(frame_name("black", e, r)).pixels] for r in range(_BLACK_REPEATS)], axis=0
        ).astype(np.float32)
        for e, exposure_s in enumerate(shot.exposures_s)
    }
    return replace(bare, black=black)


def _lit(white: LightImage) -> BoolArray:
    """(H, W) pixels bright enough to be witnesses, and bright in each band."""
    light = white.value.mean(axis=-1)
    return np.asarray((light > 0.2 * np.quantile(light, 0.99)) & (white.value > 0).all(axis=-1))


def _fit_mixing(pure: list[LightImage], white: LightImage, lit: BoolArray) -> Mixing:
    """Of a grey rig: white is all that there is."""
    if not pure:
        return Mixing(np.eye(1), np.ones(1), 0.0)
    usable = lit & ~white.any_saturated & ~np.any([image.any_saturated for image in pure], axis=0)
    return fit_mixing(white.value, [image.value for image in pure], usable)


def _balance(white: LightImage, lit: BoolArray) -> FloatArray:
    medians = np.array([np.median(band[lit]) for band in np.moveaxis(white.value, -1, 0)], np.float64)
    return np.asarray(medians.mean() / medians)


def _responses(sums: dict[int, FloatArray], mixing: Mixing) -> tuple[Response, ...]:
    """Global light scales with the code's light as direct light does, so every lit pixel is a witness."""
    codes = np.array(sorted(sums))
    return fit_channel_responses(codes, np.array([sums[code] / sums[255] for code in codes]), mixing.matrix)


def _sums(image: LightImage, lit: BoolArray) -> FloatArray:
    """(B,) light of all lit pixels together."""
    bands = np.moveaxis(image.value, -1, 0)
    return np.array([band[lit].astype(np.float64).sum() for band in bands])


def _save(step: Step, radiometric: RadiometricCalibration, mixing: Mixing) -> None:
    record = {
        "reference_exposure_s": radiometric.reference_exposure_s,
        "offset_dn": radiometric.offset_dn,
        "full_scale_dn": radiometric.full_scale_dn,
        "camera": response_record(radiometric.camera),
        "projector": by_band([response_record(response) for response in radiometric.projector]),
        "gain_e_per_dn": radiometric.gain_e_per_dn,
        "read_noise_dn": radiometric.read_noise_dn,
        "black_exposures_s": list(radiometric.black),
        **_colour_record(radiometric, mixing),
    }
    black: dict[str, NDArray[Any]] = {}
    for k, image in enumerate(radiometric.black.values()):
        black |= layers(f"e{k}", image)
    step.save_image("black", black)
    step.save_record("radiometric", record)


def _colour_record(radiometric: RadiometricCalibration, mixing: Mixing) -> dict[str, Any]:
    """What only a colour camera tells."""
    if len(radiometric.balance) == 1:
        return {}
    return {
        "mixing": mixing.matrix,
        "balance": radiometric.balance,
        "white_over_channels": mixing.white_over_channels,
        "mixing_variation": mixing.variation,
    }


def load_radiometric_calibration(session: Session) -> RadiometricCalibration:
    """The finished step's result."""
    step = session.finished("response")
    record, black = step.load_record("radiometric"), step.load_image("black")
    balance = np.array(record.get("balance", [1.0]))
    return RadiometricCalibration(
        record["reference_exposure_s"],
        record["offset_dn"],
        record["full_scale_dn"],
        response_of(record["camera"]),
        tuple(response_of(each) for each in of_bands(record["projector"], len(balance))),
        record["gain_e_per_dn"],
        record["read_noise_dn"],
        {exposure_s: image_of(black, f"e{k}") for k, exposure_s in enumerate(record["black_exposures_s"])},
        np.array(record.get("mixing", [[1.0]])),
        balance,
    )
