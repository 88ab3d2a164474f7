"""Processes of jobs, from the server's side: how they start, and what comes out of them."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from collections import deque

from rig.page.jobs.wire import LONGEST_LINE, PARTS
from rig.records import Json, JsonObject

Message = tuple[str, JsonObject, list[bytes]]


async def started(kind: str, work: JsonObject) -> asyncio.subprocess.Process:
    """Start a job's process, and give it its first order."""
    command = (sys.executable, "-m", "rig.page.jobs.worker")
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        *command, stdin=pipe, stdout=pipe, stderr=pipe, limit=LONGEST_LINE, env=dict(os.environ), start_new_session=True
    )
    send(process, kind, work)
    return process


def send(process: asyncio.subprocess.Process, kind: str, work: JsonObject) -> None:
    """Write an order that says what a job is."""
    if process.stdin is None:
        raise RuntimeError("a job's process has no standard input")
    process.stdin.write(json.dumps({"kind": kind, "job": work}).encode() + b"\n")


async def next_message(stream: asyncio.StreamReader) -> Message | None:
    """The next message; None at the end, also at one that breaks off."""
    line = await stream.readline()
    if not line.endswith(b"\n"):
        return None
    found: Json = json.loads(line)
    if not isinstance(found, dict):
        raise ValueError("a job told something that is no object")
    sizes, what = found.pop(PARTS), str(found.pop("what"))
    try:
        pieces = [await stream.readexactly(size) for size in sizes if isinstance(size, int)]  # type: ignore[union-attr]
    except asyncio.IncompleteReadError:
        return None
    return what, found, pieces


async def keep_lines(stream: asyncio.StreamReader, said: deque[str]) -> None:
    """Keep the last lines of what a job prints."""
    while part := await stream.read(1 << 16):
        said.extend(line for line in part.decode(errors="replace").splitlines() if line.strip())
