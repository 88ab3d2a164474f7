"""Plugging emulated cameras into the machine's kernel, for tests."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from rig.devices.clock import SystemClock
from rig.emulated.faults import Faults
from rig.emulated.usbip.attach import Attachment, attach
from rig.emulated.uvc.camera import UvcCamera
from rig.emulated.uvc.descriptors import video_formats
from tests.device_lab.programs import output_of
from tests.device_lab.waiting import wait_until
from tests.rig.emulated.numbered_pictures import PatternSource

CLOCK = SystemClock()
WIDTH, HEIGHT = 320, 240
NODES = Path("/sys/class/video4linux")


def nodes_of(serial: str) -> list[Path]:
    """Nodes of the camera with a serial number; the first captures, the second has metadata."""
    found = []
    for node in NODES.glob("video*"):
        try:
            if (node / "device/../serial").read_text().strip() == serial:
                found.append(Path("/dev") / node.name)
        except OSError:  # it goes away just now
            continue
    return sorted(found, key=lambda node: int(node.name[5:])) if len(found) == 2 else []


@dataclass
class Plugged:
    camera: UvcCamera
    attachment: Attachment
    node: Path
    faults: Faults
    serial: str

    def unplug(self) -> None:
        self.attachment.unplug()
        wait_until(lambda: not nodes_of(self.serial))


def plug_in(*, serial: str = "LAB1", fourccs=("GREY",), sizes=((WIDTH, HEIGHT),), rates=(30,), **options) -> Plugged:
    faults = Faults()
    formats = video_formats(fourccs, sizes, rates)
    options.setdefault("source", PatternSource())
    camera = UvcCamera(formats=formats, faults=faults, serial=serial, **options)
    attachment = attach(camera)
    try:
        wait_until(lambda: nodes_of(serial))
    except BaseException:
        attachment.unplug()
        raise
    return Plugged(camera, attachment, nodes_of(serial)[0], faults, serial)


def load_drivers() -> None:
    output_of("modprobe", "-a", "vhci-hcd", "uvcvideo")


@contextmanager
def plugging() -> Iterator[Callable[..., Plugged]]:
    """Gives a function that plugs cameras in, and pulls all of them out at the end."""
    with ExitStack() as undo:

        def plug(**options) -> Plugged:
            plugged = plug_in(**options)
            undo.callback(plugged.attachment.unplug)
            return plugged

        yield plug
