"""Which published effects the replication shows, and words for those that it does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rig.paper.records import ConfigurationResult, Effect, PoseErrors


def published_effects(results: Mapping[str, ConfigurationResult]) -> tuple[Effect, ...]:
    """Return each effect that the paper reports, its figures, ours, and whether ours go the same way."""
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


def _of_the_pictures(results: Mapping[str, ConfigurationResult]) -> tuple[_Claim, ...]:
    reference, indoor, grey = (results[name] for name in ("reference", "indoor", "grey"))
    evened = (grey.strategies["paper"].sd, grey.error_uncompensated.sd)
    return (
        ("reference: compensation lowers the mean error", "27 against 32", _with(reference), _without(reference)),
        ("indoor: compensation raises the mean error", "27 against 32", _without(indoor), _with(indoor)),
        ("grey: compensation raises the mean error", "10 against 21", _without(grey), _with(grey)),
        ("grey: compensation evens the error out (sd)", "3 against 8", *evened),
    )


def _of_a_quarter(results: Mapping[str, ConfigurationResult]) -> tuple[_Claim, ...]:
    less, all_ = results["quarter"], results["reference"]
    return (
        ("25 %: less indirect light than the reference", "38 against 71", less.indirect.mean, all_.indirect.mean),
        ("25 %: smaller error without compensation", "21 against 32", _without(less), _without(all_)),
        ("25 %: larger once-reflected share (%)", "35 against 45", 100 * all_.share_white, 100 * less.share_white),
    )


def _of_an_open_ceiling(results: Mapping[str, ConfigurationResult]) -> tuple[_Claim, ...]:
    open_, shut = results["no_ceiling"], results["reference"]
    shares = (100 * shut.share_white, 100 * open_.share_white)
    return (
        ("no ceiling: less indirect light", "20 against 71", open_.indirect.mean, shut.indirect.mean),
        ("no ceiling: smaller error with compensation", "6 against 27", _with(open_), _with(shut)),
        ("no ceiling: larger once-reflected share (%)", "35 against 71", *shares),
    )


def _of_dark_walls(results: Mapping[str, ConfigurationResult]) -> tuple[_Claim, ...]:
    dark, light = results["dark_walls"], results["reference"]
    shares = (100 * light.share_white, 100 * dark.share_white)
    return (
        ("reflectance 0.4: less indirect light", "13 against 71", dark.indirect.mean, light.indirect.mean),
        ("reflectance 0.4: larger once-reflected share (%)", "35 against 60", *shares),
        ("reflectance 0.4: larger error without compensation", "32 against 83", _without(light), _without(dark)),
        ("reflectance 0.4: compensation lowers the mean error", "47 against 83", _with(dark), _without(dark)),
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


def _without(result: ConfigurationResult) -> float:
    return result.error_uncompensated.mean


def _with(result: ConfigurationResult) -> float:
    return result.strategies["paper"].mean
