"""The experiments of Dehos et al. 2014 again, with its own rules and with ours: ``rig paper``.

One pose serves all six configurations. The paper publishes neither pose, field of view nor photographs, so
ours are stated in the result, together with what other plausible poses give.
"""

from __future__ import annotations

import warnings
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.files.photographs import PHOTOGRAPHS, photograph
from rig.paper.published import claimed, exceptions, published_effects, sensitivity_remark
from rig.paper.records import (
    ConfigurationResult,
    Ends,
    MeanError,
    PaperImages,
    PaperResult,
    PoseErrors,
    PublishedFigures,
    StatedPose,
)
from rig.paper.scores import WHITE, Scored, certificate, compensated, strategy_scores
from rig.terminal import OnStep, silent
from sim.compensation import compensate
from sim.form_factors import ClosureWarning, FormFactors, form_factors
from sim.geometry.optics import Lens, Pose
from sim.light.criteria import (
    Spread,
    difference,
    emission_share,
    indirect_radiosity,
    once_reflected_share,
    overall_once_reflected_share,
    spread,
    visible_patches,
)
from sim.light.transport_of_scene import LightTransport, coaxial_transport
from sim.scenes.gridded import paper_room

FloatArray = NDArray[np.float64]

GREY = 70.0
SHAPE = (360, 480)
POSITION_M = (1.15, 1.15, 1.25)
DIRECTION = (1.0, 1.0, -0.25)
HFOV_DEG = 106.0
HFOV_QUARTER_DEG = 60.0
SHOWN = ("paper", "exact", "bounded")
"""Strategies beside the published figures."""
SMALL_SHAPE = (120, 160)
"""Of the pictures that are computed from other poses."""
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
class Viewpoint:
    """Where camera and projector are, where they look, and how wide."""

    position_m: tuple[float, float, float]
    direction: tuple[float, float, float]
    hfov_deg: float


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """One experiment of the paper's section 5 and what the paper says of it."""

    name: str
    title: str
    image: str
    published: PublishedFigures
    hfov_deg: float = HFOV_DEG
    ceiling: bool = True
    reflectance: float = 0.7


def _published(
    indirect: tuple[float, float, float],
    *,
    share: float | None = None,
    emission: tuple[float, float] | None = None,
    without: tuple[float, float | None] | None = None,
    compensated: tuple[float, float] | None = None,
) -> PublishedFigures:
    return PublishedFigures(
        indirect=Spread(*indirect),
        share_white=share,
        required_emission=None if emission is None else Ends(min=emission[0], max=emission[1]),
        error_uncompensated=None if without is None else MeanError(mean=without[0], sd=without[1]),
        error_compensated=None if compensated is None else MeanError(mean=compensated[0], sd=compensated[1]),
    )


CONFIGURATIONS = (
    Configuration(
        name="reference",
        title="Reference",
        image="outdoor",
        published=_published((43, 71, 153), share=0.35, emission=(-76, 153), without=(32, 18), compensated=(27, 12)),
    ),
    Configuration(
        name="indoor",
        title="Indoor photograph",
        image="indoor",
        published=_published((43, 71, 140), emission=(-115, 217), without=(27, 20), compensated=(32, 17)),
    ),
    Configuration(
        name="grey",
        title="Uniform grey 70",
        image="grey",
        published=_published((28, 46, 64), emission=(-48, 48), without=(10, 8), compensated=(21, 3)),
    ),
    Configuration(
        name="quarter",
        title="25 % of the surface",
        image="outdoor",
        published=_published((25, 38, 127), share=0.45, without=(21, None)),
        hfov_deg=HFOV_QUARTER_DEG,
    ),
    Configuration(
        name="no_ceiling",
        title="No ceiling",
        image="outdoor",
        published=_published((13, 20, 64), share=0.71, compensated=(6, 9)),
        ceiling=False,
    ),
    Configuration(
        name="dark_walls",
        title="Reflectance 0.4",
        image="outdoor",
        published=_published((5, 13, 25), share=0.60, without=(83, 37), compensated=(47, 38)),
        reflectance=0.4,
    ),
)


