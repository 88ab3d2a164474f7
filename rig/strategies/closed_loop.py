"""Close the loop over a strategy: show, photograph, correct, until the measured error no longer falls."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.structured_light.patterns import Pattern
from rig.errors import UsageError
from rig.files.channels import code_layers, layers
from rig.run.session import OpenSession
from rig.session import Session, Step
from rig.stages.compensation import measured_options, solve, versions_of
from rig.stages.linear_light import LightImage, RadiometricCalibration, channel_codes, channel_light, merge_exposures
from rig.stages.maps.sampling import sample_bands
from rig.stages.model import FittedScene, load_model
from rig.stages.photograph import ExposureBracket, photograph
from rig.stages.picture_errors import contrast, perceived_errors
from rig.stages.prediction import JUDGED, JudgedPixels, judged_pixels, wanted_light, whole_picture
from rig.stages.radiometry import measuring_bracket
from rig.stages.separation import calibration_of_pictures
from rig.stages.showing.dark import dark_settings
from rig.stages.target import Target, check_strategies
from rig.stages.transport.earlier import keep_evidence
from rig.stages.transport.evidence import model_steps
from rig.stages.transport.held_out import ShownPictures
from rig.strategies.records import ClosedLoop, JudgedErrors
from rig.terminal import OnStep, silent
from sim.compensation import Compensation
from sim.compensation.spectrum import damping_for
from sim.compensation.split_transport import SplitTransport as Operator
from sim.compensation.split_transport import split_transport_of
from sim.light.colour import ColourTransport

FloatArray = NDArray[np.float64]
Codes = NDArray[np.uint8]

MOST_CAPTURES = 64
NEIGHBOURHOOD_PX = 9
"""Side of the square over which a residual is held against its noise."""
SIGMAS = 2.0
"""The error has fallen when it is lower by so many standard deviations of its noise."""
_NO_BETTER = ("no better than capture {}", "better than capture {} by less than its noise")
"""Why a loop ends: the last capture was not lower than the best before, or was, by little."""


@dataclass(frozen=True, slots=True)
class Loop:
    """What is to be closed, and how."""

    strategy: str
    captures: int = 4
    """Most pictures that are photographed, the uncorrected one included."""
    rule: str = "image"
    """A key of ``RULES``."""

    def checked(self) -> Loop:
        """Itself. Raises UsageError for a strategy or rule that is not known, or an impossible number."""
        check_strategies((self.strategy,))
        if self.rule not in RULES:
            raise UsageError(f"unknown rule {self.rule!r} of the closed loop; there are {', '.join(RULES)}")
        if not 1 <= self.captures <= MOST_CAPTURES:
            raise UsageError(f"{self.captures} captures; a closed loop takes 1 ... {MOST_CAPTURES}")
        return self


@dataclass(frozen=True, eq=False, kw_only=True)
class ControlledScene:
    """The room as the model knows it, in the projector's view: n steered pixels, light in camera values."""

    model: FittedScene
    radiometric: RadiometricCalibration
    transport: ColourTransport
    view: JudgedPixels
    wanted: FloatArray
    """(n, B) the target."""

    @cached_property
    def operator(self) -> Operator:
        """T taken apart."""
        return split_transport_of(self.transport)

    @cached_property
    def damping(self) -> float:
        """2 / (2 + r), r the spectral radius of the global light over the direct: as fast as is safe."""
        return damping_for(self.operator, "closed loop", None)[0]

    def solved(self, strategy: str, wanted: FloatArray) -> Compensation:
        """A strategy for a target (n, B), told what the session has measured of noise and brightness."""
        options = measured_options(self.model).get(strategy, {})
        return solve(strategy, self.transport, wanted, **options)

    def judged(self, light: FloatArray) -> JudgedErrors:
        """All errors of a camera image (H, W, B) in camera values."""
        return judged_errors(light * 255 / self.model.level, self.view.target, self.view.mask)

    def judged_light(self, light: LightImage) -> JudgedErrors:
        """All errors of a photograph, the camera's noise in it (rms), and that of the mean error; grey levels."""
        mask, scale = self.view.mask, 255 / self.model.level
        noise = float(np.sqrt(light.variance[mask].mean(dtype=np.float64))) * scale
        found = self.judged(light.value.astype(np.float64))
        n_values = mask.sum() * self.model.channels
        return replace(found, noise_rms=noise, mean_sigma=noise / float(np.sqrt(n_values)))

    def codes(self, image: FloatArray, seed: int) -> Codes:
        """Codes of n projector values a channel, (n, B); pixels that are not steered stay black."""
        return channel_codes(self.radiometric.projector, whole_picture(self.model, image), seed)

    def linear(self, codes: Codes) -> FloatArray:
        """(n, B) light of codes."""
        light = channel_light(self.radiometric.projector, codes).reshape(-1, self.model.channels)
        return light[self.model.room.active].astype(np.float64)

    def seen(self, image: FloatArray) -> FloatArray:
        """(n, B) a camera image (H, W, B) at the steered pixels; NaN where it is not judged."""
        # Light may be 0 or, by noise, below: shift so that `sample` does not take it for missing.
        shifted = np.where(self.view.mask[..., None], image + 1.0, 0.0)
        seen = sample_bands(shifted, self.model.scene_model.camera_xy_px) - 1.0
        return np.asarray(seen[self.model.room.active])


