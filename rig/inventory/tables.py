"""What is plugged in, for people: an overview, the lines for a profile, and everything on request."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from typing import Any

from rig.terminal import print_table


def print_devices(result: dict[str, Any], details: bool = False) -> None:
    """Tables of cameras, outputs, monitors and controllers; `details` adds formats, controls and modes."""
    _print_overview(result, empty=not details)
    if details:
        for camera in (one for one in result["cameras"] if not one["error"]):
            _print_camera(camera)
        for output in (one for one in result["outputs"] if one["modes"]):
            _print_modes(output)
    _print_remarks(result)
    _print_lines(result)


def _print_overview(result: dict[str, Any], empty: bool) -> None:
    """A table for each kind; `empty` shows that there are no cameras or outputs."""
    cameras = [(c["device_id"], c["name"], _best(c), _exposure(c), _speed(c)) for c in result["cameras"]]
    if cameras or empty:
        _print_rows("Cameras (V4L2)", ["device id", "name", "best for a rig", "exposure, ms", "USB, Mbit/s"], cameras)
    outputs = [(o["output"], o["status"], o["monitor_name"], _mode(o), _free(o)) for o in result["outputs"]]
    if outputs or empty:
        _print_rows("Display outputs", ["output", "status", "monitor", "mode", "card is free"], outputs)
    if result["monitors"]:
        monitors = [(m["name"], _mode(m), f"{m['x_px']}, {m['y_px']}") for m in result["monitors"]]
        _print_rows("Monitors of this desktop", ["name", "mode", "place, px"], monitors)
    if result["controllers"]:
        controllers = [(c["name"], c["usb_id"], c["serial"], c["bus_path"]) for c in result["controllers"]]
        _print_rows("Projector controllers on USB", ["model", "ids", "serial", "bus path"], controllers)


def _print_rows(title: str, columns: list[str], rows: Iterable[tuple[Any, ...]]) -> None:
    print_table(title, columns, list(rows) or [("none", *[""] * (len(columns) - 1))])


def _speed(camera: dict[str, Any]) -> str:
    return f"{camera['usb_speed_mbps']:g}" if camera["usb_speed_mbps"] else ""


def _best(camera: dict[str, Any]) -> str:
    keys = dict(line.split(" = ", 1) for line in camera["profile"][1:])
    if not keys:
        return "error" if camera["error"] else "nothing"
    rate = f" {float(keys['frame_rate_hz']):.3g} Hz" if "frame_rate_hz" in keys else ""
    return f"{keys['pixel_format'].strip(chr(34))} {keys['width_px']}x{keys['height_px']}{rate}"


def _exposure(camera: dict[str, Any]) -> str:
    if camera["exposure_range_s"] is None:
        return "" if camera["error"] else "no control"
    shortest, longest = camera["exposure_range_s"]
    return f"{shortest * 1e3:g} … {longest * 1e3:g}"


def _mode(one: dict[str, Any]) -> str:
    keys = dict(line.split(" = ", 1) for line in one["profile"][1:])
    if not keys:
        return ""
    rate = f", {float(keys['refresh_rate_hz']):.5g} Hz" if "refresh_rate_hz" in keys else ""
    return f"{keys['width_px']} x {keys['height_px']}{rate}"


def _free(output: dict[str, Any]) -> str:
    return {True: "yes", False: "no", None: "unknown"}[output["master_free"]]


def _print_camera(camera: dict[str, Any]) -> None:
    by_format = groupby(camera["formats"], key=lambda one: (one["pixel_format"], one["description"]))
    formats = [
        (name, description, f"{one['width_px']} x {one['height_px']}", _rates(one["frame_rates_hz"]))
        for (name, description), ones in by_format
        for one in ones
    ]
    title = f"{camera['name']}: formats"
    _print_rows(title, ["format", "meaning", "size", "frame rates, Hz"], formats)
    controls = [
        (c["name"], c["kind"], f"{c['minimum']} … {c['maximum']}", c["step"], c["default"], c["value"])
        for c in camera["controls"]
    ]
    head = ["control", "kind", "range", "step", "default", "now"]
    _print_rows(f"{camera['name']}: controls", head, controls)


def _rates(rates_hz: Iterable[float]) -> str:
    return " ".join(f"{rate:.4g}" for rate in rates_hz)


def _print_modes(output: dict[str, Any]) -> None:
    modes = [
        (f"{m['width_px']} x {m['height_px']}", m["refresh_rate_hz"], "preferred" if m["preferred"] else "")
        for m in output["modes"]
    ]
    _print_rows(f"{output['output']}: modes", ["size", "Hz", ""], modes)


def _print_remarks(result: dict[str, Any]) -> None:
    for one in (*result["cameras"], *result["outputs"]):
        if one["error"]:
            print(f"{one['name']}: {one['error']}")
        for warning in one["warnings"]:
            print(f"{one['name']}: {warning}")
        if one.get("known_as"):
            print(f"{one['name']}: facts of {one['known_as']} are in hw_profiles/cameras")
    for problem in result["problems"]:
        print(problem)


def _print_lines(result: dict[str, Any]) -> None:
    """TOML to paste, a block for each device that a rig can use."""
    blocks = [one for kind in ("cameras", "outputs", "monitors") for one in result[kind] if one["profile"]]
    if blocks:
        print("\nFor a profile (`rig profile new` writes a whole one):")
    for one in blocks:
        print("\n".join(["", f"# {one['name']}", *one["profile"]]))


def print_new_profile(result: dict[str, Any]) -> None:
    """What was written, what is only guessed, and what to do next."""
    print(f"{result['path']}: {result['camera']} and {result['output']} ({result['driver']})")
    for model in result["facts"]:
        print(f"cited facts of {model} are in it")
    print("only guessed, to be measured:")
    print("\n".join(f"  {key}" for key in result["to_measure"]))
    print(f"next: replace the guesses (docs/how-to/run-a-real-rig.md), then: rig check -p {result['path']}")
