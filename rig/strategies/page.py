"""What `rig compare-strategies` prints, and its page with pictures and charts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.files.atomic import write_bytes
from rig.files.channels import codes_of, image_of
from rig.report import figures, pictures
from rig.report.links import link_pages
from rig.report.render import headline_of, rendered
from rig.report.terms import explained
from rig.session import Session, Step
from rig.stages.model import load_model
from rig.stages.prediction import JudgedPixels, judged_pixels
from rig.strategies.figures import TitledRow, errors_figure, loops_figure, mean_of, speed_figure
from rig.strategies.recommendation import recommendation
from rig.strategies.records import ClosedLoop, ComparedPicture, ComparisonResult, StrategyRow
from rig.terminal import OnStep, print_table, say
from rig.terminal.line import counted

FloatArray = NDArray[np.float64]

PAGE = "strategies.html"
LEGEND = (
    "mean, sd and max are of |shown - target| over the judged pixels, rms and bias of shown - target, in grey levels "
    "of 255. ΔE is the mean CIEDE2000 difference of the pictures as light, white at 255. SSIM compares structure, 1 is "
    "equal. 'mean at best gain' is the mean error after the single gain that suits the picture best: what an eye that "
    "adapts to the brightness is left with.",
    "predicted: by the model, for the codes that were sent. measured: photographed, the camera's noise included. "
    "clipped: share of the steered projector pixels that the range holds back. gain: what the strategy scales the "
    "target by. time: to compute the projector image. contrast: mean light where white is wanted over that where black "
    "is.",
)


@dataclass(frozen=True, eq=False)
class PaperPictures:
    """What one of the paper's configurations shows; (H, W) grey levels of 255."""

    desired: FloatArray
    seen: NDArray[np.bool_]
    """Pixels that see a surface."""
    projected: Mapping[str, FloatArray]
    """Projector image by strategy."""
    predicted: Mapping[str, FloatArray]
    """What is seen of it in the room, by strategy."""


def print_strategies(result: ComparisonResult) -> None:
    """Print a table a picture; then closed loops, ratios, warnings, and where the page is."""
    for picture in result.pictures:
        print_table(f"{picture.name}: {picture.sentence}", *_table(_all_rows(result, picture)))
    for text in recommendation(result) if result.session is not None else ():
        say(text)
    for loop in result.loops:
        after = ", ".join(f"{number}: {errors.mean:.2f}" for number, errors in loop.after.items())
        say(f"closed loop of {loop.strategy}, measured mean error by captures: {after} ({loop.stopped})")
    for name, ratio in result.ratios.items():
        print(f"{name}: {ratio:.3f}")
    for text in result.warnings:
        say(f"worse than direct light alone: {text}")
    if result.report is not None:
        print(f"report: {result.report}")


def write_strategies_page(session: Session, result: ComparisonResult, on_step: OnStep) -> Path:
    """Write strategies.html into the session and return its path."""
    total = len(result.pictures)
    shown = []
    for k, picture in enumerate(result.pictures):
        on_step("write page of strategies", k, total)
        shown.append(_picture_section(session, result, picture))
    best = min(_all_rows(result, result.pictures[0]), key=lambda row: row.figures.shown.mean)
    none = result.pictures[0].row("none").shown
    headline = [
        headline_of(best.figures.shown.mean, "grey levels of 255", f"measured mean error of {best.title}, the least"),
        headline_of(none.mean, "grey levels", "uncompensated, at its best single gain"),
        headline_of(none.noise_rms or 0.0, "grey levels", "noise of the camera (rms), part of every measured error"),
    ]
    context = _frame(f"Strategies: session {session.path.name}", session.profile.description, result)
    context |= {"headline": headline, "pictures": shown, "warnings": result.warnings}
    context |= {"recommendation": recommendation(result)}
    path = session.path / PAGE
    write_bytes(path, rendered("strategies/strategies.html", context).encode())
    link_pages(session.path)
    on_step("write page of strategies", total, total)
    return path


