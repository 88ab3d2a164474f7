"""Black, response curves and colour mixing: step `response`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.radiometry.black_level import fit_black_level
from calibration.radiometry.camera_response import fit_camera_response
from calibration.radiometry.light_groups import LightBesides
from calibration.radiometry.mixing import Mixing, fit_mixing
from calibration.radiometry.mosaic import Mosaic
from calibration.radiometry.photon_transfer import fit_camera_noise
from calibration.radiometry.response import Response, fit_channel_responses
from calibration.structured_light.patterns import Pattern, flat, level_patterns, primary
from rig.capture.rig import Rig
from rig.files.channels import PRIMARIES, image_of, layers
from rig.profile.schema import Profile
from rig.profile.tables import CameraProfile
from rig.records import JsonObject, Record, json_of
from rig.session import Session, Step
from rig.stages.light.black import black_light
from rig.stages.light.exposure import load_exposure, reference_exposure_s
from rig.stages.light.lamp import N_WHITES, lamp_around, take_between_whites, time_of, without_drift
from rig.stages.light.levels import light_of_levels, refuse_disturbed_sweeps, refuse_late_white
from rig.stages.linear_light import (
    BLACK_REPEATS,
    LightImage,
    RadiometricCalibration,
    ResponseRecord,
    merge_exposures,
)
from rig.stages.photograph import ExposureBracket, frame_name, photograph
from rig.terminal import OnStep, part_of

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]

_SWEEP = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 0.75, 1.0, 1.15, 1.35, 1.7, 2.2)
"""Exposures for the camera's response, multiples of the reference. In the longest the brightest pixels clip and do not
count; others reach full scale, so that the curve is measured to its end. Close together there, as few pixels may be
bright; and up to 2.2, as levels behind a tone curve rise slowly: with 1.3 as the last a camera of sRGB was measured up
to 85 to 90 %, and errors of tone curves are three times as large (``benchmarks/calibration/tone_curves.py``)."""
_SWEEPS = ("white-sweep", "white-sweep-back")
"""Two frames of each exposure tell the noise from their difference. The second is taken in the opposite order: a lamp
that gets evenly brighter is then as bright for each exposure, in the mean, and is not taken for the camera's curve."""
_SAMPLES = 12000
"""Pixels of a frame that the camera's curve and noise are fitted to; more change neither by its error."""


@dataclass(frozen=True, kw_only=True)
class CameraRadiometry(Record):
    """How one camera's digital numbers become light."""

    reference_exposure_s: float
    offset_dn: float
    full_scale_dn: int
    response: ResponseRecord
    gain_e_per_dn: float
    read_noise_dn: float
    black_exposures_s: tuple[float, ...]
    """Of the images ``e0``, ``e1`` ... of the camera's black."""
    black_ripple: tuple[float, ...]
    """Standard deviation between frames of black at these exposures, share of its light: room light that flickers."""
    black_repeats: int = BLACK_REPEATS
    """Frames of black at each exposure."""
    black_swell: tuple[float, ...] = ()
    """By what share of its light a mains light changes single frames of black; none in sessions of older versions."""
    white_noise_share: float | None = None
    """Standard deviation of one frame of white, by the median of its light; None in sessions of older versions."""


@dataclass(frozen=True, kw_only=True)
class ProjectorRadiometry(Record):
    """What one projector's codes are as light."""

    responses: tuple[ResponseRecord, ...]
    """A response a channel."""


@dataclass(frozen=True, kw_only=True)
class PairRadiometry(Record):
    """How the channels of one projector appear in the bands of one camera."""

    camera: str
    projector: str
    mixing: tuple[tuple[float, ...], ...]
    """K[b, q]: share of white in band b that channel q makes; rows sum to 1."""
    balance: tuple[float, ...]
    """Factors that make projector white alike in the bands."""
    white_over_channels: tuple[float, ...]
    """Light of white over the sum of the channels' lights, by band."""
    mixing_variation: float
    """Largest difference of the mixing over the picture."""


@dataclass(frozen=True, kw_only=True)
class RadiometricRecord(Record):
    """What step `response` found."""

    cameras: Mapping[str, CameraRadiometry]
    projectors: Mapping[str, ProjectorRadiometry]
    pairs: tuple[PairRadiometry, ...]


