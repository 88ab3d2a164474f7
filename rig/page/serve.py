"""The server from its start to its end: where it listens, what it prints, how it stops. Verb `serve`."""

from __future__ import annotations

import resource
import secrets
import socket
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import uvicorn

from rig.errors import UsageError
from rig.page.app import make_app
from rig.page.server.folders import Folders
from rig.page.server.guard import GuardSettings, is_loopback_host
from rig.page.shows import read_saved

_MOST_CONNECTIONS = 4096
_GRACE_S = 3
"""For requests that are at work when the server ends."""
_LEAST_TOKEN = 16
_GENERATED = "new"


@dataclass(frozen=True, kw_only=True)
class ServeRequest:
    """What the command line asks for."""

    root: Path
    """Folder of the sessions."""
    host: str = "127.0.0.1"
    port: int = 8080
    """0: any that is free."""
    token: str | None = None
    """``new``: one is made."""
    show: str | None = None
    """Saved show that runs from the beginning."""
    opens: bool = False
    """Open the address in this machine's browser."""


def serve_page(request: ServeRequest, on_ready: Callable[[str], None]) -> None:
    """Serve the page until a signal ends it; the rig is left black.

    Parameters
    ----------
    request
        Where and what.
    on_ready
        Told the address to open, once the server listens.

    Raises
    ------
    UsageError
        It cannot listen there, or would let everybody in.
    """
    token = checked_token(request)
    if request.show is not None:
        read_saved(Folders(request.root), request.show)
    with _listening(request) as listening:
        port = int(listening.getsockname()[1])
        _allow_connections()
        closing = _Closing()
        guard = GuardSettings(host=request.host, port=port, token=token)
        app = make_app(request.root, guard, show=request.show, is_closing=closing)
        config = uvicorn.Config(
            app,
            log_level="warning",
            access_log=False,
            timeout_graceful_shutdown=_GRACE_S,
            timeout_keep_alive=30,
            limit_concurrency=_MOST_CONNECTIONS,
            h11_max_incomplete_event_size=1 << 16,
            ws="none",
            server_header=False,
            lifespan="on",
        )
        server = uvicorn.Server(config)
        closing.server = server
        address = address_of(request.host, port, token)
        on_ready(address)
        if request.opens:
            webbrowser.open(address)
        server.run(sockets=[listening])


class _Closing:
    """Whether a server ends."""

    server: uvicorn.Server | None = None

    def __call__(self) -> bool:
        return self.server is not None and self.server.should_exit


def checked_token(request: ServeRequest) -> str | None:
    """Return the token that requests need; None on this machine's own addresses.

    Raises
    ------
    UsageError
        The server would listen beyond this machine without one, or it is too short to keep anybody out.
    """
    if request.token == _GENERATED:
        return secrets.token_urlsafe(24)
    if request.token is None and not is_loopback_host(request.host):
        raise UsageError(f"--host {request.host} lets other machines in: give --token new, or a token of your own, too")
    if request.token is not None and len(request.token) < _LEAST_TOKEN:
        raise UsageError(f"--token has {len(request.token)} signs; give at least {_LEAST_TOKEN}, or --token new")
    return request.token


def address_of(host: str, port: int, token: str | None) -> str:
    """Return the address to open in a browser."""
    name = socket.gethostname() if host in ("0.0.0.0", "::") else f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}/" + (f"?token={token}" if token else "")


def _listening(request: ServeRequest) -> socket.socket:
    family = socket.AF_INET6 if ":" in request.host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((request.host, request.port))
        listening.listen(1024)
    except (OSError, OverflowError) as error:
        listening.close()
        raise UsageError(
            f"cannot listen on {request.host}, port {request.port}: {error}; is another server there? give --port 0"
        ) from error
    return listening


def _allow_connections() -> None:
    """Hold as many connections as the system allows: a thousand idle ones must not lock others out."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = 2 * _MOST_CONNECTIONS if hard == resource.RLIM_INFINITY else min(hard, 2 * _MOST_CONNECTIONS)
    if soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
