"""Addresses about the job that is at work: begin, steer, stop, watch."""

from __future__ import annotations

from typing import cast

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp

from rig.page.jobs.requests import JOBS
from rig.page.routes.common import as_operator, client_of, workplace_of
from rig.page.server.answers import answer, object_of, record_of
from rig.page.server.frame_stream import FrameStream, Streams
from rig.page.workplace import order_with_paths
from rig.records import JsonObject, json_of

_WAIT_S = 5.0
"""For a picture that is asked for by itself."""


async def begin(request: Request) -> Response:
    """Begin a job of a kind."""
    kind = request.path_params["kind"]
    if kind not in JOBS:
        raise HTTPException(404, f"there is no job {kind[:40]!r}; there are {', '.join(JOBS)}")
    job = await record_of(request, JOBS[kind])
    workplace = as_operator(request)
    started = await workplace.start(kind, job)
    return answer(started.as_json(), 201)


async def job(request: Request) -> Response:
    """The job that is at work, or the last one, with its result when it has one."""
    found = workplace_of(request).holder.job
    if found is None:
        return answer({"phase": "none"})
    return answer({**found.as_json(), "state": found.state, "result": found.result})


async def stop(request: Request) -> Response:
    """End the job; answers when it has ended."""
    await object_of(request)
    workplace = as_operator(request)
    request.app.state.keeper.let_go()
    await workplace.holder.stop()
    return await job(request)


async def order(request: Request) -> Response:
    """Tell the job something: the exposure, the picture, the gain."""
    asked = await object_of(request)
    workplace = as_operator(request)
    wanted = order_with_paths(cast("dict[str, object]", asked), workplace.folders)
    workplace.holder.order(cast("JsonObject", json_of(wanted)))
    return answer({"told": True}, 202)


async def frame(request: Request) -> Response:
    """The newest picture as JPEG; with `after=N`, the first that is newer than picture N."""
    after = request.query_params.get("after", "0")
    if not (after.isascii() and after.isdigit() and len(after) < 16):
        raise HTTPException(400, "after is the number of a picture")
    latest = workplace_of(request).holder.latest
    latest.readers += 1
    try:
        found = await latest.after(int(after), _WAIT_S)
    finally:
        latest.readers -= 1
    if found is None:
        raise HTTPException(404, "there is no picture; begin to look, or a show")
    headers = {"x-rig-number": str(found.number), "x-rig-taken": str(found.facts.get("taken_s", ""))}
    return Response(found.jpeg, media_type="image/jpeg", headers=headers)


async def stream(request: Request) -> ASGIApp:
    """The newest pictures, one after the other; a page's next stream ends the one before."""
    streams, client = cast("Streams", request.app.state.streams), client_of(request)
    mark = streams.begin(client) if client else None
    if mark is None:
        raise HTTPException(503, "no stream is free, or client=ID is missing; ask for /api/frame.jpg")
    return FrameStream(client, workplace_of(request).holder.latest, streams, mark)


ROUTES = [
    Route("/api/jobs/{kind}", begin, methods=["POST"]),
    Route("/api/job", job),
    Route("/api/job/stop", stop, methods=["POST"]),
    Route("/api/job/order", order, methods=["POST"]),
    Route("/api/frame.jpg", frame),
    Route("/api/frames", stream),
]
