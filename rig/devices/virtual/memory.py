"""The memory of a virtual display: one program writes pictures, others read them, none ever half of one."""

from __future__ import annotations

import mmap
import os
import struct
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import DeviceLost, SettingRefused

Codes = NDArray[np.uint8]
_HEAD = struct.Struct("<8sIIQ")
"""Magic, height, width, and a count that is odd while a picture is written."""
_MAGIC = b"procam01"
_COUNT_AT = 16
_TRIES = 200


def path_of(name: str) -> Path:
    """Return the file of a display. Raises SettingRefused for what cannot be part of a file's name."""
    if not name.replace("-", "").replace("_", "").isalnum():
        raise SettingRefused(f"virtual display {name!r}: give a name of letters, digits, '-' and '_'")
    shared = Path("/dev/shm")
    folder = shared if shared.is_dir() else Path(tempfile.gettempdir())
    return folder / f"procam-rig-{os.getuid()}-{name}"


class DisplayMemory:
    """An open display's memory.

    Parameters
    ----------
    name
        The display's.
    shape
        (height, width) to make it with; None: read one that is there.

    Raises
    ------
    DeviceLost
        There is none of this name.
    """

    def __init__(self, name: str, shape: tuple[int, int] | None = None):
        self._path, self._name = path_of(name), name
        path = self._path
        if shape is not None:
            path.unlink(missing_ok=True)  # who reads the old one keeps it, whole, until they look again
            path.write_bytes(_HEAD.pack(_MAGIC, *shape, 0) + bytes(3 * shape[0] * shape[1]))
        try:
            with path.open("r+b") as file:
                self._map = mmap.mmap(file.fileno(), 0)
                self._inode = os.fstat(file.fileno()).st_ino
        except (OSError, ValueError) as error:
            raise DeviceLost(f"there is no virtual display {name!r}; open the rig whose projector it is") from error
        magic, height, width, _ = _HEAD.unpack_from(self._map)
        if magic != _MAGIC or len(self._map) != _HEAD.size + 3 * height * width:
            self._map.close()
            raise DeviceLost(f"{path} is no virtual display; remove it")
        self.shape: tuple[int, int] = (height, width)
        """(height, width)."""

    @property
    def is_current(self) -> bool:
        """Whether the display of this name is still this one."""
        try:
            return self._path.stat().st_ino == self._inode
        except OSError:
            return False

    def write(self, codes: Codes) -> None:
        """Show codes, (H, W) or (H, W, 3)."""
        whole = np.broadcast_to(codes if codes.ndim == 3 else codes[..., None], (*self.shape, 3))
        count = self._count() | 1
        self._set_count(count)
        self._map[_HEAD.size :] = whole.tobytes()
        self._set_count(count + 1)

    def read(self) -> Codes:
        """Return (H, W, 3) what is shown, whole. Raises DeviceLost when somebody stopped halfway."""
        for _ in range(_TRIES):
            before = self._count()
            data = bytes(self._map[_HEAD.size :])
            if before % 2 == 0 and before == self._count():
                return np.frombuffer(data, np.uint8).reshape(*self.shape, 3)
        raise DeviceLost(f"the virtual display {self._name!r} is being written all the time; restart the rig")

    def close(self) -> None:
        """Let it go; its picture stays."""
        self._map.close()

    def _count(self) -> int:
        return int(_HEAD.unpack_from(self._map)[3])

    def _set_count(self, count: int) -> None:
        struct.pack_into("<Q", self._map, _COUNT_AT, count)
