"""Simulations and scans as tables on the terminal."""

from __future__ import annotations

from rig.offline.records import ScanResult, SimulationResult
from rig.terminal import print_table, say


def print_simulation_plan(result: SimulationResult) -> None:
    """Print what is going to be done, why, and what it is expected to cost."""
    if result.mesh is not None:
        for remark in result.mesh.remarks:
            print(f"- mesh, {remark.outcome}: {remark.kind}: {remark.message}")
        if result.mesh.faults is not None:
            print(f"- mesh: facets in colours written to {result.mesh.faults}")
    for reason in result.plan.reasons:
        say(f"- {reason}")
    estimated = result.estimated
    print(f"expected: {estimated.error:.2g} %, {estimated.seconds:.2g} s, {estimated.peak_mb:.3g} MB", flush=True)


def print_simulation(result: SimulationResult) -> None:
    """Print estimate and outcome."""
    estimated = result.estimated.as_json()
    actual = {} if result.actual is None else result.actual.as_json()
    rows = [(key, estimated.get(key), value) for key, value in actual.items()]
    print_table(f"{result.scene} within {result.tolerance:.3g} %", ["what", "estimated", "actual"], rows)
    for path in result.files:
        print(f"written: {path}")


def print_scan(result: ScanResult) -> None:
    """Print point count, validity and epipolar distance, then what was mended and what is wrong."""
    said = ("mended", "warnings")
    print_table("Scan", ["what", "value"], [item for item in result.as_json().items() if item[0] not in said])
    for sentence in result.mended:
        say(f"mended: {sentence}")
    for sentence in result.warnings:
        say(f"warning: {sentence}")
