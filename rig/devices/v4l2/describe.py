"""What a camera offers: formats, sizes, frame rates, controls."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from rig.devices.v4l2 import abi
from rig.devices.v4l2.node import Node

_COMMON_SIZES = ((320, 240), (640, 480), (800, 600), (1280, 720), (1280, 960), (1280, 1024), (1920, 1080), (3840, 2160))
_SCALAR_KINDS = frozenset({"integer", "boolean", "menu", "bitmask", "integer menu"})
"""Kinds whose value is a 32-bit integer; the others are listed without their value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FormatAbility:
    """A pixel format in one size."""

    pixel_format: str
    description: str
    width_px: int
    height_px: int
    frame_rates_hz: tuple[float, ...]
    """Highest first; the ends only where the camera takes anything between; empty where it does not say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlAbility:
    """A control: what it may be, and what it is."""

    name: str
    id: int
    kind: str
    minimum: int
    maximum: int
    step: int
    default: int
    value: int | None
    """None where it cannot be read, or is no single integer."""
    menu: dict[int, str] = field(default_factory=dict)
    flags: tuple[str, ...] = ()

    @property
    def is_settable(self) -> bool:
        """It holds one integer that may be written."""
        return self.kind in _SCALAR_KINDS and not {"disabled", "read-only"} & set(self.flags)

    def refusal(self, value: int) -> str | None:
        """Why it cannot have this value; None if it can."""
        if self.menu:
            entries = ", ".join(f"{number} ({text})" for number, text in self.menu.items())
            return None if value in self.menu else f"it is one of {entries}"
        if self.kind == "bitmask":
            return f"its bits are {self.maximum:#x}" if value & ~self.maximum else None
        if not self.minimum <= value <= self.maximum:
            return f"its range is {self.minimum} … {self.maximum}"
        if self.kind == "integer" and self.step > 1 and (value - self.minimum) % self.step:
            return f"it goes from {self.minimum} to {self.maximum} in steps of {self.step}"
        return None


@dataclass(frozen=True, slots=True)
class CameraAbilities:
    """All that a camera says of itself."""

    formats: tuple[FormatAbility, ...]
    controls: tuple[ControlAbility, ...]


def describe(node: Path) -> CameraAbilities:
    """Ask a node for everything that it offers. Raises DeviceError when it cannot be opened or asked."""
    with Node(node) as opened:
        return CameraAbilities(tuple(list_formats(opened)), tuple(list_controls(opened)))


def list_formats(node: Node) -> Iterator[FormatAbility]:
    """Every pixel format in every size; common sizes where a camera takes any."""
    index = 0
    while node.ask(abi.ENUM_FMT, found := abi.FormatDescription(index=index, type=abi.VIDEO_CAPTURE)):
        name, description = abi.name_of(found.pixelformat), found.description.decode(errors="replace")
        for width_px, height_px in _sizes(node, found.pixelformat):
            rates_hz = tuple(sorted(_rates_hz(node, found.pixelformat, width_px, height_px), reverse=True))
            yield FormatAbility(
                pixel_format=name,
                description=description,
                width_px=width_px,
                height_px=height_px,
                frame_rates_hz=rates_hz,
            )
        index += 1


def _sizes(node: Node, fourcc: int) -> Iterator[tuple[int, int]]:
    index = 0
    while node.ask(abi.ENUM_FRAMESIZES, found := abi.FrameSize(index=index, pixel_format=fourcc)):
        if found.type != abi.DISCRETE:
            yield from _sizes_between(found.size.stepwise)
            return
        yield found.size.discrete.width, found.size.discrete.height
        index += 1


def _sizes_between(limits: abi.Stepwise) -> list[tuple[int, int]]:
    ends = {(limits.min_width, limits.min_height), (limits.max_width, limits.max_height)}
    inside = {(width, height) for width, height in _COMMON_SIZES if _is_between(limits, width, height)}
    return sorted(ends | inside)


def _is_between(limits: abi.Stepwise, width: int, height: int) -> bool:
    widths = range(limits.min_width, limits.max_width + 1, max(1, limits.step_width))
    heights = range(limits.min_height, limits.max_height + 1, max(1, limits.step_height))
    return width in widths and height in heights


def _rates_hz(node: Node, fourcc: int, width_px: int, height_px: int) -> Iterator[float]:
    query = {"pixel_format": fourcc, "width": width_px, "height": height_px}
    index = 0
    while node.ask(abi.ENUM_FRAMEINTERVALS, found := abi.FrameInterval(index=index, **query)):
        if found.type != abi.DISCRETE:
            yield from {_rate_hz(found.interval.stepwise.min), _rate_hz(found.interval.stepwise.max)}
            return
        yield _rate_hz(found.interval.discrete)
        index += 1


def _rate_hz(interval: abi.Fraction) -> float:
    return float(interval.denominator / max(1, interval.numerator))


def list_controls(node: Node) -> Iterator[ControlAbility]:
    """Every control, with its present value."""
    query = abi.ControlQuery(id=abi.NEXT_CONTROL)
    while node.ask(abi.QUERY_EXT_CTRL, query):
        if abi.CONTROL_KINDS.get(query.type) != "class":
            yield _control(node, query)
        query = abi.ControlQuery(id=query.id | abi.NEXT_CONTROL)


def query_control(node: Node, control_id: int) -> ControlAbility:
    """One control as it is now. Raises SettingRefused when the camera has none of that id."""
    query = abi.ControlQuery(id=control_id)
    return _control(node, node.call(abi.QUERY_EXT_CTRL, query, f"asking for control {control_id:#x}"))


def _control(node: Node, query: abi.ControlQuery) -> ControlAbility:
    kind = "compound" if query.nr_of_dims else abi.CONTROL_KINDS.get(query.type, "compound")
    flags = tuple(word for bit, word in abi.CONTROL_FLAGS.items() if query.flags & bit)
    value = None
    if kind in _SCALAR_KINDS and not {"write-only", "disabled"} & set(flags):
        current = abi.ControlValue(id=query.id)
        value = int(current.value) if node.ask(abi.G_CTRL, current) else None
        if value is not None and kind == "bitmask":
            value &= 0xFFFFFFFF
    return ControlAbility(
        name=control_name(query.name.decode(errors="replace")),
        id=int(query.id),
        kind=kind,
        minimum=int(query.minimum),
        maximum=int(query.maximum),
        step=int(query.step),
        default=int(query.default_value),
        value=value,
        menu=_menu(node, query) if kind in ("menu", "integer menu") else {},
        flags=flags,
    )


def _menu(node: Node, query: abi.ControlQuery) -> dict[int, str]:
    entries = {}
    for index in range(query.minimum, query.maximum + 1):
        entry = abi.MenuQuery(id=query.id, index=index)
        if node.ask(abi.QUERYMENU, entry):
            is_text = abi.CONTROL_KINDS[query.type] == "menu"
            entries[index] = entry.item.name.decode(errors="replace") if is_text else str(entry.item.value)
    return entries


def control_name(title: str) -> str:
    """A control's title as a name: lower case, one underscore for whatever is no letter or digit."""
    words = "".join(character if character.isalnum() else " " for character in title.lower()).split()
    return "_".join(words)
