"""Who may ask at all: the Host and Origin of a request, its token, its size; and what a browser may do with answers."""

from __future__ import annotations

import hmac
import ipaddress
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

COOKIE = "rig-token"
CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
    "frame-src 'self'; font-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""What pages may load: from this server alone, and no script or style within the text of a page."""
_HEADERS: Mapping[str, str] = {
    "content-security-policy": CONTENT_POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
_SAFE = ("GET", "HEAD")
_PLAIN_FORMS = ("application/x-www-form-urlencoded", "multipart/form-data", "text/plain", "")
"""Kinds of content that any web site may send here without asking."""


@dataclass(frozen=True, kw_only=True)
class GuardSettings:
    """Where the server listens, and who may ask."""

    host: str
    port: int
    token: str | None = None
    """None: everybody on this machine, where the server listens on no other address."""


class Guard:
    """Refuses requests before anything else sees them, and tells browsers what answers may do."""

    def __init__(self, app: ASGIApp, settings: GuardSettings):
        self._app = app
        self._settings = settings

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand a request on, or answer it with a refusal."""
        if scope["type"] != "http":
            await (
                self._app(scope, receive, send) if scope["type"] == "lifespan" else send({"type": "websocket.close"})
            )
            return
        answer = self._refusal(scope)
        await (answer or self._app)(scope, receive, _with_headers(send))

    def _refusal(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if not self._is_own(host):
            return PlainTextResponse(f"this server is not {host[:100]!r}; ask for its own address", 421)
        if headers.get("origin", f"http://{host}") not in (f"http://{host}", f"https://{host}"):
            return PlainTextResponse("another web site asks; only this server's own page may", 403)
        is_visit = headers.get("sec-fetch-mode") == "navigate" and scope["method"] in _SAFE
        if headers.get("sec-fetch-site") == "cross-site" and not is_visit:
            return PlainTextResponse("another web site asks; only this server's own page may", 403)
        content = headers.get("content-type", "").partition(";")[0].strip().lower()
        if scope["method"] not in _SAFE and content in _PLAIN_FORMS:
            return PlainTextResponse("send JSON: content-type application/json", 415)
        return self._without_token(scope, headers)

    def _is_own(self, host: str) -> bool:
        """Whether a Host header names this server: a name that an attacker's DNS leads here does not."""
        name, port = _parted(host)
        if port != self._settings.port:
            return False
        if name in ("localhost", self._settings.host) or (_is_loopback(name)):
            return True
        return not is_loopback_host(self._settings.host) and (_is_address(name) or name == socket.gethostname().lower())

    def _without_token(self, scope: Scope, headers: Headers) -> Response | None:
        """The answer to a request that does not know the token; one that brings it in its address gets a cookie."""
        token = self._settings.token
        if token is None or scope["path"] == "/health":
            return None
        given = headers.get("authorization", "").removeprefix("Bearer ") or _cookie(headers)
        if _same(given, token):
            return None
        query = parse_qs(scope["query_string"].decode("latin-1"))
        if scope["path"] == "/" and _same(query.get("token", [""])[0], token):
            answer = RedirectResponse("/", 303)
            answer.set_cookie(COOKIE, token, httponly=True, samesite="strict", path="/")
            return answer
        return PlainTextResponse("a token is needed: open the address that `rig serve` printed", 401)


def _with_headers(send: Send) -> Send:
    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return sent


def _parted(host: str) -> tuple[str, int]:
    """Name and port of a Host header; port -1 for one that makes no sense."""
    name, colon, port = host.rpartition(":")
    if not colon or host.endswith("]"):
        name, port = host, "80"
    return name.strip("[]").lower(), int(port) if port.isascii() and port.isdigit() and len(port) <= 5 else -1


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _is_loopback(name: str) -> bool:
    return _is_address(name) and ipaddress.ip_address(name).is_loopback


def is_loopback_host(host: str) -> bool:
    """Whether a server that listens there can be reached from this machine alone."""
    return host == "localhost" or _is_loopback(host)


def _cookie(headers: Headers) -> str:
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return ""
    return found.value if found else ""


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())
