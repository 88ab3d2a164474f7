"""The projector images of each strategy and what the model expects of them: step `compensate`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from rig import plug_ins
from rig.files.channels import code_layers, layers
from rig.records import JsonObject, Record, json_of
from rig.session import Session, Step
from rig.stages.linear_light import channel_codes
from rig.stages.model import FittedScene, load_model
from rig.stages.prediction import predict, wanted_light, whole_picture
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.showing.place import placed
from rig.stages.target import CompensationRequest
from rig.terminal import OnStep
from sim.compensation.result import Compensation
from sim.light.colour import ColourTransport

BEST_FIRST = ("bounded", "exact", "paper", "direct", "none")
"""Which strategy stands for 'compensated': the most complete one that was asked for."""
_SEEDS = 900
"""Below the distance between the seeds of two channels."""


@dataclass(frozen=True, kw_only=True)
class ComputedStrategy(Record):
    """What is known of a strategy's picture before it is shown."""

    clipped_share: float
    """Of the steered projector pixels: held back by the projector's range."""
    iterations: int
    solver_rms: float
    """Of the light that the model expects minus the target, in grey levels."""
    notes: Mapping[str, float | str]


@dataclass(frozen=True, kw_only=True)
class CompensationRecord(Record):
    """What step `compensate` computed, beside its images."""

    strategies: Mapping[str, ComputedStrategy]
    active_share: float
    """Of the projector's pixels: seen by the camera well enough to steer."""

    @property
    def best(self) -> str:
        """The strategy that stands for 'compensated': another, by any name, where none of the three best was shown."""
        *best, direct, none = BEST_FIRST
        others = [name for name in self.strategies if name not in BEST_FIRST]
        return next((name for name in (*best, *others, direct) if name in self.strategies), none)


def compensation_settings(request: CompensationRequest) -> JsonObject:
    """Return what step `compensate` depends on."""
    target = request.target
    # Said only where it is not the case from before there was a choice: sessions that are done stay done.
    read: JsonObject = {"light": target.light} if target.light != "linear light" else {}
    lost: JsonObject = {"lost_colours": True} if target.lost_colours else {}
    where: JsonObject = {} if target.place is None else {"placement": target.place.placement}
    return {
        **read,
        **lost,
        **where,
        "target": request.target.name,
        "target_sha256": request.target.sha256,
        "strategies": json_of(request.strategies),
        "versions": versions_of(request.strategies),
        "prediction": "all projector pixels, blurred, with sigma by the curves' own",
        "blur": "of the projector",
    }


def versions_of(strategies: Iterable[str]) -> JsonObject:
    """Return the strategies' versions: a new one, of this program or of another package, is computed again."""
    return {name: plug_ins.strategy_version(name) for name in strategies}


def dither_seed(strategy: str) -> int:
    """Return the seed of a strategy's dither: the same whichever others are shown, so that its codes are."""
    usual = tuple(reversed(BEST_FIRST))
    return usual.index(strategy) + 1 if strategy in usual else len(usual) + 1 + crc32(strategy.encode()) % _SEEDS


def solve(name: str, transport: ColourTransport, wanted: NDArray[np.float64], **options: float) -> Compensation:
    """Return what a strategy computes, of this program or of another package.

    Parameters
    ----------
    name
        Of the strategy.
    transport
        In the projector's view.
    wanted : (n, B)
        Light at the n steered pixels.
    options
        Of the strategy (:func:`measured_options`).
    """
    return plug_ins.compensate(name, transport, wanted, **options)


def compute_compensation(session: Session, step: Step, request: CompensationRequest, on_step: OnStep) -> None:
    """Step `compensate`: solve each strategy in the projector's view; predict the camera's for the codes."""
    model, radiometric = load_model(session), load_radiometric_calibration(session)
    target = placed(model, request.target)
    if request.target.place is not None:
        step.save_image("target-source", layers("grey", request.target.levels))
    step.save_image("target", layers("grey", target.levels))
    transport, wanted = model.room.projector_transport, wanted_light(model, target)
    options, computed = measured_options(model), {}
    for k, name in enumerate(request.strategies):
        on_step("compute compensation images", k, len(request.strategies))
        solution = solve(name, transport, wanted, **options.get(name, {}))
        linear = whole_picture(model, solution.projector_image)
        codes = channel_codes(radiometric.projector, linear, seed=dither_seed(name))
        step.save_image(f"projector-{name}", layers("linear", linear) | code_layers(codes))
        step.save_image(f"predicted-{name}", predict(model, radiometric, codes).channels)
        computed[name] = _computed(solution, model.level)
    on_step("compute compensation images", len(request.strategies), len(request.strategies))
    active_share = float(model.room.active.mean())
    step.save_record("compensation", CompensationRecord(strategies=computed, active_share=active_share))


def _computed(solution: Compensation, level: float) -> ComputedStrategy:
    return ComputedStrategy(
        clipped_share=float(solution.clipped.mean()),
        iterations=solution.iterations,
        solver_rms=solution.residual_rms * 255 / level,
        notes=dict(solution.notes),
    )


def measured_options(model: FittedScene) -> dict[str, dict[str, float]]:
    """Return what the session has measured that a strategy wants to know, by strategy."""
    noise_rms = float(np.sqrt(model.white_variance[model.lit].mean()))
    return {"tikhonov": {"noise_rms": noise_rms} if noise_rms > 0 else {}, "perceptual": {"white": model.level}}


def load_compensation(session: Session) -> CompensationRecord:
    """Return what the finished step `compensate` computed, its strategies in order."""
    return session.finished("compensate").load_record("compensation", CompensationRecord)
