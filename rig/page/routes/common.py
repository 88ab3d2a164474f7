"""What handlers of requests share: who asks, and what the server has."""

from __future__ import annotations

from starlette.requests import Request

from rig.page.server.folders import checked_name
from rig.page.workplace import Workplace

CLIENT = "x-rig-client"
"""Header by which a page or program names itself."""


def workplace_of(request: Request) -> Workplace:
    """Return what the server has."""
    found = request.app.state.workplace
    if not isinstance(found, Workplace):
        raise TypeError("the server has no workplace")
    return found


def client_of(request: Request) -> str:
    """Return the id that a page or program has given itself; streams bring it in their address."""
    return request.headers.get(CLIENT, request.query_params.get("client", ""))


def label_of(request: Request) -> str:
    """Return where somebody asks from, in words for the others."""
    host = request.client.host if request.client else ""
    return "a page on this machine" if host in ("127.0.0.1", "::1", "") else f"a page on {host}"


def as_operator(request: Request) -> Workplace:
    """Return what the server has, for a request that works the rig: it takes the lease if that is free.

    Raises
    ------
    RigHeld
        Another holds it, or the request does not say who asks.
    """
    workplace = workplace_of(request)
    before = workplace.lease.state
    found = workplace.lease.take(client_of(request), label_of(request))
    if found != before:
        workplace.news.tell("lease", found.as_json())
    return workplace


def name_of(request: Request, kind: str = "session") -> str:
    """Return the name in a request's address. Raises UsageError for what is no name."""
    return checked_name(str(request.path_params["name"]), kind)
