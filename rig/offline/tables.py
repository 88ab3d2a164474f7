"""Simulations and scans as tables on the terminal."""

from __future__ import annotations

from typing import Any

from rig.terminal import print_table


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