def measuring_bracket(session: Session, repeats: int | None = None) -> ExposureBracket:
    """Return the exposures that are merged for measurements of light, each as often as room light that swells asks for.

    Parameters
    ----------
    session
        With step `exposure` finished.
    repeats
        Frames at each exposure, at least; default: ``patterns.frames_averaged`` of the profile.
    """
    found, patterns = load_exposure(session), session.profile.patterns
    longest = session.profile.camera.exposure_range_s[1]
    exposures = tuple(min(found.exposure_s * factor, longest) for factor in patterns.exposures)
    wanted = patterns.frames_averaged if repeats is None else repeats
    return ExposureBracket.blind_to(found.averaged_hz, exposures, wanted)


def averaged_settings(bracket: ExposureBracket) -> JsonObject:
    """Return what a step depends on beside its exposures, where room light swells; nothing in other sessions."""
    return {} if bracket.swell_hz is None else {"averaged_over_hz": bracket.swell_hz}


def response_settings(session: Session) -> JsonObject:
    """Return what step `response` depends on."""
    return {
        "exposures_s": json_of(measuring_bracket(session).exposures_s),
        **averaged_settings(measuring_bracket(session)),
        "sweep": json_of(_SWEEP),
        "levels": json_of(_levels(session.profile.patterns.response_levels)),
        "lamp": "taken out",
    }


def response_frames(profile: Profile) -> int:
    """Return how many frames step `response` takes."""
    patterns = profile.patterns
    pictures = BLACK_REPEATS + patterns.response_levels + N_WHITES + len(PRIMARIES[profile.camera.channels])
    return pictures * len(patterns.exposures) + (1 + len(_SWEEPS)) * len(_SWEEP)


def measure_responses(rig: Rig, session: Session, step: Step, on_step: OnStep) -> None:
    """Step `response`: black, camera response by exposure sweep, projector response by levels.

    With a colour camera also red, green and blue: how they mix, and with it a response for each channel.
    """
    bracket = measuring_bracket(session, repeats=1)
    levels = _levels(rig.profile.patterns.response_levels)
    colours = pure_colours(rig.projector.shape, rig.profile.camera.channels)
    _photograph_responses(rig, session, step, on_step)
    bare = _fit_camera(step, rig.profile.camera, reference_exposure_s(session), _sweep_of(session))
    black = black_light(step, _black_bracket(bracket), bare)
    radiometric = replace(bare, black=black.mean, black_ripple=black.ripple, black_swell=black.swell)
    radiometric = replace(radiometric, black_repeats=_black_bracket(bracket).repeats)
    white = merge_exposures(step, "level-255", bracket, radiometric)
    lit = witnesses(white)
    mixing = _fit_mixing([merge_exposures(step, pattern.name, bracket, radiometric) for pattern in colours], white, lit)
    lamp = lamp_around(step, bracket, radiometric, (white, time_of(step, "level-255", bracket)))
    step.save_record("whites-of-response", lamp)
    names = {f"level-{code:03d}": code for code in levels}

    def light_of(name: str) -> LightImage:
        image = merge_exposures(step, name, bracket, radiometric)
        return without_drift(image, lamp.at(time_of(step, name, bracket)))

    light = light_of_levels({name: partial(light_of, name) for name in names}, white, lit)
    sums = {code: light[name] for name, code in names.items()}
    radiometric = replace(radiometric, mixing=mixing.matrix, balance=_balance(white, lit))
    noise_share = _noise_share(white, lit, bracket.repeats)
    _save(step, rig.profile, replace(radiometric, projector=_responses(sums, mixing)), mixing, noise_share=noise_share)


def _sweep_of(session: Session) -> ExposureBracket:
    """As far as the camera goes: the longest always differs from the shortest, or the reference is at its limit."""
    reference, (shortest, longest) = reference_exposure_s(session), session.profile.camera.exposure_range_s
    within = sorted({min(max(reference * factor, shortest), longest) for factor in _SWEEP})
    return ExposureBracket.blind_to(load_exposure(session).averaged_hz, tuple(within))


def _black_bracket(bracket: ExposureBracket) -> ExposureBracket:
    """How black is photographed, for pictures that are photographed so."""
    return ExposureBracket.blind_to(bracket.swell_hz, bracket.exposures_s, BLACK_REPEATS)


