"""The library gphoto2, as far as a still camera needs it, and what its errors mean."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

from rig.errors import CaptureTimeout, DeviceBusy, DeviceError, DeviceLost, SettingRefused

EXTRA = 'pip install "procam-rig[still]"'
VIRTUAL = "virtual:"
"""Begin of the id of a virtual camera: its folder follows."""
SHUTTER, CARD = "shutter", "card"
"""In the folder of a virtual camera: the socket that is told of an exposure, and the folder of its one picture."""
_BUSY, _NO_SPACE, _CLAIMED, _ERROR, _NO_MEMORY = -110, -115, -53, -112, -3
_GONE = frozenset({-7, -52, -105, -35, -34})
"""Of gphoto2-result.h and gphoto2-port-result.h: input or output, no device, no such model, lost device."""
_FULL = "its card is full: empty it, or set it to keep no copy"
_MEANINGS: Mapping[int, tuple[type[DeviceError], str]] = {
    _BUSY: (DeviceError, "it is busy: wait until its lamp is off, close its menus"),
    _NO_SPACE: (DeviceError, _FULL),
    _NO_MEMORY: (DeviceError, _FULL),  # what the library makes of a camera's StoreFull
    _CLAIMED: (DeviceBusy, "another program has it: close file managers (gio mount -s gphoto2), then try again"),
    _ERROR: (
        DeviceError,
        "it did not release: autofocus found nothing, or the card is missing; set the lens to manual focus (MF)",
    ),
    -10: (CaptureTimeout, "it did not answer in time: plug it in again"),
    -6: (SettingRefused, "it has no such setting"),
    -2: (SettingRefused, "it takes no such value"),
}
_LONGEST_EXPOSURE_S = 120.0
_VIRTUAL_CARD = 20
"""Pictures before a virtual camera is opened anew: after 26 its port says that the card is full, deleted or not."""


def library() -> ModuleType:
    """Return the module. Raises DeviceError, with what to install, where there is none."""
    try:
        import gphoto2
    except ImportError as error:
        raise DeviceError(f"gphoto2 is missing, which drives still cameras; install it: {EXTRA}") from error
    return gphoto2  # type: ignore[no-any-return]


@contextmanager
def named(camera: str, doing: str) -> Iterator[None]:
    """Turn the library's errors into those of this program, with the remedy."""
    gphoto2 = library()
    try:
        yield
    except gphoto2.GPhoto2Error as error:
        code = int(error.code)
        if code in _GONE:
            raise DeviceLost(f"{camera} does not answer ({doing}: {error}); switch it on, check its cable") from error
        kind, meaning = _MEANINGS.get(code, (DeviceError, "switch it off and on"))
        raise kind(f"{camera}, {doing}: {error}: {meaning}") from error


