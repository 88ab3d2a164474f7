"""What a session has measured, as tables on the terminal."""

from __future__ import annotations

from typing import Any

from rig.terminal import print_table


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
        print_table("Error against the simulated world", ["what", "error"], list(result["truth"].items()))
    print(f"report: {result['report']}")


def print_part(verb: str, result: dict[str, Any]) -> None:
    """The numbers of the steps that a verb has done."""
    rows = []
    for section in ("geometry", "separation", "model", "compensation", "comparison", "truth"):
        for key, value in result.get(section, {}).items():
            if isinstance(value, int | float | str):
                rows.append((f"{section}: {key}", value))
    print_table(f"rig {verb}: done", ["what", "value"], rows)