def _photograph_responses(rig: Rig, session: Session, step: Step, on_step: OnStep) -> None:
    shape, bracket, sweep = rig.projector.shape, measuring_bracket(session, repeats=1), _sweep_of(session)
    levels = _levels(rig.profile.patterns.response_levels)
    sets: list[tuple[list[Pattern], ExposureBracket, int]] = [
        ([flat(shape, 0, "black")], _black_bracket(bracket), 0),
        ([flat(shape, 0, "black-sweep")], sweep, 0),
        ([flat(shape, 255, name) for name in _SWEEPS], sweep, 0),
        (list(level_patterns(shape, levels)), bracket, N_WHITES),
        (pure_colours(shape, rig.profile.camera.channels), bracket, 0),
    ]
    total, before = sum((len(patterns) + whites) * how.frames_per_pattern for patterns, how, whites in sets), 0
    for patterns, how, whites in sets:
        n_patterns, counted = len(patterns) + whites, part_of(on_step, before, total)
        take = partial(photograph, rig, session, step, bracket=how, n_patterns=n_patterns, on_step=counted)
        take_between_whites(take, patterns, shape, counted) if whites else take(patterns)
        before += n_patterns * how.frames_per_pattern


def pure_colours(shape: tuple[int, int], channels: int) -> list[Pattern]:
    """Flat pictures of each of the projector's channels; none for a grey camera."""
    return [primary(shape, channel, name, channels) for channel, name in enumerate(PRIMARIES[channels])]


def mosaic_of(camera: CameraProfile) -> Mosaic | None:
    """Return the colour filters of a camera whose frames have one number a pixel; None of any other."""
    return None if camera.mosaic is None else Mosaic(camera.mosaic)


def _levels(count: int) -> list[int]:
    """Codes from 0 to 255 in an order that does not rise with time, so that drift does not look like response."""
    codes = np.unique(np.rint(np.linspace(0, 255, count)).astype(int))
    return [int(c) for c in np.concatenate([codes[::2], codes[1::2][::-1]])]


def _samples(step: Step, name: str, stride: int) -> tuple[FloatArray, float]:
    """Some pixels of a frame, and its exposure."""
    frame = step.load_frame(name)
    return frame.pixels[::stride, ::stride].ravel().astype(np.float64), frame.exposure_s


def _sweep_samples(
    step: Step, patterns: Sequence[str], sweep: ExposureBracket, stride: int
) -> tuple[FloatArray, FloatArray]:
    """(F, R, N) levels of the repeats of some pictures' frames, and their (F,) exposures."""
    pictures = [(pattern, k) for k in range(len(sweep.exposures_s)) for pattern in patterns]
    frames = [
        [_samples(step, frame_name(pattern, k, repeat), stride) for repeat in range(sweep.repeats)]
        for pattern, k in pictures
    ]
    return np.array([[level for level, _ in each] for each in frames]), np.array([each[0][1] for each in frames])


def _fit_camera(
    step: Step, camera: CameraProfile, reference_s: float, sweep: ExposureBracket
) -> RadiometricCalibration:
    """Fit the camera's response and noise; black, projector and mixing are still missing."""
    shape = step.load_frame(frame_name("black")).pixels.shape
    stride = max(1, round((np.prod(shape) / _SAMPLES) ** 0.5))
    dark, exposures = _sweep_samples(step, ["black-sweep"], sweep, stride)
    black = fit_black_level(dark.mean(axis=1), exposures)
    levels, exposures = _sweep_samples(step, _SWEEPS, sweep, stride)
    above, top = levels - black.offset_dn, camera.full_scale_dn - black.offset_dn
    places = [len(range(0, n, stride)) for n in shape[:2]]
    refuse_late_white(levels.mean(axis=1), dark.mean(axis=1))
    refuse_disturbed_sweeps(above.mean(axis=1).reshape(len(above), *places, -1).mean(axis=-1), exposures, top)
    room = LightBesides(dark=dark[-1].mean(axis=0) - black.offset_dn, in_step=black.in_step)
    response = fit_camera_response(above.mean(axis=1), exposures, top, black_dn=black.offset_dn, room=room)
    noise = fit_camera_noise(above[:, 0], exposures, response)
    return RadiometricCalibration(
        reference_exposure_s=reference_s,
        offset_dn=black.offset_dn,
        full_scale_dn=camera.full_scale_dn,
        camera=response,
        projector=(),
        gain_e_per_dn=noise.gain_e_per_dn,
        read_noise_dn=noise.read_noise_dn,
        black={},
        mixing=np.eye(camera.channels),
        balance=np.ones(camera.channels),
        mosaic=mosaic_of(camera),
    )


def witnesses(white: LightImage) -> BoolArray:
    """(H, W) pixels whose light tells the projector's curve: bright in each band, and not clipped.

    A small glare may clip (:func:`calibration.radiometry.exposure.brightest_share`), and has much of all light: taken
    for its light, full scale would make a projector's curve too high between black and white.

    Raises
    ------
    CalibrationError
        If no pixel is left.
    """
    light = white.value.mean(axis=-1)
    bright = (light > 0.2 * np.quantile(light, 0.99)) & (white.value > 0).all(axis=-1)
    chosen = np.asarray(bright & ~white.any_saturated)
    if not chosen.any():
        raise CalibrationError(
            f"projector response: none of the {int(bright.sum())} lit pixels is below the camera's full scale at the "
            "shortest exposure: set a shorter camera.exposure_range_s, close the aperture, or dim the projector"
        )
    return chosen


