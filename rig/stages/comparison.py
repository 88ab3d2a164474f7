"""Project, photograph, compare: steps `project` and `compare`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.structured_light.patterns import Pattern
from rig.capture.rig import Rig
from rig.files.channels import codes_of, image_of, layers
from rig.profile.schema import Profile
from rig.records import JsonObject, Record, json_of
from rig.session import Session, Step
from rig.stages.compensation import load_compensation
from rig.stages.light.lamp import N_WHITES, lamp_of, take_between_whites, time_of, without_drift
from rig.stages.light.repeats import comparing_bracket
from rig.stages.linear_light import LightImage, RadiometricCalibration, merge_exposures
from rig.stages.model import FittedScene, load_model, simulated_white
from rig.stages.photograph import ExposureBracket, photograph
from rig.stages.picture_errors import PictureErrors, picture_errors
from rig.stages.prediction import JUDGED, JudgedPixels, Prediction, judged_pixels, predict
from rig.stages.radiometry import averaged_settings
from rig.stages.separation import calibration_of_pictures
from rig.terminal import OnStep

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_HELD_OUT = 2
"""How many pictures :func:`held_out_patterns` has."""


@dataclass(frozen=True, kw_only=True)
class ModelErrors(Record):
    """Measured minus predicted light, in grey levels of 255."""

    rmse: float
    bias: float
    within_3_sigma: float
    """Share of the pixels within three standard deviations of noise and model together."""
    noise_rms: float
    """What the photograph's noise, and that of the white that the model was made from, let expect."""
    sigma_rms: float
    """What noise and the model's own uncertainty let expect."""


@dataclass(frozen=True, kw_only=True)
class StrategyErrors(Record):
    """How far a strategy's picture is from the target."""

    measured: PictureErrors
    predicted: PictureErrors


@dataclass(frozen=True, kw_only=True)
class ComparisonRecord(Record):
    """What step `compare` found, beside its images."""

    overall: ModelErrors
    frames: Mapping[str, ModelErrors]
    """By strategy, and by held-out picture."""
    strategies: Mapping[str, StrategyErrors]


