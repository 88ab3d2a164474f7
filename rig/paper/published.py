"""Which published effects the replication shows, and words for those that it does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rig.paper.records import ConfigurationResult, Effect, PoseErrors


@dataclass(frozen=True, kw_only=True)
class ClaimedFigures:
    """What the paper's claims speak of, of one configuration; light in grey levels of 255."""

    indirect: float
    """Mean over the patches that are seen."""
    share_white: float
    without: float
    """Mean error without compensation."""
    without_sd: float
    compensated: float
    """Mean error with the paper's compensation."""
    compensated_sd: float


def claimed(result: ConfigurationResult) -> ClaimedFigures:
    """Return what the claims speak of."""
    return ClaimedFigures(
        indirect=result.indirect.mean,
        share_white=result.share_white,
        without=result.error_uncompensated.mean,
        without_sd=result.error_uncompensated.sd,
        compensated=result.strategies["paper"].mean,
        compensated_sd=result.strategies["paper"].sd,
    )


def published_effects(results: Mapping[str, ClaimedFigures]) -> tuple[Effect, ...]:
    """Return each effect that the paper reports, its figures, ours, and whether ours go the same way.

    Parameters
    ----------
    results
        Of all six configurations, by name.
    """
    return tuple(
        Effect(effect=effect, published=published, ours=f"{first:.0f} against {second:.0f}", reproduced=first < second)
        for effect, published, first, second in (
            *_of_the_pictures(results),
            *_of_a_quarter(results),
            *_of_an_open_ceiling(results),
            *_of_dark_walls(results),
        )
    )


_Claim = tuple[str, str, float, float]
"""(effect, published figures, what is to be smaller, what is to be larger)."""


def _of_the_pictures(results: Mapping[str, ClaimedFigures]) -> tuple[_Claim, ...]:
    reference, indoor, grey = (results[name] for name in ("reference", "indoor", "grey"))
    evened = (grey.compensated_sd, grey.without_sd)
    return (
        ("reference: compensation lowers the mean error", "27 against 32", reference.compensated, reference.without),
        ("indoor: compensation raises the mean error", "27 against 32", indoor.without, indoor.compensated),
        ("grey: compensation raises the mean error", "10 against 21", grey.without, grey.compensated),
        ("grey: compensation evens the error out (sd)", "3 against 8", *evened),
    )


def _of_a_quarter(results: Mapping[str, ClaimedFigures]) -> tuple[_Claim, ...]:
    less, all_ = results["quarter"], results["reference"]
    return (
        ("25 %: less indirect light than the reference", "38 against 71", less.indirect, all_.indirect),
        ("25 %: smaller error without compensation", "21 against 32", less.without, all_.without),
        ("25 %: larger once-reflected share (%)", "35 against 45", 100 * all_.share_white, 100 * less.share_white),
    )


def _of_an_open_ceiling(results: Mapping[str, ClaimedFigures]) -> tuple[_Claim, ...]:
    open_, shut = results["no_ceiling"], results["reference"]
    shares = (100 * shut.share_white, 100 * open_.share_white)
    return (
        ("no ceiling: less indirect light", "20 against 71", open_.indirect, shut.indirect),
        ("no ceiling: smaller error with compensation", "6 against 27", open_.compensated, shut.compensated),
        ("no ceiling: larger once-reflected share (%)", "35 against 71", *shares),
    )


def _of_dark_walls(results: Mapping[str, ClaimedFigures]) -> tuple[_Claim, ...]:
    dark, light = results["dark_walls"], results["reference"]
    shares = (100 * light.share_white, 100 * dark.share_white)
    return (
        ("reflectance 0.4: less indirect light", "13 against 71", dark.indirect, light.indirect),
        ("reflectance 0.4: larger once-reflected share (%)", "35 against 60", *shares),
        ("reflectance 0.4: larger error without compensation", "32 against 83", light.without, dark.without),
        ("reflectance 0.4: compensation lowers the mean error", "47 against 83", dark.compensated, dark.without),
    )


def exceptions(effects: Sequence[Effect]) -> tuple[str, ...]:
    """Return a sentence for each effect that the replication does not show."""
    return tuple(
        f"{effect.effect}: published {effect.published}, here {effect.ours}. Pose, field of "
        "view and photographs of the paper are not published; 'sensitivity' shows how much they matter."
        for effect in effects
        if not effect.reproduced
    )


def sensitivity_remark(rows: Sequence[PoseErrors]) -> str:
    """Say in how many other poses the paper's rule moves the mean error as published."""
    lower = sum(row.reference["paper"] < row.reference["uncompensated"] for row in rows)
    indoor, grey = (sum(e["paper"] > e["uncompensated"] for e in errors) for errors in _raised(rows))
    return (
        f"Of {len(rows)} other poses the paper's rule lowers the reference's mean error in {lower}, "
        f"raises the indoor photograph's in {indoor} and the grey's in {grey}."
    )


def _raised(rows: Sequence[PoseErrors]) -> tuple[list[Mapping[str, float]], list[Mapping[str, float]]]:
    return [row.indoor for row in rows], [row.grey for row in rows]
