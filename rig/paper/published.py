"""Which published effects the replication shows, and words for those that it does not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Result = Mapping[str, Any]


def published_effects(results: Mapping[str, Result]) -> list[dict[str, Any]]:
    """Each effect that the paper reports, its figures, ours, and whether ours go the same way."""
    effects: list[dict[str, Any]] = []

    def add(effect: str, published: str, first: float, second: float, scale: float = 1.0) -> None:
        ours = f"{first * scale:.0f} against {second * scale:.0f}"
        effects.append({"effect": effect, "published": published, "ours": ours, "reproduced": first < second})

    error = {name: (_without(result), _with(result)) for name, result in results.items()}
    indirect = {name: float(result["indirect"]["mean"]) for name, result in results.items()}
    share = {name: float(result["share_white"]) for name, result in results.items()}
    add(
        "reference: compensation lowers the mean error",
        "27 against 32",
        error["reference"][1],
        error["reference"][0],
    )
    add("indoor: compensation raises the mean error", "27 against 32", *error["indoor"])
    add("grey: compensation raises the mean error", "10 against 21", *error["grey"])
    add(
        "grey: compensation evens the error out (sd)",
        "3 against 8",
        float(results["grey"]["strategies"]["paper"]["sd"]),
        float(results["grey"]["error_uncompensated"]["sd"]),
    )
    add(
        "25 %: less indirect light than the reference",
        "38 against 71",
        indirect["quarter"],
        indirect["reference"],
    )
    add(
        "25 %: smaller error without compensation",
        "21 against 32",
        error["quarter"][0],
        error["reference"][0],
    )
    add("25 %: larger once-reflected share (%)", "35 against 45", share["reference"], share["quarter"], 100)
    add("no ceiling: less indirect light", "20 against 71", indirect["no_ceiling"], indirect["reference"])
    add(
        "no ceiling: smaller error with compensation",
        "6 against 27",
        error["no_ceiling"][1],
        error["reference"][1],
    )
    add(
        "no ceiling: larger once-reflected share (%)",
        "35 against 71",
        share["reference"],
        share["no_ceiling"],
        100,
    )
    add("reflectance 0.4: less indirect light", "13 against 71", indirect["dark_walls"], indirect["reference"])
    add(
        "reflectance 0.4: larger once-reflected share (%)",
        "35 against 60",
        share["reference"],
        share["dark_walls"],
        100,
    )
    add(
        "reflectance 0.4: larger error without compensation",
        "32 against 83",
        error["reference"][0],
        error["dark_walls"][0],
    )
    add(
        "reflectance 0.4: compensation lowers the mean error",
        "47 against 83",
        error["dark_walls"][1],
        error["dark_walls"][0],
    )
    return effects


def exceptions(effects: list[dict[str, Any]]) -> list[str]:
    """Write a sentence for each effect that the replication does not show."""
    return [
        f"{effect['effect']}: published {effect['published']}, here {effect['ours']}. Pose, field of "
        "view and photographs of the paper are not published; 'sensitivity' shows how much they matter."
        for effect in effects
        if not effect["reproduced"]
    ]


def sensitivity_remark(rows: list[dict[str, Any]]) -> str:
    """In how many other poses the paper's rule moves the mean error as published."""
    lower = sum(row["reference"]["paper"] < row["reference"]["uncompensated"] for row in rows)
    raised = {name: sum(row[name]["paper"] > row[name]["uncompensated"] for row in rows) for name in ("indoor", "grey")}
    return (
        f"Of {len(rows)} other poses the paper's rule lowers the reference's mean error in {lower}, "
        f"raises the indoor photograph's in {raised['indoor']} and the grey's in {raised['grey']}."
    )


def _without(result: Result) -> float:
    return float(result["error_uncompensated"]["mean"])


def _with(result: Result) -> float:
    return float(result["strategies"]["paper"]["mean"])
