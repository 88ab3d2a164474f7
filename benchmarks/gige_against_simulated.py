"""Maps of a session over a GigE camera that loses packets and is unplugged once, against the simulated camera's.

    python benchmarks/gige_against_simulated.py

One world, one profile but for its drivers: emulated GigE camera and virtual display, with 0.2 % of the packets lost and
the cable pulled after 60 pictures; and the simulated camera and projector, twice, at frame rates of 30 and 29 Hz, for
noise is drawn by time. What the two simulated sessions differ by is noise: the GigE session may differ by as much.
"""

from __future__ import annotations

import re
import sys
import tempfile
import threading
from pathlib import Path

import numpy as np

from rig.devices.virtual.projector import VirtualDisplay
from rig.emulated.gige.camera import EmulatedGigeCamera
from rig.emulated.gige.rig import gige_camera_of
from rig.profile.schema import Profile
from rig.run.request import SessionRequest
from rig.run.session import run_session
from rig.session import Session
from rig.stages.correspondence import load_correspondence

PROFILE = Path(__file__).parents[1] / "hw_profiles" / "emulated-gige.toml"
LOST, UNPLUGGED_AT, OUTPUT = 0.002, 60, "gige-against-simulated"
LIGHT = ("direct", "global")
MORE = 1.25
"""Times the difference of two simulated sessions: root mean squares over a picture scatter by less."""
Maps = dict[str, np.ndarray]


def maps_of(folder: Path) -> Maps:
    """Coordinates, NaN where there are none, and direct and global light, by name."""
    with Session.open(folder) as session:
        found = load_correspondence(session)
        seen = np.where((found.reason == 0)[..., None], found.projector_xy_px, np.nan)
        light = session.finished("separation").load_image("separation")
    return {
        "column": seen[..., 0],
        "row": seen[..., 1],
        **{name: np.where(light["valid"] > 0, light[name], np.nan) for name in LIGHT},
    }


def made(folder: Path, name: str, text: str) -> Maps:
    path = folder / f"{name}.toml"
    path.write_text(text, encoding="utf-8")
    result = run_session(SessionRequest(folder=folder / name, profile=str(path), strategies=("none",)), lambda *_: None)
    print(f"{name}: reprojection {result.geometry.rms_px:.4f} px")
    return maps_of(folder / name)


def pulled(camera: EmulatedGigeCamera, ended: threading.Event) -> None:
    while camera.frames < UNPLUGGED_AT and not ended.wait(0.05):
        pass
    camera.unplug()
    ended.wait(1.0)
    camera.plug()


def over_gige(folder: Path, text: str) -> Maps:
    profile = Profile.parse(text.encode(), PROFILE)
    camera, ended = gige_camera_of(profile, VirtualDisplay(OUTPUT)), threading.Event()
    with camera:
        camera.lose_packets(LOST)
        puller = threading.Thread(target=pulled, args=(camera, ended))
        puller.start()
        try:
            return made(folder, "gige", text)
        finally:
            ended.set()
            puller.join()


def differences(first: Maps, second: Maps) -> dict[str, float]:
    """Root mean squares where both have a number, in pixels and in per cent of the median."""
    found = {}
    for name, one in first.items():
        off = (second[name] - one)[np.isfinite(second[name]) & np.isfinite(one)]
        unit = 1.0 if name in ("column", "row") else float(np.nanmedian(one[one > 0])) / 100
        found[name] = float(np.sqrt(np.mean(off**2))) / unit
    return found


def main() -> int:
    text = PROFILE.read_text(encoding="utf-8").replace('output = "emulated-gige"', f'output = "{OUTPUT}"')
    simulated = re.sub(
        r"^(device_id|pixel_format|output|trigger) = .*\n|^\[camera.options\]\n", "", text, flags=re.MULTILINE
    )
    simulated = re.sub('driver = "(genicam|virtual)"', 'driver = "simulated"', simulated)
    with tempfile.TemporaryDirectory() as folder:
        gige = over_gige(Path(folder), text)
        first, second = (
            made(
                Path(folder),
                f"simulated-{rate}",
                simulated.replace("frame_rate_hz = 30.0", f"frame_rate_hz = {rate}.0"),
            )
            for rate in (30, 29)
        )
    noise, off = differences(first, second), differences(first, gige)
    for name, value in off.items():
        unit = "px" if name in ("column", "row") else "% of the median"
        print(f"{name}: GigE from simulated {value:.4f} {unit}, simulated from simulated {noise[name]:.4f}")
    return int(any(off[name] > MORE * noise[name] for name in off))


if __name__ == "__main__":
    sys.exit(main())
