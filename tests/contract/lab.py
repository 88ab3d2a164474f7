"""Back ends on real kernel drivers, which only the device lab has: each a function that opens a rig."""

import subprocess
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

from rig.devices.clock import SystemClock
from rig.devices.kms.find import list_outputs
from rig.devices.kms.projector import KmsProjector
from rig.pair import Rig
from rig.profile import Profile, load_profile
from tests.contract.readback_camera import ReadbackCamera

ROOT = Path(__file__).parents[2]


@cache
def load_module(name: str) -> None:
    """Load a kernel module, once."""
    subprocess.run(["modprobe", name], check=True)


def display_output(module: str) -> str:
    """The first output that is connected to the card of a driver."""
    load_module(module)
    for output in list_outputs():
        number = output.card.name.removeprefix("card")
        driver = Path(f"/sys/kernel/debug/dri/{number}/name").read_text().split()[0]
        if driver == module and output.status == "connected":
            return output.full_name
    raise AssertionError(f"{module} has no connected output among {[each.full_name for each in list_outputs()]}")


def display_profile(output: str) -> Profile:
    """The tiny rig, on an output of 640 x 480 pixels."""
    tiny = load_profile(ROOT / "hw_profiles" / "ci-tiny.toml")
    camera, projector = tiny.raw.decode().split("[bench]")[0].split("[projector]")
    camera = camera.replace('"simulated"', '"v4l2"\ndevice_id = "readback"\npixel_format = "Y12"')
    projector = projector.replace('"simulated"', f'"kms"\noutput = "{output}"').replace("0.06 ", "0.005 ")
    projector = projector.replace("width_px = 256", "width_px = 640").replace("height_px = 192", "height_px = 480")
    return Profile.parse(f"{camera}[projector]{projector}".encode(), tiny.path)


def open_display(module: str) -> Rig:
    """A projector on a driver's output, and a camera that reads it back."""
    output, clock = display_output(module), SystemClock()
    profile = display_profile(output)
    shape = profile.projector.shape
    projector = KmsProjector(output, shape=shape, refresh_rate_hz=profile.projector.refresh_rate_hz, clock=clock)
    rig = Rig(profile, ReadbackCamera(output, projector_shape=shape, clock=clock), projector, clock)
    rig.open()
    rig.set_exposure(profile.camera.exposure_s)
    return rig


BACK_ENDS: dict[str, Callable[[], Rig]] = {
    "vkms": partial(open_display, "vkms"),
    "virtio-gpu": partial(open_display, "virtio_gpu"),
}
"""By the names that PROCAM_DEVICE_LAB_BACK_ENDS takes."""