class StillPort:
    """An open camera.

    Parameters
    ----------
    device_id
        Its serial number, its port (``usb:001,004``), or ``virtual:FOLDER``; empty: the only one.
    name
        How messages call it.
    """

    def __init__(self, device_id: str, name: str):
        self._name, self._library = name, library()
        self._folder = Path(device_id.removeprefix(VIRTUAL)) if device_id.startswith(VIRTUAL) else None
        self._pictures, self._held = 0, dict[str, str]()
        with named(name, "opening it"), self._surroundings():
            self._camera = self._found(device_id)
        if self._folder is None and device_id and not device_id.startswith("usb:"):
            serial = self.value("serialnumber") or ""
            if serial.strip("0") != device_id.strip("0"):
                self.close()
                raise DeviceLost(
                    f"{name} is not there: the camera that answers has the serial number {serial or 'none'}; "
                    "plug that one in, or correct camera.device_id"
                )

    def _found(self, device_id: str) -> Any:
        camera = self._library.Camera()
        if device_id.startswith("usb:"):
            ports = self._library.PortInfoList()
            ports.load()
            camera.set_port_info(ports[ports.lookup_path(device_id)])
        camera.init()
        return camera

    @contextmanager
    def _surroundings(self) -> Iterator[None]:
        """A virtual camera's port is found by variables of the environment, which nothing else shall see."""
        if self._folder is None:
            yield
            return
        ports = Path(str(self._library.__file__)).parent / "libgphoto2" / "vusb"
        if not ports.is_dir():
            raise DeviceError("this gphoto2 has no virtual camera (vusb): install the wheel of PyPI")
        wanted = {"IOLIBS": str(ports), "VCAMERADIR": str(self._folder / CARD)}
        before = {key: os.environ.get(key) for key in wanted}
        os.environ.update(wanted)
        try:
            yield
        finally:
            for key, value in before.items():
                if value is None:
                    os.environ.pop(key)
                else:
                    os.environ[key] = value

    def value(self, setting: str) -> str | None:
        """Return a setting as text; None when the camera has none of the name."""
        with suppress(self._library.GPhoto2Error):
            return str(self._camera.get_single_config(setting).get_value())
        return None

    def choices(self, setting: str) -> list[str]:
        """Return what a setting can be; empty when the camera does not say."""
        with suppress(self._library.GPhoto2Error):
            widget = self._camera.get_single_config(setting)
            return [widget.get_choice(k) for k in range(widget.count_choices())]
        return []

    def hold(self, setting: str, value: str) -> None:
        """Set a setting and read it back. Raises SettingRefused when the camera has another value."""
        with named(self._name, f"setting {setting} to {value}"):
            widget = self._camera.get_single_config(setting)
            widget.set_value(value)
            self._camera.set_single_config(setting, widget)
        got = self.value(setting)
        if got != value:
            offered = ", ".join(self.choices(setting))
            raise SettingRefused(
                f"{self._name}: {setting} was set to {value}, the camera has {got}; it offers {offered}"
            )
        self._held[setting] = value

    def release(self, exposure_s: float) -> bytes:
        """Release the shutter, fetch the picture's file, and delete it on the camera."""
        if self._folder is not None and self._pictures >= _VIRTUAL_CARD:
            self._change_virtual_card()
        self._tell_shutter(exposure_s)
        self._pictures += 1
        with named(self._name, "releasing the shutter"):
            path = self._camera.capture(self._library.GP_CAPTURE_IMAGE)
            file = self._camera.file_get(path.folder, path.name, self._library.GP_FILE_TYPE_NORMAL)
            data = bytes(memoryview(file.get_data_and_size()))  # a copy: the view dangles when the file goes
        if self._folder is None:  # a virtual card is as full as before, 0.2 s later
            with suppress(self._library.GPhoto2Error):  # it may have kept none
                self._camera.file_delete(path.folder, path.name)
        return data

    def _change_virtual_card(self) -> None:
        """Load the virtual port anew, which counts pictures and never forgets those that were deleted."""
        self.close()
        del self._camera  # with the last camera goes the port, and its count
        self._pictures = 0
        with named(self._name, "opening it again"), self._surroundings():
            self._camera = self._found("")
        for setting, value in list(self._held.items()):
            self.hold(setting, value)

    def _tell_shutter(self, exposure_s: float) -> None:
        """A virtual camera has a file, and no shutter: who emulates it exposes, and answers when the file is there."""
        if self._folder is None:
            return
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
                link.settimeout(exposure_s + _LONGEST_EXPOSURE_S)
                link.connect(str(self._folder / SHUTTER))
                link.sendall(f"{exposure_s!r}\n".encode())
                if link.recv(16).strip() != b"done":
                    raise DeviceLost(f"{self._name}: the virtual camera has ended; start it again")
        except OSError as error:
            raise DeviceLost(f"{self._name}: no virtual camera is served there ({error}); start it first") from error

    def close(self) -> None:
        """Let it go."""
        with suppress(self._library.GPhoto2Error):
            self._camera.exit()
