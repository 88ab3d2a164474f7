"""Addresses of saved shows, and of the one that has to run."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from rig.page.keeper import ProcessKeeper
from rig.page.routes.common import as_operator, name_of, workplace_of
from rig.page.server.answers import answer, object_of
from rig.page.shows import read_saved, save_show
from rig.shows.lamp import lamp_hours


def shows(request: Request) -> Response:
    """All saved shows, and which has to run."""
    return answer({"shows": workplace_of(request).folders.shows(), "keeper": _keeper(request).status.as_json()})


def show(request: Request) -> Response:
    """A saved show, and the hours of its lamp."""
    folders, name = workplace_of(request).folders, name_of(request, "show")
    saved = read_saved(folders, name).model_dump(mode="json", exclude_none=True)
    return answer({"show": saved, "lamp_h": lamp_hours(folders.show(name))})


async def save(request: Request) -> Response:
    """Save a show, refused if it could not begin."""
    wanted = await object_of(request)
    workplace = as_operator(request)
    saved = save_show(workplace.folders, name_of(request, "show"), wanted)
    return answer({"show": saved.model_dump(mode="json", exclude_none=True)})


async def keep(request: Request) -> Response:
    """Let a saved show run from now on, and begin again whenever it ends."""
    await object_of(request)
    workplace, name = as_operator(request), name_of(request, "show")
    read_saved(workplace.folders, name)
    job = workplace.holder.job
    if job is not None and job.is_running and job.kind == "keep":
        await workplace.holder.stop()  # its file may say something else by now
    _keeper(request).keep(name)
    return answer({"keeping": name}, 202)


async def remove(request: Request) -> Response:
    """Forget a saved show."""
    workplace, name = as_operator(request), name_of(request, "show")
    workplace.folders.show(name).unlink(missing_ok=True)
    return answer({"removed": name})


def _keeper(request: Request) -> ProcessKeeper:
    found = request.app.state.keeper
    if not isinstance(found, ProcessKeeper):
        raise TypeError("the server keeps no show")
    return found


ROUTES = [
    Route("/api/shows", shows),
    Route("/api/shows/{name}", show),
    Route("/api/shows/{name}", save, methods=["PUT"]),
    Route("/api/shows/{name}", remove, methods=["DELETE"]),
    Route("/api/shows/{name}/keep", keep, methods=["POST"]),
]
