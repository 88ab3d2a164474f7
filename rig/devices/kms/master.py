"""Whether a graphics card may be driven now, or a desktop or another program drives it."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path

from rig.devices.kms.abi import DROP_MASTER, SET_MASTER


def master_is_free(card: Path) -> bool | None:
    """Return whether nobody drives the card; None when that cannot be found out, as it may not be opened.

    Asks by becoming its master for a moment; no picture changes.
    """
    try:
        descriptor = os.open(card, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.ioctl(descriptor, SET_MASTER)
        fcntl.ioctl(descriptor, DROP_MASTER)
        return True
    except OSError as error:
        return False if error.errno in (errno.EBUSY, errno.EACCES, errno.EINVAL) else None
    finally:
        os.close(descriptor)
