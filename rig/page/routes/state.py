"""Addresses about the server itself: the page, what goes on, who works the rig, health."""

from __future__ import annotations

import os
import time
from pathlib import Path

from starlette.requests import Request
from starlette.responses import HTMLResponse, Response, StreamingResponse
from starlette.routing import Route

from rig.by_hand.pictures import PATTERNS, SPOTS
from rig.page.jobs.requests import JOBS
from rig.page.routes.common import client_of, label_of, workplace_of
from rig.page.server.answers import answer, object_of
from rig.page.views.page import page_html
from rig.plug_ins import names, own_strategies
from rig.records import Json
from rig.version import __version__

_STARTED_S = time.monotonic()
_MOST_LISTENERS = 200
"""Pages that listen at a time: each costs some kilobytes."""


async def index(_: Request) -> Response:
    """The page."""
    return HTMLResponse(page_html())


async def health(request: Request) -> Response:
    """Whether all is well, for whoever supervises it: no secrets, and no token needed."""
    workplace = workplace_of(request)
    job = workplace.holder.job
    show = request.app.state.keeper.status
    is_well = show.is_well
    return answer(
        {
            "ok": is_well,
            "version": __version__,
            "uptime_s": round(time.monotonic() - _STARTED_S, 1),
            "memory_mb": _memory_mb(),
            "job": None if job is None else {"kind": job.kind, "phase": job.phase},
            "show": show.as_json(),
        },
        200 if is_well else 503,
    )


async def state(request: Request) -> Response:
    """Everything that goes on, as the events tell it."""
    workplace = workplace_of(request)
    job = workplace.holder.job
    kinds: list[Json] = list(JOBS)
    return answer(
        {
            "version": __version__,
            "folder": workplace.folders.root.name,
            "lease": workplace.lease.state.as_json(),
            "job": None if job is None else job.as_json(),
            "state": None if job is None else job.state,
            "kinds": kinds,
            "patterns": [*PATTERNS, SPOTS],
            "strategies": list(names("strategy", own_strategies())),
            "now_s": time.time(),
        }
    )


async def events(request: Request) -> Response:
    """What happens, as server-sent events: job, state, refused, lease, files."""
    news = workplace_of(request).news
    if news.readers >= _MOST_LISTENERS:
        return answer({"error": f"{news.readers} pages listen already; close some", "kind": "Refused"}, 503)
    return StreamingResponse(news.read(), media_type="text/event-stream")


async def lease(request: Request) -> Response:
    """Take, keep or give back the right to work the rig."""
    asked, workplace = await object_of(request), workplace_of(request)
    before = workplace.lease.state
    if asked.get("do") == "keep":
        found = workplace.lease.keep(client_of(request))
    elif asked.get("do") == "release":
        found = workplace.lease.release(client_of(request))
    else:
        by_force = asked.get("by_force") is True
        found = workplace.lease.take(client_of(request), label_of(request), by_force=by_force)
    if found != before or "lease" not in workplace.news.latest:
        workplace.news.tell("lease", found.as_json())
    return answer(found)


def _memory_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return round(pages * os.sysconf("SC_PAGE_SIZE") / 1e6, 1)


ROUTES = [
    Route("/", index),
    Route("/health", health),
    Route("/api/state", state),
    Route("/api/events", events),
    Route("/api/lease", lease, methods=["POST"]),
]
