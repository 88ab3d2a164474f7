"""The experiments of Dehos et al. 2014 again, with its own rules and with ours: ``rig paper``.

One pose serves all six configurations. The paper publishes neither pose, field of view nor photographs, so
ours are stated in the result, together with what other plausible poses give.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.table import Table

from rig.errors import UsageError
from rig.files.photographs import PHOTOGRAPHS, photograph
from rig.paper.figures import PaperImages, write_paper_figures
from rig.paper.published import exceptions, published_effects, sensitivity_remark
from rig.paper.scores import WHITE, Scored, certificate, compensated, strategy_scores
from sim.compensation import compensate
from sim.form_factors import ClosureWarning, FormFactors, form_factors
from sim.geometry.optics import Lens, Pose
from sim.light.criteria import (
    difference,
    emission_share,
    indirect_radiosity,
    once_reflected_share,
    overall_once_reflected_share,
    spread,
    visible_patches,
)
from sim.light.transport_of_scene import LightTransport, coaxial_transport
from sim.scenes.library import paper_room

FloatArray = NDArray[np.float64]
OnStep = Callable[[str, int, int], None]

GREY = 70.0
SHAPE = (360, 480)
POSITION_M = (1.15, 1.15, 1.25)
DIRECTION = (1.0, 1.0, -0.25)
HFOV_DEG = 106.0
HFOV_QUARTER_DEG = 60.0
SHOWN = ("paper", "exact", "bounded")
"""Strategies beside the published figures."""
OTHER_POSES = (
    ((1.2, 1.2, 1.2), (1.0, 1.0, 0.0), 100.0),
    ((1.0, 1.0, 1.0), (1.0, 1.0, -0.2), 100.0),
    ((1.0, 1.0, 1.4), (1.0, 1.0, 0.2), 100.0),
    ((1.1, 1.1, 1.1), (1.0, 1.0, -0.25), 104.0),
    ((1.2, 1.2, 1.6), (1.0, 1.0, 0.0), 100.0),
    ((0.8, 0.8, 1.2), (1.0, 1.0, 0.0), 90.0),
    ((1.4, 1.4, 1.2), (1.0, 1.0, 0.0), 100.0),
    ((1.6, 1.6, 1.2), (1.0, 1.0, 0.0), 100.0),
)
"""(position, direction, horizontal field of view) that light 42 ... 54 % of the room."""


@dataclass(frozen=True)
class Configuration:
    """One experiment of the paper's section 5 and what the paper says of it."""

    name: str
    title: str
    image: str
    published: Mapping[str, Any]
    hfov_deg: float = HFOV_DEG
    ceiling: bool = True
    reflectance: float = 0.7


def _published(
    indirect: tuple[float, float, float],
    share: float | None = None,
    emission: tuple[float, float] | None = None,
    without: tuple[float, float | None] | None = None,
    compensated: tuple[float, float] | None = None,
) -> dict[str, Any]:
    given = {
        "indirect": dict(zip(("min", "mean", "max"), indirect, strict=True)),
        "share_white": share,
        "required_emission": emission and dict(zip(("min", "max"), emission, strict=True)),
        "error_uncompensated": without and dict(zip(("mean", "sd"), without, strict=True)),
        "error_compensated": compensated and dict(zip(("mean", "sd"), compensated, strict=True)),
    }
    return {key: value for key, value in given.items() if value is not None}


CONFIGURATIONS = (
    Configuration(
        "reference",
        "Reference",
        "outdoor",
        _published((43, 71, 153), 0.35, (-76, 153), (32, 18), (27, 12)),
    ),
    Configuration(
        "indoor",
        "Indoor photograph",
        "indoor",
        _published((43, 71, 140), None, (-115, 217), (27, 20), (32, 17)),
    ),
    Configuration("grey", "Uniform grey 70", "grey", _published((28, 46, 64), None, (-48, 48), (10, 8), (21, 3))),
    Configuration(
        "quarter",
        "25 % of the surface",
        "outdoor",
        _published((25, 38, 127), 0.45, None, (21, None)),
        hfov_deg=HFOV_QUARTER_DEG,
    ),
    Configuration(
        "no_ceiling",
        "No ceiling",
        "outdoor",
        _published((13, 20, 64), 0.71, None, None, (6, 9)),
        ceiling=False,
    ),
    Configuration(
        "dark_walls",
        "Reflectance 0.4",
        "outdoor",
        _published((5, 13, 25), 0.60, None, (83, 37), (47, 38)),
        reflectance=0.4,
    ),
)