def judged_errors(shown: FloatArray, wanted: FloatArray, mask: NDArray[np.bool_]) -> JudgedErrors:
    """All errors of a picture in grey levels; :mod:`rig.stages.picture_errors` says what is compared."""
    return JudgedErrors(**vars(perceived_errors(shown, wanted, mask)), contrast=contrast(shown, wanted, mask))


@dataclass(frozen=True, eq=False)
class CapturedLight:
    """One capture, at the steered pixels, (n, B) each."""

    projected: FloatArray
    light: FloatArray
    """NaN where it is not judged."""
    variance: FloatArray


def close_loop(work: OpenSession, target: Target, loop: Loop, on_step: OnStep) -> ClosedLoop:
    """Photograph a strategy's picture, correct it by what was measured, and again; the best picture is kept.

    Needs `model`. Stops when the measured mean error does not fall by more than its noise. A run that was interrupted
    goes on with the first missing frame.

    Returns
    -------
    ClosedLoop
        The step's images begin with its name: ``…-best`` (``codes``, ``linear``), ``…-measured`` (``light``,
        ``variance``).

    Raises
    ------
    UsageError
        For an unknown strategy or rule, or an impossible number of captures.
    """
    loop.checked()
    session = work.session
    shot = measuring_bracket(session)
    settings = {
        "versions": versions_of((loop.strategy,)),
        "rule": loop.rule,
        "captures": loop.captures,
        "target_sha256": target.sha256,
        "judged": JUDGED,
        "exposures_s": shot.exposures_s,
        "repeats": shot.repeats,
        **dark_settings(session.profile),
    }
    step = session.step(
        f"loop-{loop.strategy}-{loop.rule}", settings=settings, needs=("response", *model_steps(session))
    )
    if not step.done:
        step.save_image("target", layers("grey", target.levels))
        room = controlled_scene_of(session, step, target)
        found, patterns = _closed(work, step, room, loop=loop, shot=shot, on_step=on_step)
        shown = ShownPictures(step=step, bracket=shot, radiometric=room.radiometric, patterns=patterns)
        # Before the loop is finished: one that is interrupted here has its pictures again when it goes on.
        on_step("learn of the light from these photographs", 0, 1)
        keep_evidence(session, shown, target)
        on_step("learn of the light from these photographs", 1, 1)
        step.save_record(step.name, found)
        step.finish()
    return step.load_record(step.name, ClosedLoop)


def controlled_scene_of(session: Session, step: Step, target: Target) -> ControlledScene:
    """The session's room with a target, which the step has as its image ``target``."""
    model = load_model(session)
    return ControlledScene(
        model=model,
        radiometric=calibration_of_pictures(session),
        transport=model.room.projector_transport,
        view=judged_pixels(model, step),
        wanted=wanted_light(model, target),
    )


def _closed(
    work: OpenSession, step: Step, room: ControlledScene, *, loop: Loop, shot: ExposureBracket, on_step: OnStep
) -> tuple[ClosedLoop, tuple[Pattern, ...]]:
    """What the loop found, and the pictures that it photographed."""
    image = room.solved(loop.strategy, room.wanted).projector_image
    errors: list[JudgedErrors] = []
    patterns: list[Pattern] = []
    best, stopped = 0, f"all {loop.captures} captures were used"
    for number in range(1, loop.captures + 1):
        on_step(f"closed loop: {loop.strategy}", number - 1, loop.captures)
        codes = room.codes(image, seed=number)
        pattern = Pattern(f"{step.name}-{number}", codes)
        photograph(work.rig(), work.session, step, [pattern], bracket=shot, n_patterns=1, on_step=silent)
        patterns.append(pattern)
        light = merge_exposures(step, pattern.name, shot, room.radiometric)
        errors.append(room.judged_light(light))
        before, goes_on = best, _falls(errors, best)
        if number == 1 or errors[-1].mean < errors[best].mean:
            best = number - 1
            _keep(step, codes, image, room=room, light=light)
        if not goes_on:
            by_little = best > before
            stopped = f"capture {number} was {_NO_BETTER[by_little].format(before + 1)}"
            break
        image = corrected(room, loop, image, _seen(room, codes, light))
    on_step(f"closed loop: {loop.strategy}", loop.captures, loop.captures)
    damping = room.damping if loop.rule == "image" else 1.0
    found = ClosedLoop(
        strategy=loop.strategy,
        rule=loop.rule,
        damping=damping,
        captures=tuple(errors),
        best=best + 1,
        stopped=stopped,
    )
    return found, tuple(patterns)


