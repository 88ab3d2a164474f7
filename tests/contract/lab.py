"""Back ends on real kernel drivers, which only the device lab has: each a function that opens a rig."""

import atexit
import os
import subprocess
from collections.abc import Callable
from contextlib import ExitStack
from functools import cache, partial
from pathlib import Path

from rig.devices.clock import SystemClock
from rig.devices.kms.find import list_outputs
from rig.devices.kms.projector import KmsProjector
from rig.devices.kms.readback import Readback
from rig.devices.protocols import Projector
from rig.devices.window.projector import WindowProjector
from rig.pair import Rig
from rig.profile import Profile, load_profile
from tests.contract.readback_camera import ReadbackCamera, Screen
from tests.device_lab.host.displays import DesktopScreen, XDisplay, virtual_display

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


def display_profile(driver: str, output: str) -> Profile:
    """The tiny rig, on an output of 640 x 480 pixels."""
    tiny = load_profile(ROOT / "hw_profiles" / "ci-tiny.toml")
    camera, projector = tiny.raw.decode().split("[bench]")[0].split("[projector]")
    camera = camera.replace('"simulated"', '"v4l2"\ndevice_id = "readback"\npixel_format = "Y12"')
    projector = projector.replace('"simulated"', f'"{driver}"\noutput = "{output}"').replace("0.06 ", "0.005 ")
    projector = projector.replace("width_px = 256", "width_px = 640").replace("height_px = 192", "height_px = 480")
    return Profile.parse(f"{camera}[projector]{projector}".encode(), tiny.path)


def open_display(module: str) -> Rig:
    """A projector on a driver's output, and a camera that reads it back."""
    output, clock = display_output(module), SystemClock()
    profile = display_profile("kms", output)
    settings = profile.projector
    projector = KmsProjector(output, shape=settings.shape, refresh_rate_hz=settings.refresh_rate_hz, clock=clock)
    return opened(profile, projector, Readback(output), clock)


@cache
def desktop() -> XDisplay:
    """A desktop with one monitor of 640 x 480 pixels, until the tests end."""
    until_the_end = ExitStack()
    atexit.register(until_the_end.close)
    return until_the_end.enter_context(virtual_display(640, 480))


def open_window() -> Rig:
    """A projector that is a window of a desktop, and a camera that photographs the desktop."""
    os.environ.update(desktop().environment)
    profile, clock = display_profile("window", "screen"), SystemClock()
    settings = profile.projector
    projector = WindowProjector("screen", shape=settings.shape, refresh_rate_hz=settings.refresh_rate_hz, clock=clock)
    return opened(profile, projector, DesktopScreen(desktop()), clock)


def opened(profile: Profile, projector: Projector, screen: Screen, clock: SystemClock) -> Rig:
    rig = Rig(profile, ReadbackCamera(screen, projector_shape=projector.shape, clock=clock), projector, clock)
    rig.open()
    rig.set_exposure(profile.camera.exposure_s)
    return rig


BACK_ENDS: dict[str, Callable[[], Rig]] = {
    "vkms": partial(open_display, "vkms"),
    "virtio-gpu": partial(open_display, "virtio_gpu"),
    "window": open_window,
}
"""By the names that PROCAM_DEVICE_LAB_BACK_ENDS takes."""
