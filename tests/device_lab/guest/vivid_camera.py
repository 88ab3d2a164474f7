"""The kernel's own test camera: how it is loaded, set, opened and plugged in again."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from rig.devices.clock import SystemClock
from rig.devices.v4l2.camera import V4l2Camera
from rig.devices.v4l2.find import find_camera, find_cameras
from rig.devices.v4l2.formats import PIXEL_FORMATS
from tests.device_lab.programs import output_of
from tests.device_lab.waiting import wait_until

CLOCK = SystemClock()
ID = "platform:vivid-000"
MODULE = (
    "vivid n_devs=1 node_types=0x101 num_inputs=2 input_types=0xc num_outputs=1 output_types=1 "
    "vid_cap_nr=0 vid_out_nr=1"
)
"""One camera with a webcam input and an HDMI input, and one HDMI output."""
BINDING = Path("/sys/bus/platform/drivers/vivid")
HDMI_HZ = 25.175e6 / (800 * 525)


def control(**values: int) -> None:
    """Set vivid's own controls, from another program."""
    settings = ",".join(f"{name}={value}" for name, value in values.items())
    output_of("v4l2-ctl", "-d", find_camera(ID).node, "-c", settings)


def camera(pixel_format: str = "GREY", shape: tuple[int, int, int] = (360, 640, 1), **options: object) -> V4l2Camera:
    rate_hz = float(options.pop("frame_rate_hz", 25.0))
    settings = {
        "bit_depth": PIXEL_FORMATS[pixel_format].depths[1],
        "exposure_range_s": (1 / rate_hz, 1 / rate_hz),
        "controls": {},
        "clock": CLOCK,
        **options,
    }
    return V4l2Camera(ID, shape=shape, pixel_format=pixel_format, frame_rate_hz=rate_hz, **settings)


@contextmanager
def opened(*given: object, **options: object) -> Iterator[V4l2Camera]:
    made = camera(*given, **options)
    try:
        made.open()
        yield made
    finally:
        made.close()


def open_and_close(*given: object, **options: object) -> None:
    with opened(*given, **options):
        pass


@contextmanager
def program(*command: object) -> Iterator[subprocess.Popen[bytes]]:
    """Another program that runs meanwhile."""
    with subprocess.Popen(
        [str(word) for word in command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def replug() -> None:
    (BINDING / "unbind").write_text("vivid.0")
    (BINDING / "bind").write_text("vivid.0")


def load() -> None:
    output_of("modprobe", *MODULE.split())
    wait_until(find_cameras)
    control(osd_text_mode=2)


def picture(pixel_format: str, channels: int = 1) -> np.ndarray:
    """The test pattern through one format, as int64."""
    with opened(pixel_format, (360, 640, channels)) as it:
        frame = it.capture(after_s=CLOCK.now_s(), timeout_s=5.0)
    assert frame.pixels.dtype == np.uint16
    assert frame.pixels.shape == (360, 640, channels)
    assert frame.pixels.max() <= it.full_scale_dn
    return frame.pixels.astype(np.int64)


@contextmanager
def hdmi_shows(pixel_format: str, data: bytes, folder: Path) -> Iterator[None]:
    """An output of vivid shows these bytes, and its capture side is connected to it."""
    (folder / "frame").write_bytes(data)
    output_of("v4l2-ctl", "-d", 0, "-i", 1, "-c", "hdmi_000_0_is_connected_to=2")
    for number in (1, 0):
        output_of("v4l2-ctl", "-d", number, "--set-dv-bt-timings", "index=0")
    form = f"--set-fmt-video-out=width=640,height=480,pixelformat={pixel_format}"
    source = f"--stream-from={folder}/frame"
    with program("v4l2-ctl", "-d", 1, form, "--stream-out-mmap=3", "--stream-loop", source) as process:
        assert process.poll() is None
        yield


def is_streaming() -> bool:
    """Another program has the stream: setting the format is refused."""
    command = ["v4l2-ctl", "-d", "0", "--set-fmt-video=width=640,height=360"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return "busy" in (done.stdout + done.stderr).lower()
