"""What a session has measured, as tables on the terminal."""

from __future__ import annotations

from rig.records import Record
from rig.report.terms import name_of
from rig.stages.results import PartialResult, SessionResult
from rig.terminal import print_table, say


def print_steps(title: str, steps: list[tuple[str, bool, int]]) -> None:
    """Print the steps of a session: name, whether it is done, and about how many frames it takes."""
    rows = [(name, "done" if done else "to do", frames or "") for name, done, frames in steps]
    print_table(title, ["step", "state", "frames"], rows)


def print_result(result: SessionResult) -> None:
    """Print what a compared session has measured."""
    if result.compensation.target is not None:
        say(f"target: {result.compensation.target.sentence}")
    rows = []
    for name, entry in result.strategies.items():
        measured, predicted = entry.measured, entry.predicted
        clipped = 100 * entry.clipped_share
        rows.append((name, measured.mean, measured.sd, measured.rms, measured.ssim, predicted.mean, clipped))
    head = ["strategy", "measured mean", "sd", "rms", "SSIM", "predicted mean", "clipped %"]
    print_table("Errors against the target, grey levels of 255", head, rows)
    limits = [(row.what, row.value, row.limit, row.unit, row.status) for row in result.limits]
    print_table("Limits", ["what", "value", "limit", "unit", ""], limits)
    for row in result.limits:
        if not row.met:
            say(f"{row.what}: {row.advice}")
    for figure in result.expected:
        if not figure.as_expected:
            say(
                f"{figure.what}: {figure.value:.3g} {figure.unit}, on this rig {figure.low:.3g} ... {figure.high:.3g} "
                f"is to be expected ({figure.because}); raised by {figure.raised_by}; {figure.remedy}"
            )
    if result.truth is not None:
        errors = [(name_of(key), value) for key, value in result.truth.as_json().items()]
        print_table("Error against the simulated world", ["what", "error"], errors)
    print(f"report: {result.report}")


def print_part(verb: str, result: PartialResult) -> None:
    """Print the numbers of the steps that a verb has done."""
    if result.compensation is not None and result.compensation.target is not None:
        say(f"target: {result.compensation.target.sentence}")
    sections = {
        "geometry": result.geometry,
        "separation": result.separation,
        "model": result.model,
        "compensation": result.compensation,
        "truth": result.truth,
    }
    rows = [row for name, section in sections.items() for row in _numbers(name, section)]
    print_table(f"rig {verb}: done", ["what", "value"], rows)


def _numbers(name: str, section: Record | None) -> list[tuple[str, float | str]]:
    if section is None:
        return []
    return [
        (f"{name}: {name_of(key)}", value)
        for key, value in section.as_json().items()
        if isinstance(value, int | float | str)
    ]
