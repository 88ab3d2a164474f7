"""A virtual still camera: gphoto2's own virtual USB port, and a shutter that this program serves.

The port holds a camera with one picture on its card. Whoever releases its shutter tells the length of the exposure over
a socket, waits until the world was exposed for as long and the picture is on the card, and then fetches it by the real
protocol.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.mosaic import Mosaic
from rig.devices.clock import SystemClock
from rig.devices.gphoto2.port import CARD, SHUTTER
from rig.devices.protocols import Clock
from rig.devices.simulated.rigs import simulated_worlds_of
from rig.emulated.still.dng import dng
from rig.emulated.view import WorldView
from rig.emulated.watch import ReadableDisplay, ignore
from rig.profile.schema import Profile

Write = Callable[[NDArray[np.uint16]], bytes]
_QUALITY = 97
_LOOK_S = 0.2
"""How often it looks whether it shall end."""


class VirtualStill:
    """Serves a virtual still camera in a folder, between :meth:`start` and :meth:`stop`; in a ``with`` statement.

    Parameters
    ----------
    view
        What it photographs.
    folder
        Where it is; ``device_id = "virtual:FOLDER"`` opens it.
    full_scale_dn
        Of its numbers.
    write
        Makes the file of a picture, (H, W, numbers a pixel); always of one size, which the port wants.
    clock
        The machine's.
    delay_s
        Of its shutter, after the command.
    """

    def __init__(
        self,
        view: WorldView,
        folder: Path,
        *,
        full_scale_dn: int,
        write: Write,
        clock: Clock,
        delay_s: float = 0.03,
    ):
        self.pictures = 0
        """That were taken so far."""
        self._view, self._folder, self._full_scale, self._write = view, folder, full_scale_dn, write
        self._clock, self._delay_s = clock, delay_s
        self._file = folder / CARD / "IMG_0001.JPG"  # the port releases for pictures of this name alone
        self._server: socket.socket | None = None
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Serve it; there is a first picture on its card."""
        self._file.parent.mkdir(parents=True, exist_ok=True)
        self._expose(1e-4)
        path = self._folder / SHUTTER
        path.unlink(missing_ok=True)
        self._server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._server.bind(str(path))
        self._server.listen(1)
        self._server.settimeout(_LOOK_S)
        self._thread = threading.Thread(target=self._serve, args=(self._server,), daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End it; any number of times."""
        server, self._server = self._server, None
        if server is not None and self._thread is not None:
            self._thread.join()
            server.close()
            (self._folder / SHUTTER).unlink(missing_ok=True)

    def __enter__(self) -> VirtualStill:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def _serve(self, server: socket.socket) -> None:
        while self._server is not None:
            with suppress(TimeoutError):
                link, _ = server.accept()
                with link, suppress(OSError, ValueError):
                    link.settimeout(1.0)
                    self._expose(float(link.recv(64).decode()))
                    link.sendall(b"done\n")

    def _expose(self, exposure_s: float) -> None:
        self._clock.wait_until_s(self._clock.now_s() + self._delay_s)
        pixels = self._view.photograph(exposure_s, self._full_scale)
        self._file.write_bytes(self._write(pixels))
        self.pictures += 1


def jpeg(pixels: NDArray[np.uint16]) -> bytes:
    """Return the JPEG of a picture with 8 bits, always of one size: zeros follow its end."""
    picture = pixels.astype(np.uint8)
    shown = picture[..., ::-1] if picture.shape[2] == 3 else picture
    _, data = cv2.imencode(".jpg", np.ascontiguousarray(shown), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return data.tobytes().ljust(3 * picture.size, b"\0")


def virtual_still_of(
    profile: Profile,
    folder: Path,
    display: ReadableDisplay,
    clock: Clock | None = None,
    note: Callable[[str], None] = ignore,
) -> VirtualStill:
    """Return the virtual still camera of a profile, not served yet: JPEG, or raw with a mosaic.

    Raises ProfileError without a [simulation].
    """
    camera, clock = profile.camera, clock or SystemClock()
    mosaic = None if camera.mosaic is None else Mosaic(camera.mosaic)
    view = WorldView(simulated_worlds_of(profile), display, clock, mosaic=mosaic, note=note)
    full_scale = camera.full_scale_dn

    def raw(pixels: NDArray[np.uint16]) -> bytes:
        return dng(pixels[..., 0], full_scale, camera.mosaic or "RGGB")

    is_raw = camera.pixel_format == "RAW"
    return VirtualStill(
        view,
        folder,
        full_scale_dn=full_scale,
        write=raw if is_raw else jpeg,
        clock=clock,
    )