def _falls(errors: list[JudgedErrors], best: int) -> bool:
    """Tell if the last capture is better than the best before it, beyond the noise of both; the first always is."""
    last, before = errors[-1], errors[best]
    noise = np.hypot(last.mean_sigma or 0.0, before.mean_sigma or 0.0)
    return len(errors) == 1 or last.mean < before.mean - SIGMAS * noise


def _keep(step: Step, codes: Codes, image: FloatArray, room: ControlledScene, light: LightImage) -> None:
    step.save_image(f"{step.name}-best", layers("linear", whole_picture(room.model, image)) | code_layers(codes))
    step.save_image(f"{step.name}-measured", light.channels)


def _seen(room: ControlledScene, codes: Codes, light: LightImage) -> CapturedLight:
    usable = np.where(light.saturated, np.nan, light.value.astype(np.float64))
    return CapturedLight(room.linear(codes), room.seen(usable), room.seen(light.variance.astype(np.float64)))


def corrected(room: ControlledScene, loop: Loop, image: FloatArray, seen: CapturedLight) -> FloatArray:
    """(n, B) the next projector image."""
    return RULES[loop.rule](room, loop.strategy, image, seen)


def _by_image(room: ControlledScene, _strategy: str, image: FloatArray, seen: CapturedLight) -> FloatArray:
    """Move each pixel towards its own target: p <- clamp(p + w K⁻¹ D⁻¹ (c - measured)).

    References: Nayar, Peri, Grossberg and Belhumeur, A projection system with radiometric compensation for screen
    imperfections, PROCAMS 2003; here with a damping w that interreflection asks for, and that keeps noise down.
    """
    wanted = room.model.room.through_camera(room.wanted)
    residual = np.where(np.isfinite(seen.light), wanted - seen.light, 0.0)
    return np.asarray(np.clip(image + room.operator.divide_by_direct(room.damping * residual), 0.0, 1.0))


def _by_model(room: ControlledScene, strategy: str, _image: FloatArray, seen: CapturedLight) -> FloatArray:
    """Ask the strategy again for the target less the model's error: c - (measured - T p).

    What the range clips is predicted as clipped, so it is no error of the model and does not wind up.
    """
    expected = room.model.room.through_camera(room.transport.forward(seen.projected))
    error = trusted(room, seen.light - expected, seen.variance)
    return room.solved(strategy, room.wanted - error).projector_image


RULES: Mapping[str, Callable[[ControlledScene, str, FloatArray, CapturedLight], FloatArray]] = {
    "image": _by_image,
    "model": _by_model,
}
"""``image``: to the target, pixel by pixel. ``model``: the strategy again, by a model that is put right."""


def trusted(room: ControlledScene, residual: FloatArray, variance: FloatArray) -> FloatArray:
    """(n, B) the part of a residual that its noise does not explain, 0 where nothing was measured.

    Wiener's factor 1 - σ² / <r²>, at least 0, with the mean over the neighbourhood and σ² the measured variance
    (J.-S. Lee, IEEE Trans. PAMI 2, 1980): where a residual is all noise it is left alone.
    """
    known = np.isfinite(residual) & np.isfinite(variance)
    energy = _local_sum(room, np.where(known, residual, 0.0) ** 2)
    noise = _local_sum(room, np.where(known, variance, 0.0))
    share = np.clip(1 - noise / np.maximum(energy, 1e-30), 0.0, 1.0)
    return np.where(known, share * residual, 0.0)


def _local_sum(room: ControlledScene, values: FloatArray) -> FloatArray:
    """(n, B) sums over each pixel's neighbourhood, up to a common factor."""
    whole = whole_picture(room.model, values)
    smooth = cv2.boxFilter(whole, -1, (NEIGHBOURHOOD_PX, NEIGHBOURHOOD_PX))
    return np.asarray(smooth.reshape(-1, room.model.channels)[room.model.room.active])
