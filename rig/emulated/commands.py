"""Keep an emulated rig plugged in, and let a person break it: verb `emulate`."""

from __future__ import annotations

import select
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from rig.emulated.rig import EmulatedRig, OpenableDisplay, load_modules, open_display, still, wait_for_camera
from rig.profile.schema import Profile, load_profile
from rig.records import Record
from rig.stages.target import load_target

COMMANDS = {
    "unplug": "pull the cable",
    "plug": "plug it in again",
    "freeze": "send nothing more, without any error",
    "go": "end freeze",
    "drop N": "lose the next N frames",
    "short N": "send only half of the next N frames",
    "error N": "mark the next N frames as broken",
    "repeat N": "send the last picture N times again, as new frames",
    "quit": "unplug and end",
}
"""What may be typed while it runs."""
_COUNTERS = {"drop": "dropped_frames", "short": "short_frames", "error": "error_frames", "repeat": "duplicate_frames"}


@dataclass(frozen=True, slots=True)
class PluggedCamera(Record):
    """The emulated camera, as the kernel has it."""

    node: Path
    device_id: str
    display: str
    """What it sees: an output's name, or the picture's file."""


def run_emulated(
    profile_name: str,
    display: str | None,
    picture: Path | None,
    on_ready: Callable[[PluggedCamera], None],
    tell: Callable[[str], None],
    commands: TextIO | None = None,
) -> None:
    """Plug the emulated camera of a profile in, and serve it until "quit", an interrupt, or the kernel lets go.

    Parameters
    ----------
    profile_name
        File or bare name of a profile with a [simulation]: the room.
    display
        KMS output to look at; default: the profile's.
    picture
        Still picture instead of a display.
    on_ready
        Called once the kernel has the camera.
    tell
        Called with lines for a person.
    commands
        Where typed commands come from; default: standard input.

    Raises
    ------
    ProfileError, UsageError, DeviceError
        It cannot begin.
    """
    profile = load_profile(profile_name)
    shown, name = _display(profile, display, picture)
    load_modules()
    with EmulatedRig(profile=profile, display=shown, note=tell) as rig:
        found = wait_for_camera(profile)
        on_ready(PluggedCamera(node=found.node, device_id=found.device_id, display=name))
        for line in _typed(commands or sys.stdin):
            answer = obey(rig, line)
            if answer is None:
                break
            if answer:
                tell(answer)


def _display(profile: Profile, display: str | None, picture: Path | None) -> tuple[OpenableDisplay, str]:
    if picture is not None:
        target = load_target(picture, profile.projector.shape, fit=True, is_linear=True)  # codes of a display
        return still(np.rint(target.grey).astype(np.uint8)), str(picture)
    return open_display(profile, display), display or profile.projector.output or ""


def _typed(commands: TextIO) -> Iterator[str]:
    """Lines as they are typed; when there are no more, waits for an interrupt."""
    while True:
        ready, _, _ = select.select([commands], [], [], None)
        line = commands.readline() if ready else ""
        if not line:
            break
        yield line.strip()
    while True:
        select.select([], [], [], 3600.0)


def obey(rig: EmulatedRig, line: str) -> str | None:
    """Do a typed command; returns what to answer, None to end."""
    word, _, number = line.partition(" ")
    count = int(number) if number.strip().isdigit() else 1
    if word in _COUNTERS:
        setattr(rig.faults, _COUNTERS[word], count)
    elif word in ("freeze", "go"):
        rig.faults.frozen = word == "freeze"
    elif word == "plug":
        rig.plug()
    elif word == "unplug":
        rig.unplug()
    elif word == "quit":
        return None
    elif word:
        return "known are: " + "; ".join(f"{name}: {meaning}" for name, meaning in COMMANDS.items())
    return ""