def run_paper(figures_dir: Path | None = None, on_step: OnStep = silent) -> PaperResult:
    """Replicate the paper's six configurations.

    Parameters
    ----------
    figures_dir : Path, optional
        Where to write the figures; none without it.
    on_step : callable (label, done, total)

    Returns
    -------
    PaperResult
        Light in grey levels of 255. ``error_uncompensated`` is ``|visible - desired|`` when the
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
    written = None
    if figures_dir is not None:
        from rig.paper.figures import write_paper_figures  # here: a sweep's workers draw nothing

        on_step("figures", total - 1, total)
        written = tuple(str(path) for path in write_paper_figures(results, images, figures_dir))
    on_step("done", total, total)
    by_name = {result.name: result for result in results}
    effects = published_effects({name: claimed(result) for name, result in by_name.items()})
    row_sums = factors[True].row_sums
    return PaperResult(
        coverage_quarter=by_name["quarter"].coverage,
        configurations=tuple(results),
        effects=effects,
        conventions=CONVENTIONS,
        exceptions=exceptions(effects),
        row_sums=Ends(min=float(row_sums.min()), max=float(row_sums.max())),
        spectral_radius=factors[True].spectral_radius,
        pose=_stated_pose(),
        photographs=PHOTOGRAPHS,
        sensitivity=sensitivity,
        sensitivity_remark=sensitivity_remark(sensitivity),
        figures=written,
    )


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


def _stated_pose() -> StatedPose:
    return StatedPose(
        position_m=POSITION_M,
        direction=DIRECTION,
        hfov_deg=HFOV_DEG,
        hfov_quarter_deg=HFOV_QUARTER_DEG,
        width_px=SHAPE[1],
        height_px=SHAPE[0],
        choice="the paper publishes none; chosen among plausible poses that light about half of the room "
        "as one that comes near its figures; 'sensitivity' shows others",
    )


def desired_picture(image: str, shape: tuple[int, int]) -> FloatArray:
    """(H, W) grey levels of a configuration's picture."""
    return np.full(shape, GREY) if image == "grey" else photograph(image, shape)


def paper_transport(
    configuration: Configuration,
    factors: FormFactors,
    shape: tuple[int, int],
    *,
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
) -> tuple[ConfigurationResult, PaperImages]:
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
    result = ConfigurationResult(
        name=configuration.name,
        title=configuration.title,
        image=configuration.image,
        coverage=coverage_of(transport),
        pixels_on_surface=float(seen.mean()),
        indirect=spread(indirect),
        indirect_bias_percent=float(100 * (indirect.mean() / unbiased.mean() - 1)),
        share_white=overall_once_reflected_share(transport, white),
        share_white_pixel_mean=float(once_reflected_share(transport, white)[seen].mean()),
        emission_share_mean=float(emission_share(transport, desired).mean()),
        required_emission=Ends(min=float(wanted["required_emission_min"]), max=float(wanted["required_emission_max"])),
        error_uncompensated=Scored(desired, seen, SHAPE).scores(uncompensated),
        strategies=scores,
        certificate=certificate(scores),
        published=configuration.published,
    )
    shown = PaperImages(
        name=configuration.name,
        title=configuration.title,
        desired=desired.reshape(SHAPE),
        uncompensated=uncompensated.reshape(SHAPE),
        projected={name: solution.projector_image.reshape(SHAPE) for name, solution in solutions.items()},
        visible={name: solution.predicted.reshape(SHAPE) for name, solution in solutions.items()},
        once_reflected_share=once_reflected_share(transport, white).reshape(SHAPE),
    )
    return result, shown


def coverage_of(transport: LightTransport) -> float:
    """Share of the room's surface in patches that some pixel lights."""
    areas = transport.radiosity.form_factors.areas
    return float(areas[visible_patches(transport)].sum() / areas.sum())


def _sensitivity(factors: FormFactors) -> tuple[PoseErrors, ...]:
    return tuple(_errors_from(Viewpoint(*pose), factors) for pose in OTHER_POSES)


def _errors_from(pose: Viewpoint, factors: FormFactors) -> PoseErrors:
    """Mean errors of reference, indoor and grey from another plausible pose, on smaller images."""
    errors = {}
    for base in CONFIGURATIONS[:3]:
        configuration = replace(base, hfov_deg=pose.hfov_deg)
        transport = paper_transport(
            configuration, factors, SMALL_SHAPE, position_m=pose.position_m, direction=pose.direction
        )
        desired = desired_picture(base.image, SMALL_SHAPE).ravel()
        means = {"uncompensated": difference(np.asarray(transport @ desired), desired).mean}
        for name in SHOWN:
            predicted = compensate(name, transport, desired, lower=0.0, upper=WHITE).predicted
            means[name] = difference(predicted, desired).mean
        errors[base.name] = means
    return PoseErrors(
        **asdict(pose),
        coverage=coverage_of(transport),
        reference=errors["reference"],
        indoor=errors["indoor"],
        grey=errors["grey"],
    )
