"""The page of a session that ended in an error: where it stopped and why, and what was photographed by then."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from rig.files.exr import read_exr
from rig.report import pictures
from rig.report.links import link_pages
from rig.report.page import correspondence_images
from rig.report.pictures import EmbeddedPicture
from rig.report.render import TextTable, rendered
from rig.session import Session
from rig.session.timing import seconds_by_step
from rig.version import __version__

_SHOWN = ("white", "black")
"""Patterns whose frames tell most of aim, exposure and room light."""
_MOST_FRAMES = 6
_BRIGHTEST = 0.999


@dataclass(frozen=True, kw_only=True)
class _StoppedPage:
    """What the template shows, by its names."""

    title: str
    subtitle: str
    met: bool
    word: str
    verdict: str
    steps: TextTable
    frames: Sequence[EmbeddedPicture]
    correspondence_images: Sequence[EmbeddedPicture]
    repeat: str
    profile: str
    footer: str


def write_stopped_page(session: Session, steps: Sequence[str], error: Exception) -> Path:
    """Write report.html into a session that cannot go on and return its path.

    Parameters
    ----------
    session
        Open to write.
    steps
        Names of all steps that were wanted, in order.
    error
        Why it stopped.

    Returns
    -------
    Path
        Of the page. The next `rig run` that ends writes the usual report there.
    """
    page = _StoppedPage(
        title=f"Session {session.path.name}",
        subtitle=f"{session.profile.name}, stopped {datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        met=False,
        word="Stopped",
        verdict=str(error),
        steps=_steps(session, steps),
        frames=_frames(session),
        correspondence_images=correspondence_images(session) if session.is_finished("correspondence") else (),
        repeat=(session.commands or [f"rig run {session.path}"])[-1],
        profile=str(session.profile.path),
        footer=f"Written by procam-rig {__version__}.",
    )
    path = session.write_report(rendered("report/stopped.html", page))
    link_pages(session.path)
    return path


def _steps(session: Session, steps: Sequence[str]) -> TextTable:
    """Each step with how far it came, its frames and its time."""
    frames = Counter(event["step"] for event in session.frame_log() if event["event"] == "frame")
    seconds = seconds_by_step(session)
    rows, stopped = [], False
    for name in steps:
        done = session.is_finished(name)
        state = "done" if done else "not begun" if stopped else "stopped here"
        stopped = stopped or not done
        rows.append([name, state, str(frames[name] or ""), f"{seconds[name]:.1f}" if name in seconds else ""])
    return TextTable(["step", "state", "frames", "seconds"], rows)


def _frames(session: Session) -> list[EmbeddedPicture]:
    """White and black of each step that shot them, and the last frame of all."""
    shot = [event for event in session.frame_log() if event["event"] == "frame"]
    chosen = {(event["step"], event["frame"]["pattern"]): event for event in shot}
    kept = [event for (_, pattern), event in chosen.items() if pattern in _SHOWN][-_MOST_FRAMES:]
    if shot and shot[-1] not in kept:
        kept.append(shot[-1])
    levels = [np.mean(list(read_exr(session.path / event["file"]).values()), axis=0) for event in kept]
    brightest: dict[str, float] = {}
    for event, level in zip(kept, levels, strict=True):
        step = event["step"]
        brightest[step] = max(brightest.get(step, 1.0), float(np.quantile(level, _BRIGHTEST)))
    return [
        pictures.picture(
            pictures.photograph(255 * level / brightest[event["step"]]),
            f"{event['step']}: {event['frame']['pattern']}, {1000 * event['frame']['exposure_s']:.3g} ms",
        )
        for event, level in zip(kept, levels, strict=True)
    ]
