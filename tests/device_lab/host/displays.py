"""Display servers for tests: an X server without hardware, one with two monitors, and a Wayland compositor on them."""

import ctypes
import os
import select
import shutil
import struct
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.device_lab.waiting import GENEROUS_S

ATTEMPTS = 5
CLIENT_MESSAGE = 33
COLUMN_PX = 1024
"""Room for each output of the Wayland compositor."""
PACKAGES = {
    "Xvfb": "xvfb",
    "Xorg": "xserver-xorg-core xserver-xorg-video-dummy",
    "weston": "weston",
    "xrandr": "x11-xserver-utils",
    "xset": "x11-xserver-utils",
    "xwd": "x11-apps",
    "xwininfo": "x11-utils",
}
XORG_CONFIGURATION = """
Section "Device"
  Identifier "card"
  Driver "dummy"
  VideoRam 65536
EndSection
Section "Monitor"
  Identifier "monitor"
  HorizSync 5-1000
  VertRefresh 5-200
EndSection
Section "Screen"
  Identifier "screen"
  Device "card"
  Monitor "monitor"
  DefaultDepth 24
  SubSection "Display"
    Depth 24
    Virtual 2048 1536
  EndSubSection
EndSection
"""
WESTON_CONFIGURATION = """
[core]
idle-time=0
[shell]
panel-position=none
startup-animation=none
animation=none
close-animation=none
locking=false
background-color=0xff000000
"""


def program(name: str) -> str:
    """A program's path; its absence fails the test, with what to install."""
    found = shutil.which(name)
    if found is None:
        pytest.fail(f"{name} is missing: apt-get install {PACKAGES[name]}")
    return found


@dataclass(frozen=True)
class Area:
    """A rectangle of a desktop, in pixels."""

    x_px: int
    y_px: int
    width_px: int
    height_px: int

    @property
    def shape(self) -> tuple[int, int]:
        return self.height_px, self.width_px


@dataclass
class XDisplay:
    """A running X server."""

    name: str
    server: subprocess.Popen[bytes]
    monitors: dict[str, Area] = field(default_factory=dict)

    @property
    def environment(self) -> dict[str, str]:
        """What points a program to this display, and to no other."""
        return {"DISPLAY": self.name, "WAYLAND_DISPLAY": ""}

    def photograph(self) -> NDArray[np.uint8]:
        """(H, W, 3) of what all monitors show. A window that goes while it is taken spoils it: then once more."""
        command = [program("xwd"), "-silent", "-display", self.name, "-root"]
        for _ in range(ATTEMPTS):
            dump = subprocess.run(command, capture_output=True, check=False)
            if dump.returncode == 0:
                return read_xwd(dump.stdout)
        pytest.fail(f"no photograph of the display {self.name}: {dump.stderr.decode()}")

    def photograph_of(self, monitor: str) -> NDArray[np.uint8]:
        """(H, W, 3) of what one monitor shows."""
        area = self.monitors[monitor]
        return self.photograph()[area.y_px :, area.x_px :][: area.height_px, : area.width_px]

    def saver_timeout_s(self) -> int:
        """After how many seconds the screen saver starts; 0: never."""
        command = [program("xset"), "-display", self.name, "q"]
        told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        return int(told.split("timeout:")[1].split()[0])

    def ask_to_close(self, title: str) -> None:
        """What a window manager sends when somebody clicks on a window's cross."""
        window = _window_id(self, title)
        with _x11(self) as (library, connection):
            protocols, delete = (
                library.XInternAtom(connection, name, 0) for name in (b"WM_PROTOCOLS", b"WM_DELETE_WINDOW")
            )
            event = (ctypes.c_long * 24)(CLIENT_MESSAGE, 0, 0, 0, window, protocols, 32, delete)
            library.XSendEvent(connection, ctypes.c_ulong(window), 0, ctypes.c_long(0), event)

    def xrandr(self, *arguments: str) -> None:
        subprocess.run([program("xrandr"), "--display", self.name, *arguments], check=True, capture_output=True)


@dataclass
class DesktopScreen:
    """All of a desktop, as a camera's screen."""

    display: XDisplay

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def frame_id(self) -> int:
        return 1

    def picture(self) -> NDArray[np.uint8]:
        return self.display.photograph()


