"""What a spare process does before its turn: everything of a kept show but its devices, behind all other work."""

from __future__ import annotations

import os
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rig.shows.prepared import PreparedShow

_LAST = 19
"""The lowest priority there is: a show with two processors runs beside it."""


def prepared_beside(show: str) -> PreparedShow:
    """Prepare a saved show in a thread that comes last, so that the process itself can be quick when it is its turn.

    A priority that was given up cannot be taken back, so it is a thread that gives it up, and ends. Libraries that
    begin threads when they are loaded are loaded before.

    Raises
    ------
    UsageError, ProfileError, SessionError
        It cannot begin.
    """
    import scipy.linalg  # noqa: F401

    with ThreadPoolExecutor(1, initializer=_come_last) as last:
        return last.submit(_prepared, show).result()


def _come_last() -> None:
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _LAST)


def _prepared(show: str) -> PreparedShow:
    import rig.page.jobs.show  # noqa: F401
    from rig.shows.prepared import prepare_show

    return prepare_show(show)
