"""What `rig compare-strategies` prints, and its page with pictures and charts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from rig.files.atomic import write_bytes
from rig.files.channels import codes_of, image_of
from rig.report import figures, pictures
from rig.report.render import headline_of, rendered
from rig.session import Session, Step
from rig.stages.compensation import JudgedPixels, judged_pixels
from rig.stages.model import load_model
from rig.strategies.figures import errors_figure, loops_figure, speed_figure
from rig.terminal import OnStep

PAGE = "strategies.html"
_WIDTH = 150
TITLES = {
    "none": "none",
    "direct": "direct only",
    "paper": "paper",
    "exact": "exact inverse",
    "bounded": "bounded optimum",
}
"""Of strategies whose own name is no title; the others are called as they are, without underscores."""
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


def title_of(strategy: str) -> str:
    """A strategy's name in words."""
    return TITLES.get(strategy, strategy.replace("_", " "))


def print_strategies(result: Mapping[str, Any]) -> None:
    """A table a picture; then closed loops, perfect knowledge, warnings, and where the page is."""
    console = Console(width=max(Console().width, _WIDTH), highlight=False)
    for picture in result["pictures"]:
        table = Table(title=escape(f"{picture['name']}: {picture['title']}"), title_justify="left", box=SIMPLE_HEAD)
        head, rows = _table(_all_rows(result, picture))
        for k, cell in enumerate(head):
            table.add_column(cell, justify="left" if k == 0 else "right")
        for row in rows:
            table.add_row(*map(escape, row))
        console.print(table)
    for loop in result["loops"]:
        after = ", ".join(f"{number}: {errors['mean']:.2f}" for number, errors in loop["after"].items())
        print(f"closed loop of {loop['strategy']}, measured mean error by captures: {after} ({loop['stopped']})")
    for name, ratio in result["ratios"].items():
        print(f"{name}: {ratio:.3f}")
    for text in result["warnings"]:
        print(f"worse than direct light alone: {text}")
    if "report" in result:
        print(f"report: {result['report']}")


def write_strategies_page(session: Session, result: Mapping[str, Any], on_step: OnStep) -> Path:
    """Write strategies.html into the session and return its path."""
    total = len(result["pictures"])
    shown = []
    for k, picture in enumerate(result["pictures"]):
        on_step("write page of strategies", k, total)
        shown.append(_picture_section(session, result, picture))
    best = min(_all_rows(result, result["pictures"][0]), key=lambda row: float(row["measured"]["mean"]))
    none = next(row for row in result["pictures"][0]["rows"] if row["strategy"] == "none")
    headline = [
        headline_of(
            best["measured"]["mean"], "grey levels of 255", f"measured mean error of {best['title']}, the least"
        ),
        headline_of(none["measured"]["mean"], "grey levels", "uncompensated, at its best single gain"),
        headline_of(result["noise_rms"], "grey levels", "noise of the camera (rms), part of every measured error"),
    ]
    context = _frame(f"Strategies: session {session.path.name}", session.profile.description, result)
    context |= {"headline": headline, "pictures": shown, "warnings": result["warnings"]}
    path = session.path / PAGE
    write_bytes(path, rendered("strategies/strategies.html", context).encode())
    on_step("write page of strategies", total, total)
    return path


def paper_page(result: Mapping[str, Any], images: Mapping[str, Mapping[str, Any]]) -> str:
    """The page of the paper's configurations.

    Parameters
    ----------
    images : mapping
        By configuration: ``desired`` and by strategy ``projected`` and ``predicted``, (H, W) grey levels, and ``seen``.
    """
    sections = [_paper_section(picture, images[picture["name"]]) for picture in result["pictures"]]
    return rendered(
        "strategies/strategies.html",
        _frame("Strategies on the paper's configurations", "Simulated, Dehos et al. 2014; nothing is measured.", result)
        | {"headline": [], "pictures": sections, "warnings": result["warnings"]},
    )


def _frame(title: str, subtitle: str, result: Mapping[str, Any]) -> dict[str, Any]:
    warned = len(result["warnings"])
    return {
        "title": title,
        "subtitle": subtitle,
        "passed": True,
        "word": f"{len(result['pictures'][0]['rows'])} strategies",
        "verdict": f"{len(result['pictures'])} pictures; {warned} results are worse than direct light alone",
        "legend": LEGEND,
        "error_scale": figures.error_scale(),
        "footer": f"Written {datetime.now(UTC):%Y-%m-%d %H:%M} UTC by procam-rig.",
    }


