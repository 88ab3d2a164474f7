"""What `rig lenses` prints."""

from __future__ import annotations

from rig.lenses.records import DeviceLens, LensesResult
from rig.terminal import print_table, say


def print_lenses(result: LensesResult) -> None:
    """Print lenses, views and limits, and what to do next."""
    rows = [row for device in result.devices for row in _rows(device)]
    if result.pose is not None:
        rows.append(("pair", "baseline, m", f"{result.pose.baseline_m:.5f} ± {result.pose.baseline_sigma_m:.5f}"))
    if any(result.flex_mm):
        bend = " / ".join(f"{v:.3f} ± {s:.3f}" for v, s in zip(result.flex_mm, result.flex_sigma_mm, strict=True))
        rows.append(("board", "bend along columns / rows / twist, mm", bend))
    if result.stretch:
        stretch = f"{100 * result.stretch:+.3f} ± {100 * result.stretch_sigma:.3f}"
        rows.append(("board", "squares longer down than across, %", stretch))
    print_table(f"Lenses, rms {result.rms_px:.3f} px", ["device", "what", "value"], rows)
    worst = sorted(result.views, key=lambda view: -(view.camera_rms_px or 0))[:12]
    head = ["view", "corners", "camera rms, px", "projector rms, px", "tilt, deg", "used"]
    lines = [
        (v.name, v.corners, _px(v.camera_rms_px), _px(v.projector_rms_px), _deg(v.tilt_deg), "yes" if v.used else "NO")
        for v in worst
    ]
    print_table(f"Views, {len(result.views)} in all, the worst first", head, lines)
    limits = [(row.what, row.value if row.value is not None else "-", row.limit, row.status) for row in result.limits]
    print_table("Limits", ["what", "value", "limit", ""], limits)
    for row in result.limits:
        if not row.met:
            say(f"{row.what}: {row.advice}")
    for line in result.warnings:
        say(line)
    say(f"next pose: {result.next_pose}")
    print(f"lens file: {result.output}" + (f"\nreport: {result.report}" if result.report else ""))


def _px(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _deg(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"


def _rows(device: DeviceLens) -> list[tuple[str, str, str]]:
    (fx, fy), (sx, sy) = device.focal_px, device.focal_sigma_px
    (cx, cy), (px, py) = device.principal_point_px, device.principal_point_sigma_px
    middle, median, worst = device.projection_sigma_px
    rows = [
        ("focal length, px", f"{fx:.2f} ± {sx:.2f}, {fy:.2f} ± {sy:.2f}"),
        ("principal point, px", f"{cx:.2f} ± {px:.2f}, {cy:.2f} ± {py:.2f}"),
        (f"distortion ({device.model})", " ".join(f"{term:.4g}" for term in device.distortion)),
        ("rms of its corners, px", f"{device.rms_px:.3f} ({device.corners} corners, {device.left_out} left out)"),
        ("uncertainty of projection, px", f"{middle:.3f} middle, {median:.3f} median, {worst:.3f} worst"),
    ]
    if device.halves is not None:
        both = f"{device.halves.difference_px:.3f}, expected {device.halves.expected_px:.3f}"
        rows.append(("halves of the views differ, px", both))
    return [(device.name, what, value) for what, value in rows]
