"""Problems of a profile that no single table shows: names, drivers that go together, tables that a driver needs.

They are looked for in what TOML gave, so that they are found even when single keys are wrong.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from rig.devices.drivers import CAMERAS, PROJECTORS, RIGS, WITH_OPTIONS, driver_names
from rig.files.toml import entry_place


class _NamedTable(NamedTuple):
    kind: str
    """camera or projector."""
    place: str
    """How messages call it."""
    table: Mapping[str, Any]

    @property
    def driver(self) -> object:
        return self.table.get("driver")

    @property
    def name(self) -> object:
        return self.table.get("name")


def problems_between_tables(data: Mapping[str, Any]) -> list[str]:
    """Return a line ``table.key: what`` for each problem."""
    cameras, projectors = list(_devices(data, "camera")), list(_devices(data, "projector"))
    return [
        *_repeated_names([*cameras, *projectors]),
        *(line for device in (*cameras, *projectors) for line in _driver_problems(device)),
        *_mixed_drivers(cameras, projectors),
        *_needed_tables(data, cameras),
        *_unknown_names(data, cameras, projectors),
        *_unlike_the_simulation(data, cameras, projectors),
        *_jpeg_of_many_bits(data, cameras),
        *_spots_outside(data, projectors),
        *_checks_beyond_the_picture(data, projectors),
    ]


def _pictures(projectors: list[_NamedTable]) -> dict[object, tuple[int, int]]:
    """Width and height in pixels of each projector that has them, by its name."""
    sizes = {one.name: (one.table.get("width_px"), one.table.get("height_px")) for one in projectors}
    return {name: (w, h) for name, (w, h) in sizes.items() if isinstance(w, int) and isinstance(h, int)}


def _spots_outside(data: Mapping[str, Any], projectors: list[_NamedTable]) -> Iterator[str]:
    """Spots that no pixel of their projector is."""
    pictures, scales = _pictures(projectors), _listed(data, "scale")
    for k, scale in enumerate(scales):
        if not isinstance(scale, dict) or scale.get("projector") not in pictures:
            continue
        width, height = pictures[scale["projector"]]
        for spot in _listed(scale, "spots_px"):
            if isinstance(spot, list) and len(spot) == 2 and all(isinstance(x, int | float) for x in spot):
                if 0 <= spot[0] <= width - 1 and 0 <= spot[1] <= height - 1:
                    continue
                yield (
                    f"scale{entry_place(scales, k)}.spots_px: {spot} is outside the projector's {width} x {height} px; "
                    "give x and y of pixels that `rig show spots` lights"
                )


def _checks_beyond_the_picture(data: Mapping[str, Any], projectors: list[_NamedTable]) -> Iterator[str]:
    """Checks of which fewer than two fit in a picture."""
    patterns = data.get("patterns")
    checker_px = patterns.get("checker_size_px") if isinstance(patterns, dict) else None
    for name, (width, height) in _pictures(projectors).items():
        if isinstance(checker_px, int) and 2 * checker_px > min(width, height):
            yield (
                f"patterns.checker_size_px: is {checker_px}, {name} has {width} x {height} px: fewer than two checks "
                "fit; give smaller ones"
            )


def _devices(data: Mapping[str, Any], kind: str) -> Iterator[_NamedTable]:
    """The tables of one kind, as far as they are tables."""
    entries = _listed(data, kind)
    for index, table in enumerate(entries):
        if isinstance(table, dict):
            yield _NamedTable(kind, f"{kind}{entry_place(entries, index)}", table)


def _listed(data: Mapping[str, Any], key: str) -> list[object]:
    entries = data.get(key)
    return entries if isinstance(entries, list) else []


def _repeated_names(devices: list[_NamedTable]) -> Iterator[str]:
    seen: set[object] = set()
    for device in devices:
        if isinstance(device.name, str) and device.name in seen:
            yield f"{device.place}.name: {device.name!r} is taken; each camera and projector has a name of its own"
        seen.add(device.name)


def _driver_problems(device: _NamedTable) -> Iterator[str]:
    """A driver that there is none of, and keys that say which device: needed by some drivers, allowed to few."""
    driver, kind = device.driver, device.kind
    known = driver_names("camera driver" if kind == "camera" else "projector driver") if isinstance(driver, str) else ()
    if isinstance(driver, str) and driver not in known:
        yield f"{device.place}.driver: is {driver!r}, should be one of {', '.join(known)} (`rig devices` lists them)"
    own = tuple(CAMERAS if kind == "camera" else PROJECTORS)
    for key in ("device_id", "pixel_format") if kind == "camera" else ("output",):
        if driver in own and key not in device.table:
            yield f"{device.place}.{key}: missing; `rig devices` prints it"
        elif driver in RIGS and key in device.table:
            yield f"{device.place}.{key}: only for driver = {' or '.join(map(repr, own))}; remove it"
    if (driver in own or driver in RIGS) and driver not in WITH_OPTIONS and "options" in device.table:
        yield f"{device.place}.options: only for {', '.join(WITH_OPTIONS)} and drivers of other packages; remove it"


def _mixed_drivers(cameras: list[_NamedTable], projectors: list[_NamedTable]) -> Iterator[str]:
    """Simulated and replayed devices come together; the others in any mixture."""
    driver = cameras[0].driver if cameras else None
    if not isinstance(driver, str) or driver not in driver_names("camera driver"):
        return
    whose = "the camera's" if len(cameras) == 1 else f"{cameras[0].place}'s"
    for device in (*cameras[1:], *projectors):
        if not isinstance(device.driver, str) or device.driver == driver or not {driver, device.driver} & {*RIGS}:
            continue
        if device.driver not in driver_names("camera driver" if device.kind == "camera" else "projector driver"):
            continue
        fitting = [driver] if driver in RIGS else [*(CAMERAS if device.kind == "camera" else PROJECTORS)]
        yield (
            f"{device.place}.driver: {device.driver!r}, but {whose} is {driver!r}; it has to be "
            f"{' or '.join(map(repr, fitting))}"
        )


def _needed_tables(data: Mapping[str, Any], cameras: list[_NamedTable]) -> Iterator[str]:
    driver = cameras[0].driver if cameras else None
    for table, needed in (("simulation", "simulated"), ("replay", "replay")):
        if driver == needed and table not in data:
            yield f"{table}: missing; driver = {needed!r} needs a [{table}] table"
    for table, allowed in (("simulation", ("simulated", *CAMERAS)), ("replay", ("replay",))):
        if driver in (*CAMERAS, *RIGS) and driver not in allowed and table in data:
            which = " or ".join(map(repr, allowed))
            yield f"{table}: only for driver = {which}, the camera's is {driver!r}; remove the table"


def _unknown_names(data: Mapping[str, Any], cameras: list[_NamedTable], projectors: list[_NamedTable]) -> Iterator[str]:
    """Lengths and the viewer name devices that are there."""
    entries = _listed(data, "scale")
    for index, length in enumerate(entries):
        if not isinstance(length, dict):
            continue
        place = f"scale{entry_place(entries, index)}"
        joined = length.get("between")
        for name in joined if isinstance(joined, list) else []:
            yield from _unknown(f"{place}.between", name, [*cameras, *projectors])
        if isinstance(joined, list) and len(joined) == 2 and joined[0] == joined[1]:
            yield f"{place}.between: is {joined[0]!r} twice; name the two devices that the tape joins"
        yield from _unknown(f"{place}.projector", length.get("projector"), projectors)
    viewer = data.get("viewer")
    if isinstance(viewer, dict):
        yield from _unknown("viewer.camera", viewer.get("camera"), cameras)


def _unknown(place: str, name: object, devices: list[_NamedTable]) -> Iterator[str]:
    names = [device.name for device in devices if isinstance(device.name, str)]
    if not isinstance(name, str) or name in names or not names:
        return
    near = difflib.get_close_matches(name, names, n=1)
    meant = f"; did you mean {near[0]}?" if near else f"; there are {', '.join(names)}"
    yield f"{place}: no {' or '.join(dict.fromkeys(device.kind for device in devices))} is named {name!r}{meant}"


def _unlike_the_simulation(
    data: Mapping[str, Any], cameras: list[_NamedTable], projectors: list[_NamedTable]
) -> Iterator[str]:
    """Each device has its truth in the simulation, and nothing else has."""
    simulation = data.get("simulation")
    if not isinstance(simulation, dict):
        return
    for kind, devices in (("camera", cameras), ("projector", projectors)):
        truths = list(_devices(simulation, kind))
        strangers = [line for one in truths for line in _unknown(f"simulation.{one.place}.name", one.name, devices)]
        yield from strangers
        named = {truth.name for truth in truths}
        for device in devices:
            if isinstance(device.name, str) and truths and device.name not in named and not strangers:
                yield f"simulation.{kind}: none is named {device.name!r}, as [[{kind}]] is; give each its truth"
        yield from (f"simulation.{line}" for line in _repeated_names(truths))


def _jpeg_of_many_bits(data: Mapping[str, Any], cameras: list[_NamedTable]) -> Iterator[str]:
    """JPEG as cameras stream it has eight bits."""
    simulation = data.get("simulation")
    bits = {camera.name: camera.table.get("bit_depth") for camera in cameras if isinstance(camera.name, str)}
    for truth in _devices(simulation, "camera") if isinstance(simulation, dict) else ():
        found = bits.get(truth.name, 8) if isinstance(truth.name, str) else 8
        if "jpeg_quality" in truth.table and found != 8:
            yield f"simulation.{truth.place}.jpeg_quality: the camera has bit_depth = {found}; JPEG goes with 8"
