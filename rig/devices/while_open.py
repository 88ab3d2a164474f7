"""What a camera holds while it is open, for one call; a camera that is lost meanwhile is let go."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rig.errors import DeviceLost

Opened = TypeVar("Opened")


@contextmanager
def while_open(opened: Opened | None, *, name: str, doing: str, close: Callable[[], None]) -> Iterator[Opened]:
    """Give a device's open state; a device that is lost meanwhile is closed at once, which frees its name.

    Parameters
    ----------
    opened
        What it holds while it is open; None when it is closed.
    name, doing
        Of the device and of the call, for the message.
    close
        Closes it.

    Raises
    ------
    DeviceLost
        It is closed, or was lost meanwhile.
    """
    if opened is None:
        raise DeviceLost(f"{name} is closed: open it before {doing}")
    try:
        yield opened
    except DeviceLost:
        close()
        raise
