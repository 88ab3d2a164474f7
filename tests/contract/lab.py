"""Back ends on real kernel drivers, which only the device lab has: each a function that opens a rig."""

import subprocess
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

from rig.back_ends import make_devices
from rig.devices.clock import SystemClock
from rig.devices.kms.find import list_outputs
from rig.devices.kms.projector import KmsProjector
from rig.devices.protocols import Clock, Codes, Shown
from rig.pair import Rig
from rig.profile import Profile, load_profile
from tests.contract.readback_camera import ReadbackCamera

ROOT = Path(__file__).parents[2]


@cache
def load_module(name: str, *options: str) -> None:
    """Load a kernel module, once."""
    subprocess.run(["modprobe", name, *options], check=True)


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


def camera_profile(device_id: str) -> Profile:
    """The tiny rig with a camera that exposes for its whole frame period, and a display that is not looked at."""
    tiny = load_profile(ROOT / "hw_profiles" / "ci-tiny.toml")
    camera = (
        f'driver = "v4l2"\ndevice_id = "{device_id}"\npixel_format = "GREY"\nwidth_px = 320\nheight_px = 180\n'
        "bit_depth = 8\nframe_rate_hz = 25.0\nexposure_range_s = [0.04, 0.04]\nexposure_s = 0.04\nhfov_deg = 60.0\n"
    )
    head, rest = tiny.raw.decode().split("[bench]")[0].split("[camera]")
    projector = rest.split("[projector]")[1].replace('"simulated"', '"kms"\noutput = "none"')
    return Profile.parse(f"{head}[camera]\n{camera}[projector]{projector}".encode(), tiny.path)


class UnseenProjector:
    """Takes every picture, for cameras that look elsewhere."""

    def __init__(self, clock: Clock, shape: tuple[int, int]):
        self.shape = shape
        self._clock = clock

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def show(self, codes: Codes, *, name: str) -> Shown:
        return Shown(self._clock.now_s(), name)


def open_vivid() -> Rig:
    """The kernel's test camera; it sees its own test picture, whatever the projector shows."""
    load_module("vivid", "n_devs=1", "node_types=0x1", "num_inputs=1", "input_types=0")
    profile = camera_profile("platform:vivid-000")
    camera, _, clock = make_devices(profile)
    rig = Rig(profile, camera, UnseenProjector(clock, profile.projector.shape), clock)
    rig.open()
    rig.set_exposure(profile.camera.exposure_s)
    return rig


BACK_ENDS: dict[str, Callable[[], Rig]] = {
    "vkms": partial(open_display, "vkms"),
    "virtio-gpu": partial(open_display, "virtio_gpu"),
    "vivid": open_vivid,
}
"""By the names that PROCAM_DEVICE_LAB_BACK_ENDS takes."""
