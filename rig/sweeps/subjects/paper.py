"""The paper's configurations as a subject: any pose, lens, reflectance and picture in its room."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from rig.errors import UsageError
from rig.files.toml import Table, check_model
from rig.records import JsonObject
from rig.report.terms import STRATEGIES
from rig.sweeps.records import Evaluated, Figure

if TYPE_CHECKING:
    from rig.paper.viewpoints import Experiment, ExperimentResult

_FROM_WALLS_M = 0.05
"""Nearer to a wall, a single patch of 0.4 m fills the picture."""
_ROOM_M = (4.8, 4.8, 2.4)


class PaperInputs(Table):
    """What the paper's experiment can be asked; lengths from the corner that the room's axes begin in."""

    x_m: Annotated[float, Field(ge=_FROM_WALLS_M, le=_ROOM_M[0] - _FROM_WALLS_M)] = 1.15
    y_m: Annotated[float, Field(ge=_FROM_WALLS_M, le=_ROOM_M[1] - _FROM_WALLS_M)] = 1.15
    z_m: Annotated[float, Field(ge=_FROM_WALLS_M, le=_ROOM_M[2] - _FROM_WALLS_M)] = 1.25
    azimuth_deg: Annotated[float, Field(ge=-360, le=360)] = 45.0
    elevation_deg: Annotated[float, Field(ge=-89, le=89)] = -10.0
    hfov_deg: Annotated[float, Field(ge=5, le=150)] = 106.0
    picture_scale: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Width of the picture on a wall, relative to that of the field of view."""
    reflectance: Annotated[float, Field(ge=0, le=0.95)] = 0.7
    """Beyond 0.98 the paper's quadrature makes light out of nothing."""
    ceiling: bool = True
    photograph: Literal["outdoor", "indoor", "grey"] = "outdoor"
    width_px: Annotated[int, Field(ge=8, le=1024)] = 160
    height_px: Annotated[int, Field(ge=8, le=1024)] = 120
    strategies: Annotated[tuple[str, ...], Field(min_length=1)] = ("none", "paper", "exact", "bounded")


class PaperSubject:
    """Dehos et al. 2014, section 5: one room of 4.8 x 4.8 x 2.4 m in 576 patches, with or without its ceiling."""

    version = "1"

    def base_of(self, name: str | None, near: Path) -> None:
        """Refuse a file: the room is the paper's. Raises UsageError."""
        if name is not None:
            raise UsageError(f"base: the subject paper has its own room, not {name!r} of {near}; leave base out")

    def complete(self, settings: Mapping[str, object], base: str | None) -> JsonObject:  # noqa: ARG002 - it has none
        """Return all inputs, defaults filled in; raises ProfileError."""
        return check_model(PaperInputs, settings, Path("study"), _unknown_strategies(settings)).model_dump(mode="json")

    def evaluate(self, inputs: JsonObject, base: str | None) -> Evaluated:  # noqa: ARG002 - it has none
        """Compute the paper's criteria and the errors of the strategies."""
        from rig.paper.viewpoints import run_experiment  # here: who only reads points waits for no model

        asked = check_model(PaperInputs, inputs, Path("point"))
        result, shown = run_experiment(_experiment(asked))
        arrays = {"desired": shown.desired, "uncompensated": shown.uncompensated, **dict(shown.visible)}
        return Evaluated(figures=_figures(result), arrays=arrays)


def _unknown_strategies(settings: Mapping[str, object]) -> list[str]:
    names = settings.get("strategies", ())
    unknown = [name for name in names if name not in STRATEGIES] if isinstance(names, list | tuple) else []
    if unknown:
        from sim.compensation import STRATEGIES as REGISTERED  # of other packages, too

        unknown = [name for name in unknown if name not in REGISTERED]
    return [f"strategies: {name!r} is none; there are {', '.join(STRATEGIES)}" for name in unknown]


def _experiment(asked: PaperInputs) -> Experiment:
    from rig.paper.experiments import Viewpoint
    from rig.paper.viewpoints import Experiment, direction_of

    half = math.atan(asked.picture_scale * math.tan(math.radians(asked.hfov_deg / 2)))
    direction = direction_of(asked.azimuth_deg, asked.elevation_deg)
    return Experiment(
        viewpoint=Viewpoint((asked.x_m, asked.y_m, asked.z_m), direction, math.degrees(2 * half)),
        photograph=asked.photograph,
        reflectance=asked.reflectance,
        ceiling=asked.ceiling,
        shape=(asked.height_px, asked.width_px),
        strategies=asked.strategies,
    )


def _figures(result: ExperimentResult) -> dict[str, Figure]:
    figures: dict[str, Figure] = {
        "coverage": result.coverage,
        "pixels_on_surface": result.pixels_on_surface,
        "indirect_min": result.indirect.min,
        "indirect_mean": result.indirect.mean,
        "indirect_max": result.indirect.max,
        "share_white": result.share_white,
    }
    if result.required_emission is not None:
        figures["required_emission_min"] = result.required_emission.min
        figures["required_emission_max"] = result.required_emission.max
    figures |= {f"uncompensated_{name}": getattr(result.uncompensated, name) for name in ("mean", "sd", "max", "rms")}
    for strategy, errors in result.strategies:
        figures |= {f"{strategy}_{name}": value for name, value in asdict(errors).items() if value is not None}
    return figures
