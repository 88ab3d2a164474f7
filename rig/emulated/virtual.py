"""Keep a virtual camera on this machine, and let a person break it: verb `virtual`."""

from __future__ import annotations

import select
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TextIO

from rig.devices.gphoto2.port import VIRTUAL
from rig.devices.virtual.projector import VirtualDisplay
from rig.emulated.gige.camera import EmulatedGigeCamera
from rig.emulated.gige.rig import gige_camera_of
from rig.emulated.still.camera import virtual_still_of
from rig.errors import ProfileError
from rig.profile.schema import Profile, load_profile
from rig.records import Record

VirtualKind = Literal["gige", "still"]
PROFILES: Mapping[VirtualKind, str] = {"gige": "emulated-gige", "still": "emulated-still"}
COMMANDS: Mapping[str, str] = {
    "unplug": "pull the cable",
    "plug": "plug it in again",
    "loss N": "lose N of a thousand packets",
    "jitter N": "let pictures come up to N ms later",
    "wire": "cut the wire of the trigger, or join it again",
    "heartbeat": "behave as after lost heartbeats: nobody controls it",
    "quit": "end",
}
"""What may be typed while an emulated GigE camera runs; a still camera knows quit alone."""


@dataclass(frozen=True, slots=True)
class ServedCamera(Record):
    """A camera that is served."""

    kind: VirtualKind
    device_id: str
    """As a profile names it."""
    display: str
    """The virtual display that it looks at."""


def run_virtual(
    kind: VirtualKind,
    profile_name: str | None,
    on_ready: Callable[[ServedCamera], None],
    tell: Callable[[str], None],
    commands: TextIO | None = None,
) -> None:
    """Serve the virtual camera of a profile until "quit" or an interrupt.

    Parameters
    ----------
    kind
        ``gige`` over the loopback network, ``still`` over gphoto2's virtual port.
    profile_name
        File or bare name of a profile with a [simulation]; None: the one that ships for the kind.
    on_ready
        Called once it is there.
    tell
        Called with lines for a person.
    commands
        Where typed commands come from; default: standard input.

    Raises
    ------
    ProfileError, DeviceError
        It cannot begin.
    """
    profile = load_profile(profile_name or PROFILES[kind])
    display = VirtualDisplay(profile.projector.output or "")
    with ExitStack() as undo:
        undo.callback(display.close)
        gige: EmulatedGigeCamera | None = None
        if kind == "gige":
            gige = undo.enter_context(gige_camera_of(profile, display, note=tell))
        else:
            undo.enter_context(virtual_still_of(profile, _folder_of(profile), display, note=tell))
        on_ready(ServedCamera(kind, profile.camera.device_id or "", profile.projector.output or ""))
        for line in _typed(commands or sys.stdin):
            answer = obey(gige, line)
            if answer is None:
                break
            if answer:
                tell(answer)


def _folder_of(profile: Profile) -> Path:
    """Where a virtual still camera is. Raises ProfileError when its id names none."""
    device_id = profile.camera.device_id or ""
    if not device_id.startswith(VIRTUAL) or device_id == VIRTUAL:
        raise ProfileError(
            f"{profile.path}: camera.device_id: {device_id!r} names no virtual camera; give e.g. {VIRTUAL}/tmp/still"
        )
    return Path(device_id.removeprefix(VIRTUAL))


def _typed(commands: TextIO) -> Iterator[str]:
    """Lines as they are typed; when there are no more, waits for an interrupt."""
    while line := commands.readline():
        yield line.strip()
    while True:
        select.select([], [], [], 3600.0)


def obey(camera: EmulatedGigeCamera | None, line: str) -> str | None:
    """Do a typed command; returns what to answer, None to end."""
    word, _, number = line.partition(" ")
    if word == "quit":
        return None
    if camera is None:
        return "a virtual still camera knows quit" if word else ""
    share = float(number) / 1000 if number.strip().replace(".", "", 1).isdigit() else 0.0
    if word == "loss":
        camera.lose_packets(min(share, 1.0))
    elif word == "jitter":
        camera.faults.jitter_s = share
    elif word == "wire":
        camera.faults.wire_is_cut = not camera.faults.wire_is_cut
    elif word in ("plug", "unplug", "heartbeat"):
        {"plug": camera.plug, "unplug": camera.unplug, "heartbeat": camera.forget_heartbeat}[word]()
    elif word:
        return "known are: " + "; ".join(f"{name}: {meaning}" for name, meaning in COMMANDS.items())
    return ""
