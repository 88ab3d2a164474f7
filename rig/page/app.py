"""The server put together: routes, refusals, and what begins and ends with it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect
from starlette.routing import Mount
from starlette.staticfiles import StaticFiles

from rig.devices.clock import SystemClock
from rig.errors import RigError
from rig.page.jobs.holder import JobHolder
from rig.page.keeper import ProcessKeeper
from rig.page.routes import jobs, schema, sessions, setup, shows, state
from rig.page.server.answers import on_http_error, on_lost_client, on_rig_error
from rig.page.server.folders import Folders
from rig.page.server.frame_stream import Streams
from rig.page.server.guard import Guard, GuardSettings
from rig.page.server.lease import Lease
from rig.page.server.news import News
from rig.page.views.page import SCENE_SCRIPTS, STATIC
from rig.page.workplace import Workplace

_WATCH_S = 1.0
_UNWATCHED_S = 60.0
"""A view that nobody watches for so long gives the rig back: a page that was closed does not hold it."""


def make_app(
    root: Path, guard: GuardSettings, *, show: str | None = None, is_closing: Callable[[], bool] = lambda: False
) -> Starlette:
    """Return the server's application.

    Parameters
    ----------
    root
        Folder of the sessions.
    guard
        Where it listens, and who may ask.
    show
        Saved show that has to run from the beginning.
    is_closing
        Tells whether the server ends: what goes on for ever then does, too.
    """
    news = News(is_closing)
    clock = SystemClock()
    workplace = Workplace(
        folders=Folders(root),
        lease=Lease(clock),
        news=news,
        holder=JobHolder(news),
        is_open=guard.token is not None,
    )
    keeper = ProcessKeeper(workplace, clock)

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        if show is not None:
            keeper.keep(show)
        watcher = asyncio.create_task(_watch(workplace))
        try:
            yield
        finally:
            watcher.cancel()
            await keeper.close()
            await workplace.holder.stop()

    routes = [
        *state.ROUTES,
        *jobs.ROUTES,
        *sessions.ROUTES,
        *setup.ROUTES,
        *shows.ROUTES,
        *schema.ROUTES,
        Mount("/static/scene", StaticFiles(directory=SCENE_SCRIPTS)),
        Mount("/static", StaticFiles(directory=STATIC)),
    ]
    app = Starlette(
        routes=routes,
        middleware=[Middleware(Guard, settings=guard)],
        exception_handlers={
            RigError: on_rig_error,
            HTTPException: on_http_error,
            ClientDisconnect: on_lost_client,
        },
        lifespan=lifespan,
    )
    app.state.workplace, app.state.keeper, app.state.streams = workplace, keeper, Streams(is_closing)
    return app


async def _watch(workplace: Workplace) -> None:
    """Tell a view whether it is watched, end one that nobody watches, and tell when the lease runs out."""
    unwatched_s, was_watched, lease = 0.0, None, workplace.lease.state
    while True:
        await asyncio.sleep(_WATCH_S)
        if workplace.lease.state != lease:
            lease = workplace.lease.state
            workplace.news.tell("lease", lease.as_json())
        job = workplace.holder.job
        if job is None or job.kind != "look" or job.phase != "running":
            unwatched_s, was_watched = 0.0, None
            continue
        is_watched = workplace.holder.latest.readers > 0
        if is_watched != was_watched:
            was_watched = is_watched
            workplace.holder.order({"do": "watched", "on": is_watched})
        unwatched_s = 0.0 if is_watched else unwatched_s + _WATCH_S
        if unwatched_s >= _UNWATCHED_S:
            await workplace.holder.stop()
