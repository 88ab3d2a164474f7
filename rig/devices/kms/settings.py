"""What has to be set so that an output shows codes as they are: mode, one layer, nothing scaled, nothing corrected."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rig.devices.kms import abi
from rig.devices.kms.card import Card, Change, Connector, Mode, Plane, Property
from rig.errors import DeviceBusy, SettingRefused

REFRESH_TOLERANCE_HZ = 0.5
"""60 in a profile is 59.94 of a display."""

Properties = dict[str, Property]

_NEUTRAL_CONTROLLER = {"GAMMA_LUT": 0, "DEGAMMA_LUT": 0, "CTM": 0, "VRR_ENABLED": 0, "Dither": "off"}
_NEUTRAL_PLANE = {"rotation": "rotate-0", "alpha": 0xFFFF}
_NEUTRAL_CONNECTOR = {
    "max bpc": 8,
    "Broadcast RGB": "Full",
    "underscan": "off",
    "scaling mode": "None",
    "content type": "Graphics",
    "Colorspace": "Default",
    "dithering mode": "off",
    "dither": "off",
    "link-status": "Good",
}
"""Properties that would change the picture, and what leaves it alone; drivers have some of them."""
_BLOBS = ("GAMMA_LUT", "DEGAMMA_LUT", "CTM")


@dataclass(frozen=True, slots=True, kw_only=True)
class Path:
    """The way of a picture: plane, controller, connector; with their properties."""

    connector: int
    controller: int
    plane: int
    other_planes: tuple[int, ...]
    """Layers that the controller shows now: cursor, overlays."""
    connector_properties: Properties
    controller_properties: Properties
    plane_properties: Properties


def choose_mode(modes: tuple[Mode, ...], shape: tuple[int, int], refresh_rate_hz: float, connector: str) -> Mode:
    """The mode of exactly this size and the nearest refresh rate.

    Raises SettingRefused, with all modes, when none lies within 0.5 Hz.
    """
    fitting = [mode for mode in modes if (mode.height_px, mode.width_px) == shape]
    nearest = min(fitting, key=lambda mode: abs(mode.refresh_rate_hz - refresh_rate_hz), default=None)
    if nearest is not None and abs(nearest.refresh_rate_hz - refresh_rate_hz) <= REFRESH_TOLERANCE_HZ:
        return nearest
    offered = ", ".join(dict.fromkeys(map(_described, modes))) or "none"
    raise SettingRefused(
        f"{connector} has no mode of {shape[1]} x {shape[0]} px at {refresh_rate_hz:g} Hz "
        f"(± {REFRESH_TOLERANCE_HZ:g} Hz); write one of its modes into the profile: {offered}"
    )


def _described(mode: Mode) -> str:
    return f"{mode.width_px} x {mode.height_px} at {mode.refresh_rate_hz:.2f} Hz"


def choose_path(card: Card, connector: Connector) -> Path:
    """The connector's own controller, or a free one, and a plane that can show our pixels on it.

    Raises DeviceBusy when every controller shows other pictures, SettingRefused when no plane fits.
    """
    properties = card.properties(connector.id)
    controller = _controller(card, connector, properties["CRTC_ID"].value)
    planes = [plane for plane in card.planes() if controller in plane.controllers]
    types = {plane.id: card.properties(plane.id) for plane in planes}
    fitting = [plane for plane in planes if _is_usable(plane, types[plane.id], controller)]
    if not fitting:
        raise SettingRefused(
            f"{card.name} has no plane for {connector.name} that shows 32-bit pixels; use driver = 'window'"
        )
    plane = fitting[0].id
    return Path(
        connector=connector.id,
        controller=controller,
        plane=plane,
        other_planes=tuple(each.id for each in planes if each.id != plane and each.shown_by == controller),
        connector_properties=properties,
        controller_properties=card.properties(controller),
        plane_properties=types[plane],
    )


def _controller(card: Card, connector: Connector, current: int) -> int:
    if current in connector.controllers:
        return current
    busy = {plane.shown_by for plane in card.planes()}
    for controller in connector.controllers:
        if controller not in busy:
            return controller
    raise DeviceBusy(f"{card.name}: every controller that reaches {connector.name} shows another output; unplug one")


def _is_usable(plane: Plane, properties: Properties, controller: int) -> bool:
    return (
        properties["type"].value == abi.PRIMARY_PLANE
        and abi.XRGB8888 in plane.formats
        and plane.shown_by in (0, controller)
    )


def required_changes(path: Path, mode: Mode, mode_blob: int, framebuffer: int) -> list[Change]:
    """Mode, and one picture over all of it, pixel by pixel; no other layer."""
    width, height = mode.width_px, mode.height_px
    shown = {
        **{"FB_ID": framebuffer, "CRTC_ID": path.controller},
        **{"SRC_X": 0, "SRC_Y": 0, "SRC_W": width << 16, "SRC_H": height << 16},
        **{"CRTC_X": 0, "CRTC_Y": 0, "CRTC_W": width, "CRTC_H": height},
    }
    plane = path.plane_properties
    hidden = [
        Change(each, plane[name].id, 0)
        for each in path.other_planes
        for name in ("FB_ID", "CRTC_ID")  # standard properties: one id for all planes
    ]
    return [
        Change(path.connector, path.connector_properties["CRTC_ID"].id, path.controller),
        Change(path.controller, path.controller_properties["MODE_ID"].id, mode_blob),
        Change(path.controller, path.controller_properties["ACTIVE"].id, 1),
        *(Change(path.plane, plane[name].id, value) for name, value in shown.items()),
        *hidden,
    ]


def switched_off(path: Path) -> list[Change]:
    """No picture, no mode, no signal."""
    return [
        Change(path.plane, path.plane_properties["FB_ID"].id, 0),
        Change(path.plane, path.plane_properties["CRTC_ID"].id, 0),
        Change(path.connector, path.connector_properties["CRTC_ID"].id, 0),
        Change(path.controller, path.controller_properties["ACTIVE"].id, 0),
        Change(path.controller, path.controller_properties["MODE_ID"].id, 0),
    ]


def neutral_changes(path: Path) -> Iterator[Change]:
    """Return what this driver has of the properties that change a picture, each set so that it does not."""
    groups = (
        (path.controller, path.controller_properties, _NEUTRAL_CONTROLLER),
        (path.plane, path.plane_properties, _NEUTRAL_PLANE),
        (path.connector, path.connector_properties, _NEUTRAL_CONNECTOR),
    )
    for object_id, properties, wanted in groups:
        for name, value in wanted.items():
            known = properties.get(name)
            number = known.choices.get(value) if known and isinstance(value, str) else value
            if known and isinstance(number, int):
                # bits of a bit mask are listed by their position
                yield Change(object_id, known.id, 1 << number if name == "rotation" else number)


def earlier_values(path: Path, changes: list[Change]) -> list[Change]:
    """Changes that put back what other changes altered, but for tables, which end with their program."""
    groups = (
        (path.controller, path.controller_properties),
        (path.plane, path.plane_properties),
        (path.connector, path.connector_properties),
    )
    values = {
        (object_id, each.id): each.value
        for object_id, properties in groups
        for name, each in properties.items()
        if name not in (*_BLOBS, "link-status")
    }
    known = ((change, values.get((change.object_id, change.property_id))) for change in changes)
    return [change._replace(value=value) for change, value in known if value is not None and value != change.value]
