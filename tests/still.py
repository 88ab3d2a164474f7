"""The virtual still camera for tests; one line where its library is missing."""

import os
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import pytest

from rig.devices.virtual.projector import VirtualDisplay
from rig.emulated.still.camera import VirtualStill, virtual_still_of
from rig.profile.schema import Profile

PROFILE = Path(__file__).parents[1] / "hw_profiles" / "emulated-still.toml"
RAW = {
    'pixel_format = "JPEG"': 'pixel_format = "RAW"\nmosaic = "RGGB"',
    "channels = 1": "channels = 3",
    "bit_depth = 8\nframe": "bit_depth = 14\nframe",
    'tone = "srgb"': "compression = 0.0",
    "black_level_dn = 2.0": "black_level_dn = 256.0",
}
"""What makes the profile one of raw files."""
needs_gphoto2 = pytest.mark.skipif(
    find_spec("gphoto2") is None or find_spec("rawpy") is None,
    reason='gphoto2 or rawpy is missing: pip install "procam-rig[still]"',
)


@dataclass
class StillRig:
    """A virtual camera, and the profile that reaches it."""

    camera: VirtualStill
    profile: Profile
    path: Path
    notes: list[str]


def still_rig(folder: Path, **changes: str) -> StillRig:
    """A small virtual camera in a folder; `changes` replace text of its profile."""
    display_name = f"still-{os.getpid()}-{folder.name}"
    text = PROFILE.read_text()
    for old, new in {
        "/tmp/procam-rig-still": str(folder),
        '"emulated-still"\nwidth': f'"{display_name}"\nwidth',
        **changes,
    }.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / "still.toml"
    path.write_text(text)
    profile = Profile.parse(text.encode(), path)
    notes: list[str] = []
    display = VirtualDisplay(profile.projector.output or "")
    return StillRig(virtual_still_of(profile, folder, display, note=notes.append), profile, path, notes)