def paper_page(result: ComparisonResult, images: Mapping[str, PaperPictures]) -> str:
    """The page of the paper's configurations.

    Parameters
    ----------
    images : mapping
        What each configuration shows, by its name.
    """
    sections = [_paper_section(picture, images[picture.name]) for picture in result.pictures]
    return rendered(
        "strategies/strategies.html",
        _frame("Strategies on the paper's configurations", "Simulated, Dehos et al. 2014; nothing is measured.", result)
        | {"headline": [], "pictures": sections, "warnings": result.warnings, "recommendation": ()},
    )


def _frame(title: str, subtitle: str, result: ComparisonResult) -> dict[str, object]:
    warned = len(result.warnings)
    return {
        "title": title,
        "subtitle": subtitle,
        "met": True,
        "word": counted(len(result.pictures[0].rows), "strategy", "strategies"),
        "verdict": f"{counted(len(result.pictures), 'picture')}; {counted(warned, 'result')} worse than direct light "
        "alone",
        "words": explained(_words_of(result)),
        "legend": LEGEND,
        "error_scale": figures.error_scale(),
        "footer": f"Written {datetime.now(UTC):%Y-%m-%d %H:%M} UTC by procam-rig.",
    }


def _words_of(result: ComparisonResult) -> list[str]:
    """What the page's tables and grids call things."""
    rows = _all_rows(result, result.pictures[0])
    return [*(row.title for row in rows), *_table(rows)[0]]


def _all_rows(result: ComparisonResult, picture: ComparedPicture) -> list[TitledRow]:
    """A picture's rows with titles; for the first picture also closed loops, and strategies that know the world."""
    rows = [TitledRow(row.strategy, row) for row in picture.rows]
    if picture is not result.pictures[0]:
        return rows
    rows += [
        TitledRow(f"{loop.strategy}, closed loop", _row_of(loop, picture), is_timed=False) for loop in result.loops
    ]
    return rows + [TitledRow(f"{row.strategy}, world known", row, is_timed=False) for row in result.oracle]


def _row_of(loop: ClosedLoop, picture: ComparedPicture) -> StrategyRow:
    """A closed loop as a row: the strategy's own effort, the kept picture's errors."""
    own = next((row for row in picture.rows if row.strategy == loop.strategy), StrategyRow(strategy=loop.strategy))
    return replace(own, measured=loop.kept, predicted=None, captures=loop.best, clipped_share=None)


_ERRORS = (
    ("mean", "mean", ".2f"),
    ("sd", "sd", ".1f"),
    ("max", "max", ".0f"),
    ("rms", "rms", ".2f"),
    ("bias", "bias", "+.1f"),
    ("ΔE", "delta_e_2000", ".2f"),
    ("SSIM", "ssim", ".3f"),
    ("mean at best gain", "mean_at_best_gain", ".2f"),
)


def _table(rows: Sequence[TitledRow]) -> tuple[list[str], list[list[str]]]:
    measured = any(row.figures.measured for row in rows)
    contrasts = any(row.figures.shown.contrast is not None for row in rows)
    head = ["strategy", *(name for name, _, _ in _ERRORS)]
    head += (["predicted mean"] if measured else []) + (["contrast"] if contrasts else [])
    head += ["clipped %", "gain", "time s", "iterations"] + (["captures"] if measured else [])
    return head, [_cells(row, measured, contrasts) for row in rows]


def _cells(titled: TitledRow, measured: bool, contrasts: bool) -> list[str]:
    row, shown = titled.figures, titled.figures.shown
    cells = [titled.title, *(_number(getattr(shown, key), form) for _, key, form in _ERRORS)]
    cells += [_number(mean_of(row.predicted), ".2f")] if measured else []
    cells += [_number(shown.contrast, ".1f")] if contrasts else []
    cells += [_number(None if row.clipped_share is None else 100 * row.clipped_share, ".1f"), _number(row.gain, ".2f")]
    cells += [_number(row.seconds, ".2g"), _number(row.iterations, "d")]
    return cells + ([_number(row.captures, "d")] if measured else [])