def _all_rows(result: Mapping[str, Any], picture: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A picture's rows with titles; for the first picture also closed loops and perfect knowledge."""
    rows = [{**row, "title": title_of(row["strategy"])} for row in picture["rows"]]
    if picture is not result["pictures"][0]:
        return rows
    for loop in result.get("loops", ()):
        base = next((row for row in rows if row["strategy"] == loop["strategy"]), None)
        measured = loop["captures"][loop["best"] - 1]
        taken = {
            "measured": measured,
            "predicted": None,
            "captures": loop["best"],
            "strategy": "",
            "clipped_share": None,
        }
        rows.append({**(base or _EMPTY), **taken, "title": f"{title_of(loop['strategy'])}, closed loop"})
    for row in result.get("perfect", ()):
        rows.append({**row, "title": f"{title_of(row['strategy'])}, perfect knowledge"})
    return rows


_EMPTY = {"gain": None, "seconds": None, "iterations": None}
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


def _table(rows: Sequence[Mapping[str, Any]]) -> tuple[list[str], list[list[str]]]:
    measured = any(row.get("measured") for row in rows)
    contrasts = any(_shown(row).get("contrast") is not None for row in rows)
    head = ["strategy", *(name for name, _, _ in _ERRORS)]
    head += (["predicted mean"] if measured else []) + (["contrast"] if contrasts else [])
    head += ["clipped %", "gain", "time s", "iterations"] + (["captures"] if measured else [])
    return head, [_cells(row, measured, contrasts) for row in rows]


def _cells(row: Mapping[str, Any], measured: bool, contrasts: bool) -> list[str]:
    shown = _shown(row)
    cells = [row["title"], *(_number(shown.get(key), form) for _, key, form in _ERRORS)]
    cells += [_number((row.get("predicted") or {}).get("mean"), ".2f")] if measured else []
    cells += [_number(shown.get("contrast"), ".1f")] if contrasts else []
    clipped = row.get("clipped_share")
    cells += [_number(None if clipped is None else 100 * clipped, ".1f"), _number(row.get("gain"), ".2f")]
    cells += [_number(row.get("seconds"), ".2g"), _number(row.get("iterations"), "d")]
    return cells + ([_number(row.get("captures"), "d")] if measured else [])


def _shown(row: Mapping[str, Any]) -> Mapping[str, Any]:
    found: Mapping[str, Any] = row.get("measured") or row["predicted"]
    return found


def _number(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def _picture_section(session: Session, result: Mapping[str, Any], picture: Mapping[str, Any]) -> dict[str, Any]:
    step, model = session.finished(f"strategies-{picture['name']}"), load_model(session)
    view, scale = judged_pixels(model, step), 255 / model.level
    rows = _all_rows(result, picture)
    head, cells = _table(rows)
    first = picture is result["pictures"][0]
    return {
        "title": "The target" if first else picture["name"].replace("-", " ").capitalize(),
        "text": f"{picture['title']}. All pictures as the camera sees them; outside the judged area they are dimmed.",
        "heads": ("target", "projected", "predicted", "measured", "measured - target"),
        "rows": [_measured_row(step, picture["name"], row["strategy"], view, scale) for row in picture["rows"]],
        "table": {"head": head, "rows": cells},
        "figures": _figures(result, rows) if first else [],
    }


def _figures(result: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    loops = [{**loop, "title": title_of(loop["strategy"])} for loop in result.get("loops", ())]
    perfect = [{**row, "title": title_of(row["strategy"])} for row in result.get("perfect", ())]
    timed = [row for row in rows if row["strategy"] and "perfect" not in row["title"]]
    found = [
        ("Errors", "Mean error, measured and predicted.", errors_figure(rows)),
        ("Speed against error", "Further left is faster, further down is better.", speed_figure(timed, loops)),
    ]
    if loops:
        text = "The ring is the picture that was kept. Each capture is one picture shown and photographed."
        found.append(("Closed loop", text, loops_figure(loops, perfect)))
    return [{"title": title, "text": text, "src": pictures.svg(figure)} for title, text, figure in found]


def _measured_row(step: Step, picture: str, strategy: str, view: JudgedPixels, scale: float) -> dict[str, Any]:
    target, mask = view.target, view.mask
    codes = codes_of(step.load_image(f"projector-{picture}-{strategy}"))
    predicted, measured = (
        image_of(step.load_image(f"{kind}-{picture}-{strategy}"), "light") * scale for kind in ("predicted", "measured")
    )
    images = [
        pictures.picture(pictures.photograph(target, mask), "Target as the camera should see it", 320),
        pictures.picture(codes, f"Codes sent to the projector, {strategy}", 320),
        pictures.picture(pictures.photograph(predicted, mask), f"Predicted camera image, {strategy}", 320),
        pictures.picture(pictures.photograph(measured, mask), f"Measured camera image, {strategy}", 320),
        pictures.picture(pictures.signed_error(measured - target, mask), f"Measured minus target, {strategy}", 320),
    ]
    return {"name": title_of(strategy), "images": images}


def _paper_section(picture: Mapping[str, Any], shown: Mapping[str, Any]) -> dict[str, Any]:
    rows = [{**row, "title": title_of(row["strategy"])} for row in picture["rows"]]
    head, cells = _table(rows)
    desired, seen = shown["desired"], shown["seen"]
    grid = []
    for row in rows:
        projected, predicted = shown["projected"][row["strategy"]], shown["predicted"][row["strategy"]]
        images = [
            pictures.picture(pictures.photograph(desired, seen), "Target", 240),
            pictures.picture(pictures.photograph(projected), f"Projector image, {row['title']}", 240),
            pictures.picture(pictures.photograph(predicted, seen), f"Seen in the room, {row['title']}", 240),
            pictures.picture(pictures.signed_error(predicted - desired, seen), f"Difference, {row['title']}", 240),
        ]
        grid.append({"name": row["title"], "images": images})
    charts = [
        ("Errors", "Mean error.", errors_figure(rows)),
        ("Speed against error", "Further left is faster, further down is better.", speed_figure(rows)),
    ]
    return {
        "title": picture["title"],
        "text": picture.get("text", ""),
        "heads": ("target", "projected", "predicted", "predicted - target"),
        "rows": grid,
        "table": {"head": head, "rows": cells},
        "figures": [{"title": t, "text": x, "src": pictures.svg(f)} for t, x, f in charts],
    }