def run_paper(figures_dir: Path | None, on_step: OnStep) -> dict[str, Any]:
    """Replicate the paper's six configurations.

    Parameters
    ----------
    figures_dir : Path, optional
        Where to write the figures; none without it.
    on_step : callable (label, done, total)

    Returns
    -------
    dict
        JSON-able; light in grey levels of 255. ``error_uncompensated`` is |visible - desired| when the
        desired image itself is projected, as the paper compares. Pixels that see no surface (no ceiling) do
        not count.
    """
    if figures_dir is not None:
        try:
            figures_dir.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UsageError(f"{figures_dir}: no folder for figures ({error.strerror}); give another") from error
    total = len(CONFIGURATIONS) + 2 + (figures_dir is not None)
    on_step("form factors", 0, total)
    factors = {ceiling: paper_factors(ceiling) for ceiling in (True, False)}
    exact = {ceiling: form_factors(paper_room(ceiling), "closed_form") for ceiling in (True, False)}
    results, images = [], []
    for index, configuration in enumerate(CONFIGURATIONS, 1):
        on_step(configuration.title, index, total)
        ceiling = configuration.ceiling
        result, shown = _run(configuration, factors[ceiling], exact[ceiling])
        results.append(result)
        images.append(shown)
    on_step("other poses", len(CONFIGURATIONS) + 1, total)
    sensitivity = _sensitivity(factors[True])
    row_sums = factors[True].row_sums
    effects = published_effects({result["name"]: result for result in results})
    summary: dict[str, Any] = {
        "coverage_quarter": _named(results, "quarter")["coverage"],
        "configurations": results,
        "effects": effects,
        "conventions": dict(CONVENTIONS),
        "exceptions": exceptions(effects),
        "row_sums": {"min": float(row_sums.min()), "max": float(row_sums.max())},
        "spectral_radius": factors[True].spectral_radius,
        "pose": _stated_pose(),
        "photographs": {name: asdict(photo) for name, photo in PHOTOGRAPHS.items()},
        "sensitivity": sensitivity,
        "sensitivity_remark": sensitivity_remark(sensitivity),
    }
    if figures_dir is not None:
        on_step("figures", total - 1, total)
        written = write_paper_figures(summary, images, figures_dir)
        summary["figures"] = [str(path) for path in written]
    on_step("done", total, total)
    return summary


def paper_factors(ceiling: bool) -> FormFactors:
    """Form factors of the room by the paper's quadrature."""
    with warnings.catch_warnings():
        # That its row sums exceed 1 is a result of this replication, and reported as one.
        warnings.simplefilter("ignore", ClosureWarning)
        return form_factors(paper_room(ceiling), "paper")


CONVENTIONS = {
    "indirect": "B - E over the patches that at least one pixel sees; each patch counts once (min, mean, max)",
    "share_white": "direct light over all light, each summed over the camera's pixels, projector white",
    "required_emission": "E' of eq. 13 with B' = 0 on patches that no pixel sees (min, max over all patches)",
    "error": "|visible - desired| over all pixels that light a surface; sd is that of the absolute difference",
    "error_uncompensated": "the desired image itself is projected",
}
"""What is averaged over what."""

TABLE_COLUMNS = (
    "configuration",
    "lit",
    "indirect light",
    "once",
    "needed E'",
    "without",
    "paper",
    "exact",
    "bounded",
)


def paper_table(result: Mapping[str, Any]) -> Table:
    """Table of ours, and under each row the published figures."""
    table = Table(title="Dehos et al. 2014 again, grey levels of 255", title_justify="left", box=SIMPLE_HEAD)
    for column in TABLE_COLUMNS:
        table.add_column(column, no_wrap=True, justify="left" if column == TABLE_COLUMNS[0] else "right")
    for configuration in result["configurations"]:
        strategies = configuration["strategies"]
        table.add_row(
            configuration["title"],
            f"{100 * configuration['coverage']:.0f} %",
            _range(configuration["indirect"]),
            f"{100 * configuration['share_white']:.0f} %",
            _range(configuration["required_emission"]),
            _error(configuration["error_uncompensated"]),
            *(_error(strategies[name]) for name in SHOWN),
        )
        table.add_row(*_published_row(configuration["published"]), style="dim", end_section=True)
    return table


def _published_row(published: Mapping[str, Any]) -> list[str]:
    share = published.get("share_white")
    return [
        "  published",
        "",
        _range(published["indirect"]),
        "" if share is None else f"{100 * share:.0f} %",
        _range(published.get("required_emission", {})),
        _error(published.get("error_uncompensated")),
        _error(published.get("error_compensated")),
        "",
        "",
    ]


def _range(values: Mapping[str, float]) -> str:
    return " / ".join(f"{value:.0f}" for value in values.values())


def _error(error: Mapping[str, float | None] | None) -> str:
    if error is None:
        return ""
    spread_text = "" if error["sd"] is None else f" ± {error['sd']:.0f}"
    return f"{error['mean']:.1f}{spread_text}"


