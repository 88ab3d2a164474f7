"""A plan as tables of words, on the terminal and on its page."""

from __future__ import annotations

from rig.plan.records import PlannedPicture, PlanResult
from rig.plan.search.page import print_search
from rig.report.render import TextTable
from rig.terminal import print_table, say


def print_plan(result: PlanResult, page: str | None) -> None:
    """Print a plan's tables, what they mean, and where the page is."""
    for title, table in (
        ("Surfaces, white shown", surface_table(result)),
        ("Contrast", contrast_table(result)),
        *((f"Picture {one.name}, errors in grey levels", strategy_table(one)) for one in result.pictures),
    ):
        print_table(title, list(table.head), [tuple(row) for row in table.rows])
    for sentence in result.remarks:
        say(f"- {sentence}")
    if result.search is not None:
        print_search(result.search)
    if page is not None:
        print(f"page: {page}")


def surface_table(result: PlanResult) -> TextTable:
    """Return brightness, contrast and density by surface."""
    head = ("surface", "m²", "paint", "in picture %", "direct lx", "from walls lx", "room light lx", "white cd/m²",
            "darkest cd/m²", "black cd/m²", "contrast", "global %", "px/m")  # fmt: skip
    rows = [
        (
            one.name,
            f"{one.area_m2:.1f}",
            one.paint.name,
            f"{100 * one.coverage:.0f}",
            f"{one.direct_lux:.1f}",
            f"{one.indirect_lux:.1f}",
            f"{one.ambient_lux:.1f}",
            f"{one.white_cdm2:.2f}",
            f"{one.white_min_cdm2:.2f}",
            f"{one.black_cdm2:.3f}",
            f"{one.contrast:.0f}",
            f"{100 * one.global_share:.0f}",
            "-" if one.px_per_m is None else f"{one.px_per_m:.0f} ({one.px_per_m_least:.0f})",
        )
        for one in result.surfaces
    ]
    return TextTable(head, rows)


def contrast_table(result: PlanResult) -> TextTable:
    """Return how contrast falls from the projector to the room."""
    steps = result.contrast
    return TextTable(
        ("step", "white : black"),
        [
            ("the projector alone, whole picture white or black", f"{steps.projector:.0f}"),
            ("the same in the room, its light included", f"{steps.full_in_room:.0f}"),
            ("a checker of 4 x 4, no room light: what the walls leave", f"{steps.checker_dark_room:.1f}"),
            ("the same with room light", f"{steps.checker_in_room:.1f}"),
        ],
    )


def strategy_table(picture: PlannedPicture) -> TextTable:
    """Return the errors of all strategies on a picture."""
    rows = [
        (
            one.strategy,
            f"{one.error:.1f}",
            f"{one.rms:.1f}",
            f"{one.max:.0f}",
            f"{one.error_cdm2:.3f}",
            "> 99" if one.psnr_db > 99 else f"{one.psnr_db:.1f}",
            f"{100 * one.clipped_share:.0f}",
            "-" if one.gain is None else f"{one.gain:.2f}",
        )
        for one in picture.strategies
    ]
    return TextTable(("strategy", "mean", "rms", "max", "mean cd/m²", "PSNR dB", "clipped %", "gain"), rows)


def unreached_table(picture: PlannedPicture) -> TextTable:
    """Return where the optimum misses the picture."""
    rows = [
        (one.surface, f"{one.too_dark_m2:.2f}", f"{one.too_bright_m2:.2f}", f"{one.mean_cdm2:+.2f}")
        for one in picture.unreached
    ]
    return TextTable(("surface", "too dark m²", "too bright m²", "seen - wanted cd/m²"), rows)


def viewer_table(result: PlanResult) -> TextTable:
    """Return what each viewer sees."""
    rows = [
        (
            one.name,
            f"{100 * one.visible_share:.0f}",
            f"{one.px_per_deg:.1f} ({one.px_per_deg_least:.1f})",
            f"{one.white_cdm2:.2f}",
            f"{one.error:.1f}",
        )
        for one in result.viewers
    ]
    return TextTable(("viewer", "sees of it %", "px/degree", "white cd/m²", "error of bounded"), rows)


def shadow_table(result: PlanResult) -> TextTable:
    """Return what each person keeps from the walls."""
    rows = [
        (
            one.person,
            f"{100 * one.picture_share:.1f}",
            ", ".join(f"{name} {m2:.2f} m²" for name, m2 in one.by_surface_m2.items()) or "-",
            "yes" if one.dazzled else "no",
        )
        for one in result.shadows
    ]
    return TextTable(("person", "of the picture %", "shadow on", "light in the face"), rows)


def paint_table(result: PlanResult) -> TextTable:
    """Return the paints and who says what they reflect."""
    paints = {one.paint.name: one for one in result.surfaces}
    rows = [
        (
            name,
            f"{one.paint.reflectance:.3f}",
            ", ".join(other.name for other in result.surfaces if other.paint.name == name),
            one.paint.source,
        )
        for name, one in paints.items()
    ]
    return TextTable(("paint", "reflectance", "on", "source"), rows)