def _noise_share(white: LightImage, lit: BoolArray, repeats: int) -> float:
    """Noise of one frame of white at the witnesses, root mean square, by the median of white there."""
    return float(np.sqrt(repeats * white.variance[lit].mean()) / np.median(white.value[lit]))


def _fit_mixing(pure: list[LightImage], white: LightImage, lit: BoolArray) -> Mixing:
    """Of a grey rig: white is all that there is."""
    if not pure:
        return Mixing(np.eye(1), np.ones(1), 0.0)
    usable = lit & ~np.any([image.any_saturated for image in pure], axis=0)
    return fit_mixing(white.value, [image.value for image in pure], usable)


def _balance(white: LightImage, lit: BoolArray) -> FloatArray:
    medians = np.array([np.median(band[lit]) for band in np.moveaxis(white.value, -1, 0)], np.float64)
    return np.asarray(medians.mean() / medians)


def _responses(sums: dict[int, FloatArray], mixing: Mixing) -> tuple[Response, ...]:
    """Global light scales with the code's light as direct light does, so every lit pixel is a witness."""
    codes = np.array(sorted(sums))
    return fit_channel_responses(codes, np.array([sums[code] / sums[255] for code in codes]), mixing.matrix)


def _save(
    step: Step, profile: Profile, radiometric: RadiometricCalibration, mixing: Mixing, *, noise_share: float
) -> None:
    black: dict[str, NDArray[np.generic]] = {}
    for k, image in enumerate(radiometric.black.values()):
        black |= layers(f"e{k}", image)
    step.save_image("black", black)
    camera = CameraRadiometry(
        reference_exposure_s=radiometric.reference_exposure_s,
        offset_dn=radiometric.offset_dn,
        full_scale_dn=radiometric.full_scale_dn,
        response=ResponseRecord.of(radiometric.camera),
        gain_e_per_dn=radiometric.gain_e_per_dn,
        read_noise_dn=radiometric.read_noise_dn,
        black_exposures_s=tuple(radiometric.black),
        black_ripple=tuple(radiometric.black_ripple.values()),
        black_repeats=radiometric.black_repeats,
        black_swell=tuple(radiometric.black_swell.values()),
        white_noise_share=noise_share,
    )
    pair = PairRadiometry(
        camera=profile.camera.name,
        projector=profile.projector.name,
        mixing=tuple(tuple(row) for row in mixing.matrix.tolist()),
        balance=tuple(radiometric.balance.tolist()),
        white_over_channels=tuple(mixing.white_over_channels.tolist()),
        mixing_variation=mixing.variation,
    )
    responses = tuple(ResponseRecord.of(response) for response in radiometric.projector)
    record = RadiometricRecord(
        cameras={pair.camera: camera},
        projectors={pair.projector: ProjectorRadiometry(responses=responses)},
        pairs=(pair,),
    )
    step.save_record("radiometric", record)


def load_radiometric_calibration(session: Session) -> RadiometricCalibration:
    """Return what the finished step `response` found."""
    step = session.finished("response")
    record, black = step.load_record("radiometric", RadiometricRecord), step.load_image("black")
    camera, pair = record.cameras[session.profile.camera.name], record.pairs[0]
    projector = record.projectors[pair.projector]
    return RadiometricCalibration(
        reference_exposure_s=camera.reference_exposure_s,
        offset_dn=camera.offset_dn,
        full_scale_dn=camera.full_scale_dn,
        camera=camera.response.response(),
        projector=tuple(response.response() for response in projector.responses),
        gain_e_per_dn=camera.gain_e_per_dn,
        read_noise_dn=camera.read_noise_dn,
        black={exposure_s: image_of(black, f"e{k}") for k, exposure_s in enumerate(camera.black_exposures_s)},
        black_ripple=dict(zip(camera.black_exposures_s, camera.black_ripple, strict=True)),
        black_repeats=camera.black_repeats,
        black_swell=dict(zip(camera.black_exposures_s, camera.black_swell, strict=False)),
        mixing=np.array(pair.mixing),
        balance=np.array(pair.balance),
        mosaic=mosaic_of(session.profile.camera),
    )
