"""Addresses for setting up: devices, profiles, pictures and films that are handed in."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from rig.by_hand.pictures import PATTERNS, SPOTS, picture_named
from rig.errors import ProfileError, UsageError
from rig.files.atomic import write_bytes
from rig.files.pictures import png_of, read_codes
from rig.live.sources.files import PICTURE_SUFFIXES
from rig.page.jobs.holder import ask
from rig.page.routes.common import as_operator, name_of, workplace_of
from rig.page.server.answers import answer, object_of
from rig.page.server.folders import Folders, shipped_folder
from rig.profile.apply import apply_values, guessed_keys, own_file
from rig.profile.schema import Profile
from rig.records import JsonObject

MOST_UPLOAD_BYTES = 256 << 20
"""Of one picture or film."""
MOST_UPLOADS_BYTES = 8 << 30
"""Of all of them together: a disk that is full ends sessions, too."""
_FILM_SUFFIXES = (".mp4", ".mkv", ".mov", ".avi", ".webm")


async def devices(_: Request) -> Response:
    """What is plugged in, as `rig devices --json` prints it."""
    return answer(await ask("devices"))


def profiles(request: Request) -> Response:
    """All profiles: those of this folder, and those that come with the program."""
    folders = workplace_of(request).folders
    found = [_summary(folders, name, is_own=True) for name in folders.own_profiles()]
    found += [_summary(folders, name, is_own=False) for name in folders.shipped_profiles()]
    return answer({"profiles": found})


def _summary(folders: Folders, name: str, *, is_own: bool) -> JsonObject:
    try:
        profile = folders.read_profile(name)
    except ProfileError as error:
        return {"name": name, "own": is_own, "ok": False, "says": str(error)}
    camera, projector = profile.cameras[0], profile.projectors[0]
    return {
        "name": name,
        "own": is_own,
        "ok": True,
        "says": profile.description,
        "driver": camera.driver,
        "camera_px": [camera.width_px, camera.height_px],
        "projector_px": [projector.width_px, projector.height_px],
        "to_measure": list(guessed_keys(profile.text)),
    }


def profile_text(request: Request) -> Response:
    """A profile's text."""
    name, folders = name_of(request, "profile"), workplace_of(request).folders
    own = folders.own_profile(name)
    path = own if own.is_file() else shipped_folder() / f"{name}.toml"
    if not path.is_file():
        raise ProfileError(f"{name}: no such profile; it was moved or deleted, load the page anew")
    return answer({"name": name, "own": own.is_file(), "text": path.read_text(encoding="utf-8")})


async def save_profile(request: Request) -> Response:
    """Check a profile's text, and keep it when nothing is wrong; with `check_only` nothing is written."""
    asked, name = await object_of(request), name_of(request, "profile")
    text = asked.get("text")
    if not isinstance(text, str):
        raise HTTPException(400, "text: the profile's, as a string")
    path = workplace_of(request).folders.own_profile(name)
    Profile.parse(text.encode(), path)
    if asked.get("check_only") is not True:
        as_operator(request)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, text.encode())
    return answer({"name": name, "to_measure": list(guessed_keys(text))})


