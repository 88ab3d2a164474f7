"""Wall-clock seconds of each step, from the journal."""

from __future__ import annotations

from datetime import datetime

from rig.session.store import Session


def seconds_by_step(session: Session) -> dict[str, float]:
    """Return the time between journal lines, counted to the later one's step; pauses before an `open` are left out."""
    seconds: dict[str, float] = {}
    previous: datetime | None = None
    for event in session.events():
        now = datetime.fromisoformat(event["time"])
        step = event.get("step")
        if previous is not None and step is not None and event["event"] != "open":
            seconds[step] = seconds.get(step, 0.0) + (now - previous).total_seconds()
        previous = now
    return seconds
