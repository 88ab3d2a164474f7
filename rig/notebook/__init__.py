"""In a notebook: progress as a bar, a session's pictures; results show themselves as tables."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from rig.errors import SessionError, UsageError
from rig.report.strategy_pictures import COLUMNS, PictureRow, picture_rows
from rig.session import Session
from rig.stages.compensation import load_compensation
from rig.stages.model import load_model
from rig.terminal.output import time_left

_PICTURE_S = 0.2
"""Between two pictures of a bar: more often nobody sees."""


class NotebookProgress:
    """A bar in a notebook's cell, for ``on_step`` of everything that takes long; one for each call.

    Raises
    ------
    UsageError
        There is no IPython: outside a notebook, use :class:`rig.terminal.TerminalProgress`.
    """

    def __init__(self) -> None:
        try:
            from IPython.display import HTML, display
        except ImportError as error:
            raise UsageError("a notebook's progress bar needs IPython: pip install ipykernel") from error
        self._html: Callable[[str], object] = HTML
        self._display: Callable[..., Any] = display
        self._handle: Any = None
        self._label, self._began_s, self._shown_s, self._first = "", 0.0, 0.0, 0

    def __call__(self, label: str, done: int, total: int) -> None:
        """Show that `done` of `total` parts of the step `label` are there."""
        now_s = time.monotonic()
        is_new = label != self._label
        if is_new:
            self._label, self._began_s, self._first = label, now_s, done
        if is_new or done == total or now_s - self._shown_s > _PICTURE_S:
            self._shown_s = now_s
            self._show(self._html(_bar(label, done, total, time_left(done - self._first, total - done, self._began_s))))

    def _show(self, bar: object) -> None:
        if self._handle is None:
            self._handle = self._display(bar, display_id=True)
        else:
            self._handle.update(bar)


def _bar(label: str, done: int, total: int, left: str) -> str:
    count = f"{done} of {total}{f', {left} left' if left else ''}" if total else ""
    return f"<progress value='{done}' max='{max(total, 1)}'></progress> {escape(label)} {count}"


@dataclass(frozen=True)
class SessionPictures:
    """A session's pictures, a row a strategy: target, sent, predicted, measured, error."""

    rows: Sequence[PictureRow]

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{escape(name)}</th>" for name in ("", *COLUMNS))
        rows = "".join(
            f"<tr><th>{escape(row.name)}</th>"
            + "".join(f"<td><img src='{image.src}' alt='{escape(image.alt)}' width='180'></td>" for image in row.images)
            + "</tr>"
            for row in self.rows
        )
        return f"<table><tr>{head}</tr>{rows}</table>"


def session_pictures(session: Session | str | Path) -> SessionPictures:
    """Return the pictures of a compared session; a notebook shows them.

    Parameters
    ----------
    session
        One that is open, or the folder of one.

    Returns
    -------
    SessionPictures

    Raises
    ------
    SessionError
        It is not compared yet.
    """
    if not isinstance(session, Session):
        return session_pictures(Session.read(session))
    if not session.is_finished("compare"):
        raise SessionError(f"{session.path}: nothing was compared yet; run rig.run_session first")
    return SessionPictures(picture_rows(session, load_model(session), tuple(load_compensation(session).strategies)))
