"""The emulated GigE camera for tests; one line where its library is missing."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from rig.devices.genicam.aravis import LIBRARY, PACKAGE, is_installed
from rig.devices.virtual.projector import VirtualDisplay
from rig.emulated.gige.camera import EmulatedGigeCamera
from rig.emulated.gige.rig import gige_camera_of
from rig.profile.schema import Profile

PROFILE = Path(__file__).parents[1] / "hw_profiles" / "emulated-gige.toml"
needs_aravis = pytest.mark.skipif(not is_installed(), reason=f"{LIBRARY} is missing: apt install {PACKAGE}")


@dataclass
class GigeRig:
    """An emulated camera on the network, and the profile that reaches it."""

    camera: EmulatedGigeCamera
    profile: Profile
    notes: list[str]


@contextmanager
def plugged(rig: GigeRig) -> Iterator[GigeRig]:
    """The camera on the network; other processes that test wait meanwhile, for there is one address of loopback."""
    with Path(tempfile.gettempdir(), "procam-rig-gige.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with rig.camera:
            yield rig


def gige_rig(**changes: str) -> GigeRig:
    """A small camera; `changes` replace text of its profile."""
    text = PROFILE.read_text().replace('output = "emulated-gige"', f'output = "gige-{os.getpid()}"')
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    profile = Profile.parse(text.encode(), PROFILE)
    notes: list[str] = []
    display = VirtualDisplay(profile.projector.output or "")
    return GigeRig(gige_camera_of(profile, display, note=notes.append), profile, notes)