def _number(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def _picture_section(session: Session, result: ComparisonResult, picture: ComparedPicture) -> dict[str, object]:
    step, model = session.finished(f"strategies-{picture.name}"), load_model(session)
    view, scale = judged_pixels(model, step), 255 / model.level
    rows = _all_rows(result, picture)
    head, cells = _table(rows)
    first = picture is result.pictures[0]
    return {
        "title": "The target" if first else picture.name.replace("-", " ").capitalize(),
        "text": f"{picture.sentence}. All pictures as the camera sees them; outside the judged area they are dimmed.",
        "heads": ("target", "projected", "predicted", "measured", "measured - target"),
        "rows": [_measured_row(step, picture.name, row.strategy, view=view, scale=scale) for row in picture.rows],
        "table": {"head": head, "rows": cells},
        "figures": _figures(result, rows) if first else [],
    }


def _figures(result: ComparisonResult, rows: Sequence[TitledRow]) -> list[dict[str, str]]:
    timed = [row for row in rows if row.is_timed]
    found = [
        ("Errors", "Mean error, measured and predicted.", errors_figure(rows)),
        ("Speed against error", "Further left is faster, further down is better.", speed_figure(timed, result.loops)),
    ]
    if result.loops:
        text = "The ring is the picture that was kept. Each capture is one picture shown and photographed."
        found.append(("Closed loop", text, loops_figure(result.loops, result.oracle)))
    return [{"title": title, "text": text, "src": pictures.svg(figure)} for title, text, figure in found]


def _measured_row(step: Step, picture: str, strategy: str, view: JudgedPixels, scale: float) -> dict[str, object]:
    target, mask = view.target, view.mask
    codes = codes_of(step.load_image(f"projector-{picture}-{strategy}"))
    predicted, measured = (
        image_of(step.load_image(f"{kind}-{picture}-{strategy}"), "light") * scale for kind in ("predicted", "measured")
    )
    images = [
        pictures.picture(pictures.photograph(target, mask), "Target as the camera should see it"),
        pictures.picture(codes, f"Codes sent to the projector, {strategy}"),
        pictures.picture(pictures.photograph(predicted, mask), f"Predicted camera image, {strategy}"),
        pictures.picture(pictures.photograph(measured, mask), f"Measured camera image, {strategy}"),
        pictures.picture(pictures.signed_error(measured - target, mask), f"Measured minus target, {strategy}"),
    ]
    return {"name": strategy, "images": images}


def _paper_section(picture: ComparedPicture, shown: PaperPictures) -> dict[str, object]:
    rows = [TitledRow(row.strategy, row) for row in picture.rows]
    head, cells = _table(rows)
    desired, seen = shown.desired, shown.seen
    grid = []
    for row in rows:
        projected, predicted = shown.projected[row.figures.strategy], shown.predicted[row.figures.strategy]
        images = [
            pictures.picture(pictures.photograph(desired, seen), "Target", 320),
            pictures.picture(pictures.photograph(projected), f"Projector image, {row.title}", 320),
            pictures.picture(pictures.photograph(predicted, seen), f"Seen in the room, {row.title}", 320),
            pictures.picture(pictures.signed_error(predicted - desired, seen), f"Difference, {row.title}", 320),
        ]
        grid.append({"name": row.title, "images": images})
    charts = [
        ("Errors", "Mean error.", errors_figure(rows)),
        ("Speed against error", "Further left is faster, further down is better.", speed_figure(rows)),
    ]
    return {
        "title": picture.title,
        "text": "",
        "heads": ("target", "projected", "predicted", "predicted - target"),
        "rows": grid,
        "table": {"head": head, "rows": cells},
        "figures": [{"title": t, "text": x, "src": pictures.svg(f)} for t, x, f in charts],
    }
