"""The HTTP interface described for programs: a JSON schema of every record that it takes or gives."""

from __future__ import annotations

from functools import cache

from pydantic import TypeAdapter
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from rig.by_hand.preview import FrameFacts, PreviewState
from rig.page.jobs.requests import JOBS
from rig.page.jobs.show import ShowStatus
from rig.page.keeper import KeeperStatus
from rig.page.server.answers import answer
from rig.page.server.lease import LeaseState
from rig.page.views.pictures import NamedPicture
from rig.page.views.sessions import SessionDetail, TwoSessions
from rig.recheck.records import Recheck
from rig.records import Json, JsonObject
from rig.report.scene.view import SceneView
from rig.shows.keeper import KeeperState
from rig.shows.saved import SavedShow
from rig.stages.results import SessionResult

_GIVEN = (
    *(SessionDetail, TwoSessions, NamedPicture, SceneView, LeaseState, KeeperStatus, SavedShow),
    *(PreviewState, FrameFacts, ShowStatus, KeeperState, SessionResult, Recheck),
)


@cache
def schemas() -> JsonObject:
    """Return the JSON schema of each record, by its name; jobs by the last part of their address."""
    taken: JsonObject = {kind: _schema(record) for kind, record in JOBS.items()}
    given: JsonObject = {record.__name__: _schema(record) for record in _GIVEN}
    return {"jobs": taken, "records": given}


def _schema(record: type) -> Json:
    found: Json = TypeAdapter(record).json_schema()
    return found


def schema(_: Request) -> Response:
    """The schemas."""
    return answer(schemas())


ROUTES = [Route("/api/schema.json", schema)]
