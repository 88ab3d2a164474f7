"""What is plugged in, for people: an overview, the lines for a profile, and everything on request."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

from rig.inventory.found import Asked, DeviceList, ListedCamera, ListedOutput, Pasted, ShownMode
from rig.inventory.new_profile import NewProfile
from rig.plug_ins import PlugIn
from rig.terminal import print_table


def print_devices(result: DeviceList, details: bool = False) -> None:
    """Print tables of cameras, outputs, monitors and controllers; `details` adds formats, controls and modes."""
    _print_overview(result, empty=not details)
    if details:
        for camera in result.cameras:
            _print_camera(camera)
        for output in result.outputs:
            _print_modes(output)
    _print_plug_ins(result.plug_ins)
    _print_remarks(result)
    _print_lines(result)


def _print_overview(result: DeviceList, empty: bool) -> None:
    """A table for each kind; `empty` shows that there are no cameras or outputs."""
    cameras = [(c.found.device_id, c.name, _best(c), _exposure(c), _speed(c)) for c in result.cameras]
    if cameras or empty:
        _print_rows("Cameras (V4L2)", ["device id", "name", "best for a rig", "exposure, ms", "USB, Mbit/s"], cameras)
    buses = [(c.driver, c.device_id, c.name, c.address) for c in result.bus_cameras]
    if buses:
        _print_rows("GigE, USB3 and still cameras", ["driver", "device id", "model", "address"], buses)
    outputs = [(o.output, o.found.status, o.found.monitor_name, _mode(o.mode), _free(o)) for o in result.outputs]
    if outputs or empty:
        _print_rows("Display outputs", ["output", "status", "monitor", "mode", "card is free"], outputs)
    if result.monitors:
        monitors = [(m.name, _mode(m.mode), f"{m.found.x_px}, {m.found.y_px}") for m in result.monitors]
        _print_rows("Monitors of this desktop", ["name", "mode", "place, px"], monitors)
    if result.controllers:
        controllers = [(c.name, c.usb_id, c.serial, c.bus_path) for c in result.controllers]
        _print_rows("Projector controllers on USB", ["model", "ids", "serial", "bus path"], controllers)


def _print_rows(title: str, columns: list[str], rows: Sequence[tuple[object, ...]]) -> None:
    print_table(title, columns, list(rows) or [("none", *[""] * (len(columns) - 1))])


def _speed(camera: ListedCamera) -> str:
    return f"{camera.found.usb_speed_mbps:g}" if camera.found.usb_speed_mbps else ""


def _best(camera: ListedCamera) -> str:
    mode = camera.mode
    if mode is None:
        return "error" if camera.error else "nothing"
    rate = f" {mode.frame_rate_hz:.3g} Hz" if mode.frame_rate_hz is not None else ""
    return f"{mode.pixel_format} {mode.width_px}x{mode.height_px}{rate}"


def _exposure(camera: ListedCamera) -> str:
    if camera.exposure_range_s is None:
        return "" if camera.error else "no control"
    shortest, longest = camera.exposure_range_s
    return f"{shortest * 1e3:g} … {longest * 1e3:g}"


def _mode(mode: ShownMode | None) -> str:
    if mode is None:
        return ""
    rate = f", {mode.refresh_rate_hz:.5g} Hz" if mode.refresh_rate_hz else ""
    return f"{mode.width_px} x {mode.height_px}{rate}"


def _free(output: ListedOutput) -> str:
    return {True: "yes", False: "no", None: "unknown"}[output.master_free]


def _print_camera(camera: ListedCamera) -> None:
    if camera.able is None:
        return
    by_format = groupby(camera.able.formats, key=lambda one: (one.pixel_format, one.description))
    formats = [
        (name, description, f"{one.width_px} x {one.height_px}", _rates(one.frame_rates_hz))
        for (name, description), ones in by_format
        for one in ones
    ]
    title = f"{camera.name}: formats"
    _print_rows(title, ["format", "meaning", "size", "frame rates, Hz"], formats)
    controls = [
        (c.name, c.kind, f"{c.minimum} … {c.maximum}", c.step, c.default, c.value) for c in camera.able.controls
    ]
    head = ["control", "kind", "range", "step", "default", "now"]
    _print_rows(f"{camera.name}: controls", head, controls)


def _rates(rates_hz: Iterable[float]) -> str:
    return " ".join(f"{rate:.4g}" for rate in rates_hz)


def _print_modes(output: ListedOutput) -> None:
    modes = [
        (f"{mode.width_px} x {mode.height_px}", mode.refresh_rate_hz, "preferred" if mode.preferred else "")
        for mode in output.found.modes
    ]
    if modes:
        _print_rows(f"{output.output}: modes", ["size", "Hz", ""], modes)


def _print_plug_ins(plug_ins: tuple[PlugIn, ...]) -> None:
    """A row for each package and kind."""
    by_source = groupby(plug_ins, key=lambda one: (one.kind, one.source))
    rows = [(kind, ", ".join(one.name for one in ones), source) for (kind, source), ones in by_source]
    if rows:
        _print_rows("Installed drivers, strategies and codes", ["kind", "names", "package"], rows)


def _print_remarks(result: DeviceList) -> None:
    asked: tuple[Asked, ...] = (*result.cameras, *result.outputs)
    for one in asked:
        if one.error:
            print(f"{one.name}: {one.error}")
        for warning in one.warnings:
            print(f"{one.name}: {warning}")
        if isinstance(one, ListedCamera) and one.known_as:
            print(f"{one.name}: facts of {one.known_as} are in hw_profiles/cameras")
    for camera in result.bus_cameras:
        if camera.error:
            print(f"{camera.name}: {camera.error}")
    for problem in result.problems:
        print(problem)


def _print_lines(result: DeviceList) -> None:
    """TOML to paste, a block for each device that a rig can use."""
    listed: tuple[Pasted, ...] = (*result.cameras, *result.bus_cameras, *result.outputs, *result.monitors)
    blocks = [one for one in listed if one.profile]
    if blocks:
        print("\nFor a profile (`rig profile new` writes a whole one):")
    for one in blocks:
        print("\n".join(["", f"# {one.name}", *one.profile]))


def print_new_profile(result: NewProfile) -> None:
    """Print what was written, what is only guessed, and what to do next."""
    print(f"{result.path}: {result.camera} and {result.output} ({result.driver})")
    for model in result.facts:
        print(f"cited facts of {model} are in it")
    print("only guessed, to be measured:")
    print("\n".join(f"  {key}" for key in result.to_measure))
    print(f"next: replace the guesses (docs/how-to/run-a-real-rig.md), then: rig check -p {result.path}")
