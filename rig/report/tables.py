"""Results as tables on the terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Console

from rig.terminal import print_table

_PAPER_WIDTH = 128


def print_plan(plan: dict[str, Any]) -> None:
    """The steps of a session and the frames that they cost."""
    rows = [(s["step"], "done" if s["done"] else "to do", s["frames"] or "") for s in plan["steps"]]
    print_table(f"{plan['session']} with {plan['profile']}: about", ["step", "state", "frames"], rows)


def print_run(result: dict[str, Any]) -> None:
    """What a session has measured."""
    rows = []
    for name, entry in result["strategies"].items():
        measured, predicted = entry["measured"], entry["predicted"]
        clipped = 100 * entry["clipped_share"]
        rows.append(
            (name, measured["mean"], measured["sd"], measured["rms"], measured["ssim"], predicted["mean"], clipped)
        )
    head = ["strategy", "measured mean", "sd", "rms", "SSIM", "predicted mean", "clipped %"]
    print_table("Errors against the target, grey levels of 255", head, rows)
    limits = [(r["what"], r["value"], r["limit"], "ok" if r["passed"] else "OUTSIDE") for r in result["limits"]]
    print_table("Limits", ["what", "value", "limit", ""], limits)
    if result.get("truth"):
        print_table("Error against the simulated bench", ["what", "error"], list(result["truth"].items()))
    print(f"report: {result['report']}")


def print_part(verb: str, result: dict[str, Any]) -> None:
    """The numbers of the steps that a verb has done."""
    rows = []
    for section in ("geometry", "separation", "model", "compensation", "comparison", "truth"):
        for key, value in result.get(section, {}).items():
            if isinstance(value, int | float | str):
                rows.append((f"{section}: {key}", value))
    print_table(f"rig {verb}: done", ["what", "value"], rows)


def print_paper(result: dict[str, Any]) -> None:
    """The six configurations, the published figures under each; not narrower than it can be read."""
    from rig.paper.experiments import paper_table
    from rig.paper.scores import strategies_table

    console = Console(width=max(Console().width, _PAPER_WIDTH))
    console.print(paper_table(result))
    console.print(strategies_table(result["configurations"]))
    for name, text in result["conventions"].items():
        print(f"{name}: {text}")
    for text in result["exceptions"]:
        print(f"exception: {text}")


def print_simulation_plan(result: dict[str, Any]) -> None:
    """What is going to be done, why, and what it is expected to cost."""
    for reason in result["plan"]["reasons"]:
        print(f"- {reason}")
    estimated = result["estimated"]
    print(
        f"expected: {estimated['error']:.2g} %, {estimated['seconds']:.2g} s, {estimated['peak_mb']:.3g} MB", flush=True
    )


def print_simulation(result: dict[str, Any]) -> None:
    """Estimate and outcome."""
    rows = [(key, result["estimated"].get(key), value) for key, value in result["actual"].items()]
    print_table(f"{result['scene']} within {result['tolerance']:.3g} %", ["what", "estimated", "actual"], rows)


def print_scan(result: dict[str, Any]) -> None:
    """Point count, validity, epipolar distance."""
    print_table("Scan", ["what", "value"], list(result.items()))
