"""Pictures in a card's memory that the processor can write and read."""

from __future__ import annotations

import mmap

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.devices.kms import abi
from rig.devices.kms.card import Card
from rig.devices.protocols import Codes

Pixels = NDArray[np.uint8]
"""(H, W, 4): blue, green, red, unused. Rows may lie further apart than they are long."""


def write_codes(codes: Codes, pixels: Pixels) -> None:
    """Copy grey (H, W) or red-green-blue (H, W, 3) codes into pixels, without a picture in between."""
    conversion = cv2.COLOR_GRAY2BGRA if codes.ndim == 2 else cv2.COLOR_RGB2BGRA
    cv2.cvtColor(codes, conversion, dst=pixels)


def as_pixels(memory: mmap.mmap, shape: tuple[int, int], pitch_bytes: int, offset: int = 0) -> Pixels:
    """Mapped memory as pixels (H, W, 4), not copied; ``shape`` is (height, width)."""
    return np.ndarray((*shape, 4), np.uint8, buffer=memory, offset=offset, strides=(pitch_bytes, 4, 1))


class DumbBuffer:
    """A framebuffer of 32 bits a pixel in plain memory that a controller can show; raises OSError."""

    def __init__(self, card: Card, height_px: int, width_px: int):
        self._card = card
        made = card.ioctl(abi.CREATE_BUFFER, abi.NewBuffer(height_px, width_px, 32))
        self._handle = made.handle
        self._memory: mmap.mmap | None = None
        self._pixels: Pixels | None = None
        self.id = 0
        """The framebuffer's number; 0 when destroyed."""
        try:
            asked = abi.Framebuffer(width=width_px, height=height_px, pixel_format=abi.XRGB8888)
            asked.handles[0], asked.pitches[0] = made.handle, made.pitch
            self.id = int(card.ioctl(abi.ADD_FRAMEBUFFER, asked).id)
            offset = card.ioctl(abi.MAP_BUFFER, abi.BufferOffset(made.handle)).offset
            self._memory = mmap.mmap(card.fd, made.size, offset=offset)
            self._pixels = as_pixels(self._memory, (height_px, width_px), made.pitch)
        except OSError:
            self.destroy()
            raise

    def fill(self, codes: Codes) -> None:
        """Copy codes of its size into it."""
        if self._pixels is not None:
            write_codes(codes, self._pixels)

    def destroy(self) -> None:
        """Give the memory back; any number of times. A controller that shows it is switched off."""
        self._pixels = None
        if self._memory is not None:
            self._memory.close()  # its own copy of the card's descriptor would keep the card
            self._memory = None
        if self.id:
            self._card.ioctl(abi.REMOVE_FRAMEBUFFER, abi.Handle(self.id))
            self.id = 0
        if self._handle:
            self._card.ioctl(abi.DESTROY_BUFFER, abi.Handle(self._handle))
            self._handle = 0