def held_out_patterns(shape: tuple[int, int]) -> list[Pattern]:
    """Return pictures that nothing was fitted to: one half white (interreflection across the corner), soft blobs."""
    height, width = shape
    half = np.zeros(shape, dtype=np.uint8)
    half[:, : width // 2] = 255
    noise = np.random.default_rng(12).uniform(size=(6, 8)).astype(np.float32)
    blobs = cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
    return [
        Pattern("held-out-half", half),
        Pattern("held-out-blobs", np.clip(255 * blobs, 0, 255).astype(np.uint8)),
    ]


def project_settings(session: Session) -> JsonObject:
    """Return what step `project` depends on."""
    bracket = comparing_bracket(session)
    exposures = {"exposures_s": json_of(bracket.exposures_s), "repeats": bracket.repeats, "between": "whites"}
    return exposures | averaged_settings(bracket)


def frames_per_picture(profile: Profile) -> int:
    """Return how many frames step `project` takes of each picture."""
    return len(profile.patterns.exposures) * profile.patterns.frames_averaged


def held_out_frames(profile: Profile) -> int:
    """Return how many frames step `project` takes beside those of the strategies."""
    return (_HELD_OUT + N_WHITES) * frames_per_picture(profile)


def extra_frames(session: Session, n_strategies: int) -> int:
    """Return how many more noise and room light ask for than a profile says."""
    more = comparing_bracket(session).frames_per_pattern - frames_per_picture(session.profile)
    return (n_strategies + _HELD_OUT + N_WHITES) * more


def project_and_photograph(rig: Rig, session: Session, step: Step, on_step: OnStep) -> None:
    """Step `project`: show every compensation image and the held-out pictures, and photograph them.

    Between two whites, which tell how bright the lamp was; a recording of before there were any is taken as it is.
    """
    compensated, names = session.finished("compensate"), load_compensation(session).strategies
    shown = [Pattern(f"shown-{name}", codes_of(compensated.load_image(f"projector-{name}"))) for name in names]
    patterns = [*shown, *held_out_patterns(rig.projector.shape)]
    bracket, n_patterns = comparing_bracket(session), len(patterns) + N_WHITES
    _say(bracket.repeats, session.profile, on_step)
    take = partial(photograph, rig, session, step, bracket=bracket, n_patterns=n_patterns, on_step=on_step)
    take_between_whites(take, patterns, rig.projector.shape, on_step)
    step.save_record("shot", bracket)


def _say(repeats: int, profile: Profile, on_step: OnStep) -> None:
    """Tell that pictures are photographed more often than was asked for."""
    if repeats > profile.patterns.frames_averaged:
        on_step(f"each picture is photographed {repeats} times, for one photograph is noisy", 1, 1)


@dataclass(frozen=True, eq=False)
class _Residuals:
    """One frame's measured minus predicted light over the pixels that count; deviations by noise, and in all."""

    difference: FloatArray
    noise: FloatArray
    sigma: FloatArray

    def errors(self) -> ModelErrors:
        return ModelErrors(
            rmse=float(np.sqrt((self.difference**2).mean())),
            bias=float(self.difference.mean()),
            within_3_sigma=float((np.abs(self.difference) <= 3 * self.sigma).mean()),
            noise_rms=float(np.sqrt((self.noise**2).mean())),
            sigma_rms=float(np.sqrt((self.sigma**2).mean())),
        )


def comparison_settings(_: Session) -> JsonObject:
    """Return what step `compare` depends on."""
    return {"sigma": "of noise, processing and model", "judged": JUDGED, "lamp": "taken out"}


def compare_all(session: Session, step: Step, on_step: OnStep) -> None:
    """Step `compare`: errors against the target for each strategy, against the prediction for every frame."""
    model, judged = load_model(session), judged_pixels(load_model(session), session.finished("compensate"))
    names, radiometric = list(load_compensation(session).strategies), calibration_of_pictures(session)
    projected = session.finished("project")
    bracket = projected.load_record("shot", ExposureBracket)
    counted = _counted(judged.mask, radiometric)
    held_out = held_out_patterns(model.scene_model.projector.lens.shape)
    total, lamp = len(names) + len(held_out), lamp_of(projected, bracket, radiometric, _white_of(session))

    def photographed(picture: str) -> LightImage:
        image = merge_exposures(projected, picture, bracket, radiometric)
        return without_drift(image, lamp.at(time_of(projected, picture, bracket)))

    strategies: dict[str, StrategyErrors] = {}
    residuals: dict[str, _Residuals] = {}
    for k, name in enumerate(names):
        on_step("compare measured and simulated", k, total)
        measured = photographed(f"shown-{name}")
        predicted = _predicted(session, name)
        strategies[name] = StrategyErrors(
            measured=_against_target(measured.value.astype(np.float64), judged, model.level),
            predicted=_against_target(predicted.light, judged, model.level),
        )
        step.save_image(f"measured-{name}", measured.channels)
        residuals[name] = _residuals(measured, predicted, counted, model)
    for k, pattern in enumerate(held_out, start=len(names)):
        on_step("compare measured and simulated", k, total)
        measured = photographed(pattern.name)
        predicted = predict(model, radiometric, pattern.codes)
        step.save_image(f"measured-{pattern.name}", measured.channels)
        step.save_image(f"predicted-{pattern.name}", predicted.channels)
        residuals[pattern.name] = _residuals(measured, predicted, counted, model)
    on_step("compare measured and simulated", total, total)
    step.save_record("lamp", lamp)
    _save(step, model, judged, strategies, residuals=residuals)


def _white_of(session: Session) -> LightImage:
    """The white that the model is of."""
    image = session.finished("separation").load_image("separation")
    value, variance = image_of(image, "white"), image_of(image, "white_variance")
    return LightImage(value, variance, np.zeros(value.shape, dtype=bool))


def _predicted(session: Session, name: str) -> Prediction:
    """What was predicted of a strategy's picture."""
    image = session.finished("compensate").load_image(f"predicted-{name}")
    return Prediction(*(image_of(image, part).astype(np.float64) for part in ("light", "sigma")))


def _against_target(light: FloatArray, judged: JudgedPixels, level: float) -> PictureErrors:
    """Errors in grey levels on the session's brightness scale."""
    return picture_errors(light * 255 / level, judged.target, judged.mask)


def _counted(mask: BoolArray, radiometric: RadiometricCalibration) -> BoolArray:
    """(H, W, B) numbers that count: of a mosaic only what a pixel saw itself, for what is between them is guessed."""
    whole = np.repeat(mask[..., None], len(radiometric.balance), axis=2)
    if radiometric.mosaic is None:
        return whole
    own = radiometric.mosaic.bands(mask.shape)[..., None] == np.arange(whole.shape[2])
    return np.asarray(whole & own)


def _residuals(measured: LightImage, predicted: Prediction, counted: BoolArray, model: FittedScene) -> _Residuals:
    """Measured minus predicted on one frame, over all bands, in grey levels."""
    scale = 255 / model.level
    usable = counted & ~measured.any_saturated[..., None]
    light = predicted.light[usable]
    # The model's direct light was measured too: its noise is part of what is to be expected.
    relative = model.white_variance[usable] / np.maximum(model.white[usable], 1e-6) ** 2
    noise = np.sqrt(measured.variance[usable] + light**2 * relative)
    sigma = np.sqrt(measured.variance[usable] + predicted.sigma[usable] ** 2)
    return _Residuals((measured.value[usable] - light) * scale, noise * scale, sigma * scale)


def _save(
    step: Step,
    model: FittedScene,
    judged: JudgedPixels,
    strategies: Mapping[str, StrategyErrors],
    *,
    residuals: Mapping[str, _Residuals],
) -> None:
    direct, global_ = simulated_white(model.room)
    step.save_image("simulated-white", layers("direct", direct) | layers("global", global_))
    maps = {"mask": judged.mask.astype(np.float32), **layers("target", np.nan_to_num(judged.target))}
    step.save_image("judged", maps, folder="maps")
    together = _Residuals(
        np.concatenate([frame.difference for frame in residuals.values()]),
        np.concatenate([frame.noise for frame in residuals.values()]),
        np.concatenate([frame.sigma for frame in residuals.values()]),
    )
    record = ComparisonRecord(
        overall=together.errors(),
        frames={name: frame.errors() for name, frame in residuals.items()},
        strategies=strategies,
    )
    step.save_record("comparison", record)


def load_comparison(session: Session) -> ComparisonRecord:
    """Return what the finished step `compare` found."""
    return session.finished("compare").load_record("comparison", ComparisonRecord)