def read_xwd(dump: bytes) -> NDArray[np.uint8]:
    """(H, W, 3) of a dump of the program xwd, of 24 or 32 bits a pixel, its least significant byte first."""
    header = struct.unpack(">25I", dump[:100])
    header_bytes, width, height, byte_order = header[0], header[4], header[5], header[7]
    pixel_bits, line_bytes, masks, colours = header[11], header[12], header[14:17], header[19]
    assert byte_order == 0
    assert pixel_bits in (24, 32)
    lines = np.frombuffer(dump, np.uint8, count=line_bytes * height, offset=header_bytes + 12 * colours)
    pixels = lines.reshape(height, line_bytes)[:, : width * pixel_bits // 8].reshape(height, width, pixel_bits // 8)
    return pixels[..., [mask.bit_length() // 8 - 1 for mask in masks]]


@contextmanager
def x_server(*command: str) -> Iterator[XDisplay]:
    """Start an X server on a display number of its own choice."""
    reading, writing = os.pipe()
    with ExitStack() as stack:
        stack.callback(os.close, reading)
        server = subprocess.Popen(
            [program(command[0]), "-displayfd", str(writing), "-noreset", "-nolisten", "tcp", *command[1:]],
            pass_fds=[writing],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(writing)
        stack.callback(end, server)
        yield XDisplay(f":{_first_line(reading)}", server)


def _first_line(descriptor: int) -> str:
    text = b""
    while not text.endswith(b"\n"):
        ready, _, _ = select.select([descriptor], [], [], GENEROUS_S)
        read = os.read(descriptor, 100) if ready else b""
        if not read:
            pytest.fail("the X server did not start")
        text += read
    return text.decode().strip()


def end(process: subprocess.Popen[bytes]) -> None:
    """Ask a process to end; insist after a while."""
    process.terminate()
    try:
        process.wait(10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


@contextmanager
def virtual_display(width_px: int, height_px: int) -> Iterator[XDisplay]:
    """An X server with one monitor of any size."""
    with x_server("Xvfb", "-screen", "0", f"{width_px}x{height_px}x24") as display:
        display.monitors["screen"] = Area(0, 0, width_px, height_px)
        yield display


@contextmanager
def two_monitors(folder: Path) -> Iterator[XDisplay]:
    """An X server with the monitors DUMMY0 and, right of it, DUMMY1. Needs root."""
    configuration = folder / "xorg.conf"
    configuration.write_text(XORG_CONFIGURATION)
    files = ["-config", str(configuration), "-logfile", str(folder / "xorg.log")]
    with x_server("Xorg", *files, "vt7", "-novtswitch", "-sharevts") as display:
        display.xrandr("--addmode", "DUMMY1", "640x480")
        display.monitors.update({"DUMMY0": Area(0, 0, 800, 600), "DUMMY1": Area(800, 0, 640, 480)})
        arrange(display)
        yield display


def arrange(display: XDisplay) -> None:
    """Switch both monitors on, at their places, and let the server notice that they are connected."""
    display.xrandr(
        *("--output", "DUMMY0", "--mode", "800x600", "--rate", "60.3", "--pos", "0x0", "--primary"),
        *("--output", "DUMMY1", "--mode", "640x480", "--rate", "59.9", "--pos", "800x0"),
    )
    display.xrandr("--query")


@dataclass
class WaylandDisplay:
    """A Wayland compositor whose outputs are windows of an X server, where they can be photographed."""

    socket: str
    runtime_folder: Path
    x_display: XDisplay

    @property
    def environment(self) -> dict[str, str]:
        """What points a program to this display, and to no other."""
        return {"DISPLAY": "", "WAYLAND_DISPLAY": self.socket, "XDG_RUNTIME_DIR": str(self.runtime_folder)}

    def photograph_of(self, output: str) -> NDArray[np.uint8]:
        """(H, W, 3) of what one output shows."""
        return self.x_display.photograph_of(output)

    def point_at(self, output: str) -> None:
        """Put the mouse pointer into the middle of an output."""
        area = self.x_display.monitors[output]
        with _x11(self.x_display) as (library, connection):
            root = ctypes.c_ulong(library.XDefaultRootWindow(connection))
            middle = area.x_px + area.width_px // 2, area.y_px + area.height_px // 2
            library.XWarpPointer(connection, None, root, 0, 0, 0, 0, *middle)


@contextmanager
def weston(folder: Path, sizes_px: Sequence[tuple[int, int]], scale: int = 1) -> Iterator[WaylandDisplay]:
    """A Wayland compositor with outputs X1, X2 ... of (width, height) pixels; text is larger by the scale."""
    folder.chmod(0o700)
    configuration = folder / "weston.ini"
    outputs = {f"X{number}": size for number, size in enumerate(sizes_px, start=1)}
    sections = [
        f"[output]\nname={name}\nmode={width // scale}x{height // scale}\nscale={scale}\n"
        for name, (width, height) in outputs.items()
    ]
    configuration.write_text(WESTON_CONFIGURATION + "".join(sections))
    with virtual_display(COLUMN_PX * len(outputs), COLUMN_PX) as x_display, ExitStack() as stack:
        process = subprocess.Popen(
            [
                *(program("weston"), "--backend=x11-backend.so", "--use-pixman", f"--output-count={len(outputs)}"),
                *("--socket=wayland-lab", f"--config={configuration}", f"--log={folder / 'weston.log'}"),
            ],
            env={**os.environ, "DISPLAY": x_display.name, "XDG_RUNTIME_DIR": str(folder)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        stack.callback(end, process)
        for number, (name, size) in enumerate(outputs.items()):
            x_display.monitors[name] = Area(COLUMN_PX * number, 0, *size)
            _move(x_display, f"Weston Compositor - {name}", COLUMN_PX * number)
        yield WaylandDisplay("wayland-lab", folder, x_display)


@contextmanager
def _x11(display: XDisplay) -> Iterator[tuple[ctypes.CDLL, ctypes.c_void_p]]:
    """The X library and a connection: for what no small program does."""
    library = ctypes.CDLL("libX11.so.6")
    library.XOpenDisplay.restype = ctypes.c_void_p
    library.XDefaultRootWindow.restype = ctypes.c_ulong
    connection = ctypes.c_void_p(library.XOpenDisplay(display.name.encode()))
    yield library, connection
    library.XSync(connection, 0)
    library.XCloseDisplay(connection)


def _move(display: XDisplay, title: str, x_px: int) -> None:
    """Without a window manager all windows lie on one another, and hidden ones cannot be photographed."""
    window = ctypes.c_ulong(_window_id(display, title))
    with _x11(display) as (library, connection):
        library.XMoveWindow(connection, window, x_px, 0)


def _window_id(display: XDisplay, title: str) -> int:
    command = [program("xwininfo"), "-display", display.name, "-int", "-name", title]
    until_s = time.monotonic() + GENEROUS_S
    while time.monotonic() < until_s:
        found = subprocess.run(command, capture_output=True, text=True, check=False)
        if found.returncode == 0:
            return int(found.stdout.split("Window id: ")[1].split()[0])
    pytest.fail(f"no window {title!r} within {GENEROUS_S:g} s")
