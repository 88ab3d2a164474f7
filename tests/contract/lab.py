"""Back ends on real kernel drivers, which only the device lab has: each a function that opens a rig."""

import os
import subprocess
from collections.abc import Callable
from contextlib import ExitStack
from functools import cache, partial
from pathlib import Path

from rig.capture.rig import Rig, open_rig
from rig.devices.clock import SystemClock
from rig.devices.drivers import make_devices
from rig.devices.kms.find import list_outputs
from rig.devices.kms.projector import KmsProjector
from rig.devices.kms.readback import Readback
from rig.devices.protocols import Clock, Codes, Projector, Shown
from rig.devices.window.projector import WindowProjector
from rig.emulated.rig import EmulatedRig, wait_for_camera
from rig.emulated.rig import open_display as open_display_of
from rig.profile.schema import Profile, load_profile
from tests.contract.readback_camera import ReadbackCamera, Screen
from tests.device_lab.host.displays import DesktopScreen, XDisplay, virtual_display
from tests.device_lab.waiting import GENEROUS_S

ROOT = Path(__file__).parents[2]
UNTIL_THE_END = ExitStack()
"""What tests share; closed when they end."""


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


def display_profile(driver: str, output: str) -> Profile:
    """The tiny rig, on an output of 640 x 480 pixels."""
    tiny = load_profile(ROOT / "hw_profiles" / "ci-tiny.toml")
    camera, projector = tiny.raw.decode().split("[simulation]")[0].split("[[projector]]")
    camera = camera.replace('"simulated"', '"v4l2"\ndevice_id = "readback"\npixel_format = "Y12"')
    projector = projector.replace('"simulated"', f'"{driver}"\noutput = "{output}"').replace("0.06 ", "0.005 ")
    projector = projector.replace("width_px = 256", "width_px = 640").replace("height_px = 192", "height_px = 480")
    return Profile.parse(f"{camera}[[projector]]{projector}".encode(), tiny.path)


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
    return UNTIL_THE_END.enter_context(virtual_display(640, 480))


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


def camera_profile(device_id: str) -> Profile:
    """The tiny rig with a camera that exposes for its whole frame period, and a display that is not looked at."""
    tiny = load_profile(ROOT / "hw_profiles" / "ci-tiny.toml")
    camera = (
        f'driver = "v4l2"\ndevice_id = "{device_id}"\npixel_format = "GREY"\nwidth_px = 320\nheight_px = 180\n'
        "bit_depth = 8\nframe_rate_hz = 25.0\nexposure_range_s = [0.04, 0.04]\nexposure_s = 0.04\nhfov_deg = 60.0\n"
    )
    head, rest = tiny.raw.decode().split("[simulation]")[0].split("[[camera]]")
    projector = rest.split("[[projector]]")[1].replace('"simulated"', '"kms"\noutput = "none"')
    return Profile.parse(f'{head}[[camera]]\nname = "camera"\n{camera}[[projector]]{projector}'.encode(), tiny.path)


class UnseenProjector:
    """Takes every picture, for cameras that look elsewhere."""

    def __init__(self, clock: Clock, shape: tuple[int, int]):
        self.shape = shape
        self._clock = clock

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def check_on_screen(self) -> None:
        pass

    def show(self, codes: Codes, *, name: str) -> Shown:
        return Shown(self._clock.now_s(), name)


def open_vivid() -> Rig:
    """The kernel's test camera; it sees its own test picture, whatever the projector shows."""
    load_module("vivid", "n_devs=1", "node_types=0x1", "num_inputs=1", "input_types=0")
    profile = camera_profile("platform:vivid-000")
    made = make_devices(profile)
    rig = Rig(profile, made.camera, UnseenProjector(made.clock, profile.projector.shape), made.clock)
    rig.open()
    rig.set_exposure(profile.camera.exposure_s)
    return rig


def small_emulated_profile() -> Profile:
    """The emulated rig with a camera of a few pixels and a coarse room, which an emulated machine can keep up with."""
    text = (ROOT / "hw_profiles" / "emulated-rig.toml").read_text()
    for known, small in {
        "width_px = 480": "width_px = 160",
        "height_px = 360": "height_px = 120",
        "focal_px = 199.39": "focal_px = 66.46",
        "[241.3, 176.9]": "[80.4, 59.0]",
        "cell_size_m = 0.4 ": "cell_size_m = 0.6 ",
        "latency_s = 0.3 ": "latency_s = 0.1 ",
        "frame_rate_hz = 8.0": "frame_rate_hz = 20.0",
    }.items():
        assert known in text
        text = text.replace(known, small)
    return Profile.parse(text.encode(), ROOT / "hw_profiles" / "emulated-rig.toml")


@cache
def emulated_rig() -> EmulatedRig:
    """The small emulated rig, plugged in until the tests end."""
    for module in ("vkms", "vhci-hcd", "uvcvideo"):
        load_module(module)
    profile = small_emulated_profile()
    return UNTIL_THE_END.enter_context(EmulatedRig(profile=profile, display=open_display_of(profile)))


def open_emulated() -> Rig:
    """A display, and a camera that sees it in the simulated room: both by real kernel drivers."""
    profile = emulated_rig().profile
    wait_for_camera(profile, GENEROUS_S)
    return open_rig(profile)


BACK_ENDS: dict[str, Callable[[], Rig]] = {
    "vkms": partial(open_display, "vkms"),
    "virtio-gpu": partial(open_display, "virtio_gpu"),
    "vivid": open_vivid,
    "emulated": open_emulated,
    "window": open_window,
}
"""By the names that PROCAM_DEVICE_LAB_BACK_ENDS takes."""
