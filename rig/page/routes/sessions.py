"""Addresses about sessions: their list, one of them, its pictures, pages and scene. All read, none writes."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, Response
from starlette.routing import Route

from rig.errors import SessionError
from rig.page.routes.common import name_of, workplace_of
from rig.page.server.answers import answer
from rig.page.server.folders import checked_name
from rig.page.views.page import report_policy
from rig.page.views.pictures import comparable, last_frame_jpeg, levels_of, map_png, maps_of, projector_png
from rig.page.views.rechecks import look_page, looks_at
from rig.page.views.sessions import compared, detail, last_frame, listed
from rig.report.links import PAGES
from rig.report.scene.view import scene_of
from rig.session.folder import is_session


def sessions(request: Request) -> Response:
    """All sessions, the one that was worked on last first."""
    return answer({"sessions": [listed(folder).as_json() for folder in workplace_of(request).folders.sessions()]})


def session(request: Request) -> Response:
    """One session: steps, time left, what went wrong, limits, and which pictures there are."""
    folder = _folder(request)
    found = detail(folder).as_json()
    maps = [one.as_json() for one in maps_of(folder)]
    return answer({**found, "maps": maps, "pictures": [one.as_json() for one in comparable(folder)]})


def page(request: Request) -> Response:
    """A page that `rig` wrote into the session, with its own scripts alone."""
    folder, file = _folder(request), request.path_params["page"]
    if file not in PAGES or not (folder / file).is_file():
        raise HTTPException(404, "this session has no such page yet")
    html = (folder / file).read_text(encoding="utf-8")
    return HTMLResponse(html, headers={"content-security-policy": report_policy()})


def map_picture(request: Request) -> Response:
    """A map as PNG."""
    return Response(map_png(_folder(request), request.path_params["map"]), media_type="image/png")


def levels(request: Request) -> Response:
    """A picture as numbers, for comparing."""
    return Response(levels_of(_folder(request), request.path_params["picture"]), media_type="application/octet-stream")


def projector(request: Request) -> Response:
    """What a strategy sends to the projector, as PNG."""
    return Response(projector_png(_folder(request), request.path_params["strategy"]), media_type="image/png")


def photograph(request: Request) -> Response:
    """The photograph that was taken last, as JPEG."""
    folder = _folder(request)
    found = last_frame(folder)
    if found is None:
        raise HTTPException(404, "nothing was photographed yet")
    details = found["frame"]
    pattern = str(details["pattern"]) if isinstance(details, dict) else ""
    content = _photograph(folder, str(found["file"]))
    return Response(content, media_type="image/jpeg", headers={"x-rig-pattern": pattern.encode().decode("latin-1")})


@lru_cache(maxsize=8)
def _photograph(folder: Path, file: str) -> bytes:
    return last_frame_jpeg(folder, file)


def scene(request: Request) -> Response:
    """The measured scene, for the 3-D view."""
    return answer(scene_of(_folder(request)))


def metrics(request: Request) -> Response:
    """What was measured, as `rig run --json` prints it."""
    path = _folder(request) / "metrics.json"
    if not path.is_file():
        raise HTTPException(404, "nothing was compared yet")
    return answer(json.loads(path.read_bytes()))


def strategies(request: Request) -> Response:
    """What `rig compare-strategies --json` printed."""
    path = _folder(request) / "strategies.json"
    if not path.is_file():
        raise HTTPException(404, "strategies were not compared yet")
    return FileResponse(path, media_type="application/json")


def side_by_side(request: Request) -> Response:
    """Two sessions, number by number."""
    folders = workplace_of(request).folders
    first, second = (folders.session(request.query_params.get(key, "")) for key in ("first", "second"))
    return answer(compared(first, second))


def _folder(request: Request) -> Path:
    folder = workplace_of(request).folders.session(name_of(request))
    if not is_session(folder):
        raise SessionError(f"{folder.name}: there is no session of that name any more; load the page anew")
    return folder


def rechecks(request: Request) -> Response:
    """What later looks at a session's rig found, the newest first."""
    return answer({"rechecks": [one.as_json() for one in looks_at(_folder(request))]})


def recheck_page(request: Request) -> Response:
    """The page of a later look, with its own scripts alone."""
    file = look_page(_folder(request), checked_name(request.path_params["look"], "look"))
    if not file.is_file():
        raise HTTPException(404, "there is no such look")
    return HTMLResponse(file.read_text(encoding="utf-8"), headers={"content-security-policy": report_policy()})


ROUTES = [
    Route("/api/sessions", sessions),
    Route("/api/compare", side_by_side),
    Route("/api/sessions/{name}", session),
    Route("/api/sessions/{name}/pages/{page}", page),
    Route("/api/sessions/{name}/rechecks", rechecks),
    Route("/api/sessions/{name}/rechecks/{look}/page", recheck_page),
    Route("/api/sessions/{name}/maps/{map}", map_picture),
    Route("/api/sessions/{name}/levels/{picture}", levels),
    Route("/api/sessions/{name}/projector/{strategy}", projector),
    Route("/api/sessions/{name}/photograph", photograph),
    Route("/api/sessions/{name}/scene", scene),
    Route("/api/sessions/{name}/metrics", metrics),
    Route("/api/sessions/{name}/strategies", strategies),
]
