"""Access control: Host, Origin, token and size of a request are checked before its body is read.

A page of another site can make a browser send requests to this server, and, by a name that it resolves anew, even read
the answers (DNS rebinding).  The browser names both in the headers Host and Origin.
"""

from __future__ import annotations

import hmac
import re
from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

from .messages import RequestError

MOST_UPLOAD_BYTES = 64 * 2**20  # in an upload
MOST_JSON = 2**16
UPLOADS = ("/api/photos", "/api/descriptors", "/api/meshes")
HEADERS: Mapping[str, str] = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; form-action 'none'; base-uri 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


@dataclass(frozen=True)
class AccessRules:
    """The names accepted in the header Host, with any port, since it may be forwarded; or, if the server listens not
    only on the loopback, a token that all requests must have."""

    hosts: frozenset[str]
    token: str | None

    def rejection(self, scope: Scope) -> tuple[int, str] | None:
        """Status and sentence for a request that is not accepted; else None."""
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if self.token is None and _strip_port(host) not in map(_strip_port, self.hosts):
            return 421, f"this server answers to {', '.join(sorted(self.hosts))}, not to {host[:80]!r}"
        # a proxy in front names the host that it was asked for; a page of another site cannot set that header
        names = {host, headers.get("x-forwarded-host", host)}
        ours = {f"{scheme}://{name}" for scheme in ("http", "https") for name in names}
        if origin is not None and origin not in ours:
            return 403, f"requests of other pages are refused; this one is from {origin[:80]!r}"
        site = headers.get("sec-fetch-site", "same-origin")
        if site not in ("same-origin", "none") and scope["path"] != "/":  # a link to the page may be anywhere
            return 403, "requests of other pages are refused"
        if self.token is not None and not scope["path"].startswith("/static/"):
            query = parse_qs(scope["query_string"].decode("latin-1"))
            token = headers.get("x-nablahog-token") or (query.get("token") or [""])[0]
            if not hmac.compare_digest(token.encode(), self.token.encode()):
                return 401, "expected the address with its token, as the server printed it"
        return None


def _strip_port(host: str) -> str:
    """A host without its port."""
    return re.sub(r":\d*$", "", host)


class AccessMiddleware:
    """Refuses requests by their headers, bodies by their size, and adds the headers that keep a page offline."""

    def __init__(self, app: ASGIApp, rules: AccessRules) -> None:
        self.app, self.rules = app, rules

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        rejected = self.rules.rejection(scope)
        if rejected is not None:
            await _refusal(scope, *rejected)(scope, receive, send)
            return
        if scope["type"] == "websocket":
            await self.app(scope, receive, send)
            return
        most, read = MOST_UPLOAD_BYTES if scope["path"] in UPLOADS else MOST_JSON, 0

        async def bounded() -> Message:
            nonlocal read
            message = await receive()
            read += len(message.get("body", b""))
            if read > most:
                raise RequestError(413, f"expected at most {most:,} bytes")
            return message

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        await self.app(scope, bounded, with_headers)


def _refusal(scope: Scope, status: int, sentence: str) -> ASGIApp:
    if scope["type"] == "websocket":
        return WebSocketClose(1008, sentence[:100])
    headers = {**HEADERS, "connection": "close"}  # the rest of the body is not read
    return JSONResponse({"error": sentence}, status, headers)