def _named(results: list[dict[str, Any]], name: str) -> dict[str, Any]:
    return next(result for result in results if result["name"] == name)


def _stated_pose() -> dict[str, Any]:
    return {
        "position_m": list(POSITION_M),
        "direction": list(DIRECTION),
        "hfov_deg": HFOV_DEG,
        "hfov_quarter_deg": HFOV_QUARTER_DEG,
        "width_px": SHAPE[1],
        "height_px": SHAPE[0],
        "choice": "the paper publishes none; chosen among plausible poses that light about half of the room "
        "as one that comes near its figures; 'sensitivity' shows others",
    }


def desired_picture(image: str, shape: tuple[int, int]) -> FloatArray:
    """(H, W) grey levels of a configuration's picture."""
    return np.full(shape, GREY) if image == "grey" else photograph(image, shape)


def paper_transport(
    configuration: Configuration,
    factors: FormFactors,
    shape: tuple[int, int],
    position_m: tuple[float, float, float] = POSITION_M,
    direction: tuple[float, float, float] = DIRECTION,
) -> LightTransport:
    """T of a configuration with the paper's rules, light in grey levels of 255."""
    scene = paper_room(configuration.ceiling, configuration.reflectance)
    lens = Lens.from_horizontal_field_of_view(shape[1], shape[0], configuration.hfov_deg)
    pose = Pose.look_at(position_m, np.add(position_m, direction))
    return coaxial_transport(scene, factors, lens, pose, convention="paper", emission_rule="pixel_mean")


def _run(
    configuration: Configuration, factors: FormFactors, exact_factors: FormFactors
) -> tuple[dict[str, Any], PaperImages]:
    transport = paper_transport(configuration, factors, SHAPE)
    seen = transport.pixel_patch >= 0
    desired = np.where(seen, desired_picture(configuration.image, SHAPE).ravel(), 0.0)
    uncompensated = np.asarray(transport @ desired)
    solutions = compensated(transport, desired)
    scores = strategy_scores(solutions, desired, seen, SHAPE)
    white = np.full(desired.shape, WHITE)
    indirect = indirect_radiosity(transport, desired)
    unbiased = indirect_radiosity(paper_transport(configuration, exact_factors, SHAPE), desired)
    wanted = solutions["paper"].notes
    result = {
        "name": configuration.name,
        "title": configuration.title,
        "image": configuration.image,
        "coverage": _coverage(transport),
        "pixels_on_surface": float(seen.mean()),
        "indirect": asdict(spread(indirect)),
        "indirect_bias_percent": float(100 * (indirect.mean() / unbiased.mean() - 1)),
        "share_white": overall_once_reflected_share(transport, white),
        "share_white_pixel_mean": float(once_reflected_share(transport, white)[seen].mean()),
        "emission_share_mean": float(emission_share(transport, desired).mean()),
        "required_emission": {
            "min": float(wanted["required_emission_min"]),
            "max": float(wanted["required_emission_max"]),
        },
        "error_uncompensated": Scored(desired, seen, SHAPE).scores(uncompensated),
        "strategies": scores,
        "certificate": certificate(scores),
        "published": dict(configuration.published),
    }
    projected = {name: solution.projector_image.reshape(SHAPE) for name, solution in solutions.items()}
    visible = {name: solution.predicted.reshape(SHAPE) for name, solution in solutions.items()}
    shown = PaperImages(
        configuration.name,
        configuration.title,
        desired.reshape(SHAPE),
        uncompensated.reshape(SHAPE),
        projected,
        visible,
        once_reflected_share(transport, white).reshape(SHAPE),
    )
    return result, shown


def _coverage(transport: LightTransport) -> float:
    """Share of the room's surface in patches that some pixel lights."""
    areas = transport.radiosity.form_factors.areas
    return float(areas[visible_patches(transport)].sum() / areas.sum())


def _sensitivity(factors: FormFactors) -> list[dict[str, Any]]:
    """Mean errors of reference, indoor and grey from other plausible poses, on smaller images."""
    rows = []
    for position_m, direction, hfov_deg in OTHER_POSES:
        row: dict[str, Any] = {
            "position_m": list(position_m),
            "direction": list(direction),
            "hfov_deg": hfov_deg,
        }
        for base in CONFIGURATIONS[:3]:
            configuration = Configuration(base.name, base.title, base.image, {}, hfov_deg)
            transport = paper_transport(configuration, factors, (120, 160), position_m, direction)
            desired = desired_picture(base.image, (120, 160)).ravel()
            row["coverage"] = _coverage(transport)
            errors = {"uncompensated": difference(np.asarray(transport @ desired), desired).mean}
            for name in SHOWN:
                predicted = compensate(name, transport, desired, 0.0, WHITE).predicted
                errors[name] = difference(predicted, desired).mean
            row[base.name] = errors
        rows.append(row)
    return rows
