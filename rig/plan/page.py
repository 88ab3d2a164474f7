"""The page of a plan, and its tables."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from rig.files.atomic import write_bytes
from rig.plan.compute import ComputedPlan
from rig.plan.figures import light_view, plan_view
from rig.plan.projectors.numbers import ProjectorNumbers
from rig.plan.records import PlanResult
from rig.plan.search.page import DesignsSection, designs_section
from rig.plan.shown import WHITE, PictureInRoom
from rig.plan.tables import (
    contrast_table,
    paint_table,
    shadow_table,
    strategy_table,
    surface_table,
    unreached_table,
    viewer_table,
)
from rig.report import pictures
from rig.report.figures import error_scale
from rig.report.pictures import EmbeddedPicture
from rig.report.render import Headline, TextTable, rendered

REACHED = 0.95
"""Share of the picture on which white must be as bright as wanted for the word at the top: a rim may be darker."""
SHOWN = ("none", "bounded")
"""Strategies whose pictures are shown."""


HEADS = ("wanted", "seen without compensation", "seen with the optimum, bounded", "what the optimum misses")


@dataclass(frozen=True)
class PlannedView:
    """A picture and what stands below it."""

    head: str
    image: EmbeddedPicture


@dataclass(frozen=True, kw_only=True)
class PictureSection:
    """One picture on the page."""

    title: str
    text: str
    images: tuple[PlannedView, ...]
    """Four of each projector."""
    strategies: TextTable
    unreached: TextTable | None


@dataclass(frozen=True, kw_only=True)
class PlanPage:
    """What the template shows."""

    title: str
    subtitle: str
    met: bool
    word: str
    verdict: str
    headline: tuple[Headline, ...]
    remarks: tuple[str, ...]
    plan_view: str
    light_view: str
    error_scale: str
    surfaces: TextTable
    contrast: TextTable
    pictures: tuple[PictureSection, ...]
    viewers: TextTable | None
    shadows: TextTable | None
    paints: TextTable
    designs: DesignsSection | None
    """Of a search; None without one."""
    footer: str


def write_plan_page(computed: ComputedPlan, path: Path) -> Path:
    """Write the page as one HTML file that needs no other. Raises SessionError when the disk refuses."""
    write_bytes(path, rendered("plan/plan.html", plan_page(computed)).encode())
    return path


def plan_page(computed: ComputedPlan) -> PlanPage:
    """Return what the page of a plan shows."""
    result = computed.result
    reached = result.totals.reached_share
    met = reached >= REACHED
    return PlanPage(
        title=f"Plan of {result.name}",
        subtitle=f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC; {'; '.join(_in_short(one) for one in result.projectors)}.",
        met=met,
        word="Bright enough" if met else "Too dark in places",
        verdict=f"White is at least {result.totals.wanted_white_cdm2:g} cd/m² on {100 * reached:.0f} % of the picture",
        headline=_headline(result),
        remarks=result.remarks,
        plan_view=plan_view(computed),
        light_view=light_view(computed),
        error_scale=error_scale(),
        surfaces=surface_table(result),
        contrast=contrast_table(result),
        pictures=tuple(_section(computed, shown) for shown in computed.pictures),
        viewers=viewer_table(result) if result.viewers else None,
        shadows=shadow_table(result) if result.shadows else None,
        paints=paint_table(result),
        designs=None if result.search is None else designs_section(result.search),
        footer="Matte surfaces, one reflectance for all colours, projectors whose pixels all send the same light. "
        f"{result.patches} patches, pictures of {result.pixels[0]} x {result.pixels[1]} px; nothing was measured.",
    )


def _in_short(numbers: ProjectorNumbers) -> str:
    return (
        f"{numbers.name}: {numbers.lumens:g} lm, contrast {numbers.contrast:g}, {numbers.width_px} x "
        f"{numbers.height_px} px, throw ratio {numbers.throw_ratio:.3g} ({numbers.hfov_deg:.0f} degrees wide)"
    )


def _headline(result: PlanResult) -> tuple[Headline, ...]:
    totals, first = result.totals, result.pictures[0]
    none, best = first.outcome("none"), first.outcome("bounded")
    return (
        Headline(f"{totals.white_cdm2:.1f}", "cd/m²", f"white on the picture's {totals.lit_m2:.1f} m²"),
        Headline(f"{100 * totals.coverage:.0f}", "%", "of the room's surface inside the picture"),
        Headline(f"{result.contrast.checker_in_room:.1f}", ": 1", "contrast of a checker in the room"),
        Headline(f"{none.error:.1f} → {best.error:.1f}", "grey levels", f"error of {first.name}: without, at best"),
    )


def _section(computed: ComputedPlan, shown: PictureInRoom) -> PictureSection:
    record, white = shown.record, computed.request.show.white_cdm2
    rows = [_row(computed, shown, k) for k in range(len(computed.lit.views))]
    return PictureSection(
        title=f"Picture: {record.name}",
        text=f"White is wanted at {white:g} cd/m²; the picture's mean is {record.wanted_mean_cdm2:.3g} cd/m². "
        f"Uncompensated, {100 * record.global_share:.0f} % of its light comes from other walls.",
        images=tuple(image for row in rows for image in row),
        strategies=strategy_table(record),
        unreached=unreached_table(record) if record.unreached else None,
    )


def _row(computed: ComputedPlan, shown: PictureInRoom, index: int) -> list[PlannedView]:
    """One projector's view of a picture: wanted, seen without and with the optimum, missed."""
    view, part = computed.lit.views[index], computed.lit.joined.parts[index]
    name, scale = shown.record.name, WHITE / computed.request.show.white_cdm2
    where = "" if len(computed.lit.views) == 1 else f"{view.numbers.name}: "
    shape, seen = view.lens.shape, view.lit.reshape(view.lens.shape)
    levels = {"wanted": shown.wanted_cdm2, **{one: shown.seen_cdm2[one] for one in SHOWN}}
    made = [
        pictures.picture(
            pictures.photograph((values[part] * scale).reshape(shape), seen), f"{where}{name}: {word}", 480
        )
        for word, values in levels.items()
    ]
    missed = (shown.seen_cdm2["bounded"] - shown.wanted_cdm2)[part] * scale
    missed = np.where(seen.ravel(), missed, 0.0).reshape(shape)
    made.append(pictures.picture(pictures.signed_error(missed, seen), f"{where}{name}: what bounded misses", 480))
    return [PlannedView(f"{where}{head}", image) for head, image in zip(HEADS, made, strict=True)]
