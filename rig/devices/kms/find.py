"""Which display outputs there are, what is plugged into them, and which one a profile means."""

from __future__ import annotations

import re
import stat
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

from rig.devices.kms.card import Card
from rig.devices.kms.edid import parse_edid
from rig.errors import DeviceError, DeviceLost, SettingRefused

_CONNECTOR = re.compile(r"(?P<card>card\d+)-(?P<connector>(?!Writeback).+)")


@dataclass(frozen=True, slots=True)
class OutputMode:
    """A resolution that an output offers."""

    width_px: int
    height_px: int
    refresh_rate_hz: float | None
    """None where the card could not be opened to ask."""
    preferred: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundOutput:
    """A connector of a graphics card."""

    connector: str
    card: Path
    """The card's device node."""
    status: str
    """connected, disconnected or unknown."""
    edid_id: str | None
    """``MAKER-MODEL-SERIAL`` of what is plugged in."""
    monitor_name: str | None
    modes: tuple[OutputMode, ...]
    folder: Path
    """Where the kernel tells its state."""

    @property
    def full_name(self) -> str:
        """Card and connector: unambiguous with several cards."""
        return f"{self.card.name}:{self.connector}"


def find_outputs(root: Path = Path("/")) -> list[FoundOutput]:
    """Every output of every card, with modes and their refresh rates where the card can be opened.

    Asking makes no picture change; a card that another program holds can be asked too.
    """
    modes = {card: _modes_of(card) for card in {output.card for output in list_outputs(root)}}
    outputs = list_outputs(root)  # again: the question for modes made the kernel look at what is plugged in
    return [replace(each, modes=modes.get(each.card, {}).get(each.connector) or each.modes) for each in outputs]


def list_outputs(root: Path = Path("/")) -> list[FoundOutput]:
    """Every output of every card, without opening one: modes lack their refresh rates."""
    folders = sorted((root / "sys/class/drm").glob("card*-*"), key=_natural)
    matches = ((folder, _CONNECTOR.fullmatch(folder.name)) for folder in folders)
    return [_output(folder, root, match["card"], match["connector"]) for folder, match in matches if match]


def _natural(path: Path) -> list[int | str]:
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)]


def _output(folder: Path, root: Path, card: str, connector: str) -> FoundOutput:
    edid = parse_edid(_read(folder / "edid"))
    return FoundOutput(
        connector=connector,
        card=root / "dev/dri" / card,
        status=status_of(folder),
        edid_id=edid.id if edid else None,
        monitor_name=edid.monitor_name if edid else None,
        modes=_listed_modes(folder),
        folder=folder,
    )


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""  # a connector may go while it is looked at


def status_of(folder: Path) -> str:
    """Return what the kernel says of a connector: connected, disconnected or unknown; disconnected when it is gone."""
    return _read(folder / "status").decode().strip() or "disconnected"


def offers(folder: Path, width_px: int, height_px: int) -> bool:
    """Return whether a connector has a whole-frame mode of this size."""
    return f"{width_px}x{height_px}" in _read(folder / "modes").decode().split()


def _listed_modes(folder: Path) -> tuple[OutputMode, ...]:
    """Sizes of whole-frame modes, in the kernel's order, each once."""
    sizes = (re.fullmatch(r"(\d+)x(\d+)", name) for name in _read(folder / "modes").decode().split())
    return tuple(dict.fromkeys(OutputMode(int(size[1]), int(size[2]), None, False) for size in sizes if size))


def _modes_of(card: Path) -> dict[str, tuple[OutputMode, ...]]:
    """Modes by connector; nothing when the card cannot be asked."""
    try:
        if not stat.S_ISCHR(card.stat().st_mode):
            return {}
        with Card(card) as opened:
            connectors = opened.connectors()
    except (OSError, DeviceError):
        return {}
    return {
        each.name: tuple(
            OutputMode(mode.width_px, mode.height_px, mode.refresh_rate_hz, mode.preferred) for mode in each.modes
        )
        for each in connectors
    }


def paste_name(output: FoundOutput, outputs: list[FoundOutput]) -> str:
    """What to write as a profile's ``output``: the connector, with its card where two cards have one of that name."""
    twins = Counter(each.connector for each in outputs)[output.connector]
    return output.connector if twins == 1 else output.full_name


def choose_output(name: str, outputs: list[FoundOutput]) -> FoundOutput:
    """The output that ``HDMI-A-1``, ``card1:HDMI-A-1`` or ``edid:MAKER-MODEL-SERIAL`` means.

    Raises DeviceLost when there is none, SettingRefused when several are meant; both list what is there.
    """
    meant = [each for each in outputs if name in _names(each)]
    if len(meant) == 1:
        return meant[0]
    there = "; ".join(map(_described, outputs)) or "none at all: no graphics driver is loaded"
    if not meant:
        raise DeviceLost(
            f"there is no output {name!r}; outputs: {there}. Correct projector.output, or plug the display in"
        )
    one = meant[0].full_name
    raise SettingRefused(f"{name!r} means {len(meant)} outputs; write for example {one!r}; outputs: {there}")


def _names(output: FoundOutput) -> tuple[str, ...]:
    return (output.connector, output.full_name, *_edid_name(output))


def _edid_name(output: FoundOutput) -> tuple[str, ...]:
    return (f"edid:{output.edid_id}",) if output.edid_id else ()


def _described(output: FoundOutput) -> str:
    return f"{output.full_name} ({', '.join((output.status, *_edid_name(output)))})"