async def new_profile(request: Request) -> Response:
    """Write a profile of what is plugged in, as `rig profile new` does."""
    asked, name = await object_of(request), name_of(request, "profile")
    path = as_operator(request).folders.own_profile(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    wanted: JsonObject = {key: asked[key] for key in ("camera", "output") if isinstance(asked.get(key), str)}
    return answer(await ask("profile", {**wanted, "path": str(path), "name": name}), 201)


async def apply(request: Request) -> Response:
    """Write what the last check measured into its profile, as `rig check --apply` does."""
    await object_of(request)
    name, workplace = name_of(request, "profile"), as_operator(request)
    job = workplace.holder.job
    if job is None or job.kind != "check" or job.result is None or job.asked.get("profile") != name:
        raise UsageError(f"{name}: check this profile first")
    suggested = job.result["suggested"]
    values = {key: float(str(value)) for key, value in suggested.items()} if isinstance(suggested, dict) else {}
    applied = apply_values(own_file(workplace.folders.profile(name)), values)
    return answer({"diff": applied.diff})


def pattern(request: Request) -> Response:
    """A picture of `rig show` as a profile's projector shows it, as PNG."""
    name = request.path_params["picture"]
    if name not in (*PATTERNS, SPOTS):
        raise HTTPException(404, f"there is no picture {name[:40]!r}")
    profile = workplace_of(request).folders.read_profile(name_of(request, "profile"))
    return Response(png_of(picture_named(name, profile).codes, 3), media_type="image/png")


def uploads(request: Request) -> Response:
    """What was handed in."""
    folders = workplace_of(request).folders
    names = folders.uploads()
    return answer({"uploads": [{"name": name, "bytes": folders.upload(name).stat().st_size} for name in names]})


async def upload(request: Request) -> Response:
    """Take a picture or a film; a picture is read as `rig` reads it, and refused if it cannot be."""
    workplace = as_operator(request)
    path = workplace.folders.upload(name_of(request, "file"))
    suffix = path.suffix.lower()
    if suffix not in (*PICTURE_SUFFIXES, *_FILM_SUFFIXES, ".exr"):
        kinds = ", ".join(sorted({*PICTURE_SUFFIXES, *_FILM_SUFFIXES, ".exr"}))
        raise UsageError(f"{path.name}: neither picture nor film; its name ends in one of {kinds}")
    announced = request.headers.get("content-length", "0")
    if not announced.isdigit() or int(announced) > MOST_UPLOAD_BYTES:
        raise HTTPException(413, f"at most {MOST_UPLOAD_BYTES >> 20} MB are taken")
    if _size_of(path.parent) + int(announced) > MOST_UPLOADS_BYTES:
        raise HTTPException(413, f"{path.parent.name}/ holds {MOST_UPLOADS_BYTES >> 30} GB already; remove something")
    part = await _received(request, path)
    try:
        if suffix in PICTURE_SUFFIXES:
            await run_in_threadpool(_check_picture, part, path.name)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    workplace.news.tell("files", {"name": path.name, "at_s": time.time()})
    return answer({"name": path.name, "bytes": path.stat().st_size}, 201)


async def _received(request: Request, path: Path) -> Path:
    """Write the body beside its place. Raises HTTPException when it is too large or breaks off."""
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, name = tempfile.mkstemp(prefix=".", suffix=path.suffix, dir=path.parent)
    part, size = Path(name), 0
    try:
        with os.fdopen(descriptor, "wb") as file:
            async for piece in request.stream():
                size += len(piece)
                if size > MOST_UPLOAD_BYTES:
                    raise HTTPException(413, f"at most {MOST_UPLOAD_BYTES >> 20} MB are taken")
                file.write(piece)
    except BaseException as error:
        part.unlink(missing_ok=True)
        if isinstance(error, ClientDisconnect):
            raise HTTPException(400, "the upload broke off") from error
        raise
    return part


def _check_picture(part: Path, name: str) -> None:
    try:
        read_codes(part)
    except UsageError as error:
        raise UsageError(str(error).replace(str(part), name)) from error


def _size_of(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.glob("*")) if folder.is_dir() else 0


async def remove_upload(request: Request) -> Response:
    """Remove a picture or film."""
    workplace = as_operator(request)
    path = workplace.folders.upload(name_of(request, "file"))
    path.unlink(missing_ok=True)
    return answer({"removed": path.name})


ROUTES = [
    Route("/api/devices", devices),
    Route("/api/profiles", profiles),
    Route("/api/profiles/{name}", profile_text),
    Route("/api/profiles/{name}", save_profile, methods=["PUT"]),
    Route("/api/profiles/{name}/new", new_profile, methods=["POST"]),
    Route("/api/profiles/{name}/apply", apply, methods=["POST"]),
    Route("/api/patterns/{name}/{picture}.png", pattern),
    Route("/api/uploads", uploads),
    Route("/api/uploads/{name}", upload, methods=["PUT"]),
    Route("/api/uploads/{name}", remove_upload, methods=["DELETE"]),
]
