"""Requests to records and results to answers: JSON in and out, and each error of the rig's tree by its status."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TypeVar

from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response

from rig.errors import DeviceError, ProfileError, RigError, SessionError, SessionLocked, UsageError
from rig.page.server.lease import RigHeld
from rig.records import Json, JsonObject, Record, json_of, read_record

MOST_JSON_BYTES = 1 << 20
"""Of a request: the largest, a profile's text, has some ten thousand."""
_STATUS: tuple[tuple[type[RigError], int], ...] = (
    (RigHeld, 409),
    (SessionLocked, 409),
    (UsageError, 400),
    (ProfileError, 400),
    (SessionError, 404),
    (DeviceError, 503),
)
RecordType = TypeVar("RecordType", bound=Record)


def answer(result: Record | Mapping[str, object], status: int = 200) -> Response:
    """Return a result as JSON."""
    return JSONResponse(json_of(result), status)


def refusal(error: RigError) -> Response:
    """Return an error of the rig's as JSON: what a person reads, and its name for programs."""
    status = next((number for kind, number in _STATUS if isinstance(error, kind)), 422)
    return JSONResponse({"error": str(error), "kind": type(error).__name__}, status)


async def on_rig_error(_: Request, error: Exception) -> Response:
    """Answer a request whose work ended in an error of the rig's."""
    if not isinstance(error, RigError):
        raise error
    return refusal(error)


async def on_http_error(_: Request, error: Exception) -> Response:
    """Answer a request for what is not there, or that was refused."""
    if not isinstance(error, HTTPException):
        raise error
    return JSONResponse({"error": error.detail, "kind": "Refused"}, error.status_code)


async def on_lost_client(_request: Request, _error: Exception) -> Response:
    """Answer nobody: whoever asked is gone."""
    return Response(status_code=499)


async def body_of(request: Request, limit: int = MOST_JSON_BYTES) -> bytes:
    """Return the body of a request. Raises HTTPException 413 as soon as it is too large, 400 when it breaks off."""
    announced = request.headers.get("content-length", "0")
    if not announced.isdigit() or int(announced) > limit:
        raise HTTPException(413, f"at most {limit} bytes are taken")
    parts, size = [], 0
    try:
        async for part in request.stream():
            size += len(part)
            if size > limit:
                raise HTTPException(413, f"at most {limit} bytes are taken")
            parts.append(part)
    except ClientDisconnect as error:
        raise HTTPException(400, "the request broke off") from error
    return b"".join(parts)


async def object_of(request: Request) -> JsonObject:
    """Return the JSON object of a request. Raises HTTPException 400 for anything else."""
    try:
        found: Json = json.loads(await body_of(request))
    except (ValueError, RecursionError) as error:
        raise HTTPException(400, "this is no JSON") from error
    if not isinstance(found, dict):
        raise HTTPException(400, 'a JSON object is needed, e.g. {"name": "first"}')
    return found


async def record_of(request: Request, kind: type[RecordType]) -> RecordType:
    """Return a request as a record of a kind. Raises HTTPException 400 that names the field."""
    found = await object_of(request)
    unknown = set(found) - set(kind.__dataclass_fields__)  # type: ignore[attr-defined]
    if unknown:
        raise HTTPException(400, f"{sorted(unknown)[0][:80]!r} is not known here")
    try:
        return read_record(kind, found)
    except ValueError as error:
        raise HTTPException(400, str(error)) from error
