"""What any program shows on an output, read from the card's memory: the display's truth, for tests and simulation."""

from __future__ import annotations

import errno
import mmap
from contextlib import ExitStack
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.devices.kms import abi
from rig.devices.kms.buffers import as_pixels
from rig.devices.kms.card import Card
from rig.devices.kms.find import choose_output, find_outputs, list_outputs, status_of
from rig.errors import CaptureTimeout, DeviceError, DeviceForbidden, DeviceLost, SettingRefused

_ATTEMPTS = 20
"""To read a picture that does not change meanwhile."""
_TO_RGB = {
    abi.XRGB8888: cv2.COLOR_BGRA2RGB,
    abi.ARGB8888: cv2.COLOR_BGRA2RGB,
    abi.XBGR8888: cv2.COLOR_RGBA2RGB,
    abi.ABGR8888: cv2.COLOR_RGBA2RGB,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shown:
    """Which part of which framebuffer is on screen."""

    framebuffer: int
    x_px: int
    y_px: int
    width_px: int
    height_px: int


class Readback:
    """Reads an output's main picture without taking the output from the program that shows it. Needs root.

    It reads 32-bit pixels that lie row after row in memory which the processor can map: what simple programs, this
    one's projector, and drivers of virtual displays use. It cannot read tiled or compressed pictures (modifiers),
    which real graphics cards make for desktops, and leaves out cursors and overlays, and corrections such as gamma.

    Parameters
    ----------
    output
        ``HDMI-A-1``; with several cards ``card1:HDMI-A-1``; or ``edid:MAKER-MODEL-SERIAL``.
    """

    def __init__(self, output: str):
        self._output = output
        self._card: Card | None = None

    def open(self) -> None:
        """Find the output; no-op when open. Raises DeviceLost, DeviceForbidden, SettingRefused."""
        if self._card is not None:
            return
        outputs = find_outputs() if self._output.startswith("edid:") else list_outputs()
        self._found = choose_output(self._output, outputs)
        with ExitStack() as undo:
            card = Card(self._found.card)
            undo.callback(card.close)
            try:
                card.drop_master()
                self._connector = card.connector(self._found.connector).id
                self._controller_property = card.properties(self._connector)["CRTC_ID"].id
            except OSError as error:
                raise self._named(card, error) from error
            undo.pop_all()
        self._active: dict[int, int] = {}
        self._card = card

    def close(self) -> None:
        """Let go; any number of times."""
        card, self._card = self._card, None
        if card is not None:
            card.close()

    def frame_id(self) -> int:
        """The number of the framebuffer that is on screen, or will be from the next vertical blank on.

        0 when the output is dark: switched off or unplugged. Cheap. Two pictures that alternate in two buffers have
        two numbers. Raises DeviceLost when closed or gone.
        """
        card = self._opened()
        try:
            shown = self._shown(card)
        except OSError as error:
            raise self._named(card, error) from error
        return shown.framebuffer if shown is not None else 0

    def shape(self) -> tuple[int, int]:
        """(height, width) of what is shown, without reading it. Raises DeviceLost when closed or dark."""
        card = self._opened()
        try:
            shown = self._shown(card)
        except OSError as error:
            raise self._named(card, error) from error
        if shown is None:
            raise self._dark()
        return shown.height_px, shown.width_px

    def _dark(self) -> DeviceLost:
        return DeviceLost(f"{self._found.full_name} is dark: no program shows anything on it; start the one that does")

    def picture(self) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 codes, red first, as they are sent to the display; a copy.

        Raises
        ------
        DeviceLost
            It is closed, or nothing is shown.
        DeviceForbidden
            Only root may read what others show.
        SettingRefused
            The picture is tiled, or has no 32-bit pixels.
        CaptureTimeout
            Pictures change faster than they can be read.
        """
        card = self._opened()
        try:
            for _ in range(_ATTEMPTS):
                before = self._shown(card)
                if before is None:
                    raise self._dark()
                picture = self._read(card, before)
                if self._shown(card) == before:
                    return picture
        except OSError as error:
            raise self._named(card, error) from error
        raise CaptureTimeout(
            f"pictures on {self._output} changed {_ATTEMPTS} times while one was read; show them longer"
        )

    def _opened(self) -> Card:
        if self._card is None:
            raise DeviceLost(f"the readback of {self._output} is closed: open it first")
        return self._card

    def _named(self, card: Card, error: OSError) -> DeviceError:
        return card.named(error, f"reading what {self._output} shows")

    def _shown(self, card: Card) -> _Shown | None:
        controller_id = card.values(self._connector).get(self._controller_property, 0)
        if not controller_id or status_of(self._found.folder) == "disconnected":
            return None
        controller = card.controller(controller_id)
        if not (controller.mode_valid and controller.framebuffer and self._is_active(card, controller_id)):
            return None
        mode = controller.mode
        return _Shown(
            framebuffer=controller.framebuffer,
            x_px=controller.x,
            y_px=controller.y,
            width_px=mode.width,
            height_px=mode.height,
        )

    def _is_active(self, card: Card, controller_id: int) -> bool:
        if controller_id not in self._active:
            self._active[controller_id] = card.properties(controller_id)["ACTIVE"].id
        return bool(card.values(controller_id)[self._active[controller_id]])

    def _read(self, card: Card, shown: _Shown) -> NDArray[np.uint8]:
        try:
            framebuffer = card.ioctl(abi.GET_FRAMEBUFFER, abi.Framebuffer(id=shown.framebuffer))
        except FileNotFoundError:
            return np.zeros((shown.height_px, shown.width_px, 3), np.uint8)  # replaced meanwhile: read again
        if not framebuffer.handles[0]:
            raise DeviceForbidden("only root may read what other programs show; run this as root (sudo)")
        try:
            _check_layout(framebuffer, self._found.full_name)
            return _copied(card, framebuffer, shown)
        finally:
            for handle in {handle for handle in framebuffer.handles if handle}:
                card.ioctl(abi.CLOSE_BUFFER, abi.BufferHandle(handle))


def _check_layout(framebuffer: abi.Framebuffer, name: str) -> None:
    if framebuffer.pixel_format not in _TO_RGB:
        letters = int(framebuffer.pixel_format).to_bytes(4, "little").decode("ascii", "replace")
        raise SettingRefused(f"{name} shows pixels of format {letters}; only 32-bit RGB ones can be read back")
    modifier = framebuffer.modifiers[0] if framebuffer.flags & abi.HAS_MODIFIERS else abi.LINEAR
    if modifier != abi.LINEAR:
        raise SettingRefused(
            f"{name} shows a tiled picture (modifier {modifier:#x}); only pictures stored row by row can be read back"
        )


def _copied(card: Card, framebuffer: abi.Framebuffer, shown: _Shown) -> NDArray[np.uint8]:
    """The shown part of a framebuffer, as RGB."""
    pitch = framebuffer.pitches[0]
    start = framebuffer.offsets[0] + shown.y_px * pitch + shown.x_px * 4
    length = start + pitch * (shown.height_px - 1) + shown.width_px * 4
    try:
        offset = card.ioctl(abi.MAP_BUFFER, abi.BufferOffset(framebuffer.handles[0])).offset
        memory = mmap.mmap(card.fd, length, prot=mmap.PROT_READ, offset=offset)
    except OSError as error:
        if error.errno in (errno.ENODEV, errno.ENXIO):
            raise
        raise SettingRefused(
            f"{card.name}: the picture lies in memory that cannot be mapped ({error.strerror}); it cannot be read back"
        ) from error
    with memory:
        pixels = as_pixels(memory, (shown.height_px, shown.width_px), pitch, start)
        picture = np.asarray(cv2.cvtColor(pixels, _TO_RGB[framebuffer.pixel_format]), dtype=np.uint8)
        del pixels
    return picture
