"""Addresses of saved shows, and of the one that has to run."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from rig.page.routes.common import as_operator, name_of, workplace_of
from rig.page.server.answers import answer, object_of, record_of
from rig.page.shows import PageShow, PageShowKeeper, read_show, write_show
from rig.page.workplace import prepared


def shows(request: Request) -> Response:
    """All saved shows, and which has to run."""
    return answer({"shows": workplace_of(request).folders.shows(), "keeper": _keeper(request).status.as_json()})


def show(request: Request) -> Response:
    """A saved show."""
    return answer(read_show(workplace_of(request).folders.show(name_of(request, "show"))))


async def save(request: Request) -> Response:
    """Save a show, refused if it could not begin."""
    wanted = await record_of(request, PageShow)
    workplace = as_operator(request)
    prepared(wanted.show, workplace.folders)
    write_show(workplace.folders.show(name_of(request, "show")), wanted)
    return answer(wanted)


async def keep(request: Request) -> Response:
    """Let a saved show run from now on, and begin again whenever it ends."""
    await object_of(request)
    as_operator(request)
    _keeper(request).keep(name_of(request, "show"))
    return answer({"keeping": name_of(request, "show")}, 202)


async def remove(request: Request) -> Response:
    """Forget a saved show."""
    workplace, name = as_operator(request), name_of(request, "show")
    workplace.folders.show(name).unlink(missing_ok=True)
    return answer({"removed": name})


def _keeper(request: Request) -> PageShowKeeper:
    found = request.app.state.keeper
    if not isinstance(found, PageShowKeeper):
        raise TypeError("the server keeps no show")
    return found


ROUTES = [
    Route("/api/shows", shows),
    Route("/api/shows/{name}", show),
    Route("/api/shows/{name}", save, methods=["PUT"]),
    Route("/api/shows/{name}", remove, methods=["DELETE"]),
    Route("/api/shows/{name}/keep", keep, methods=["POST"]),
]
