"""What every request and every reply passes, those of errors among them: an id, and the headers that browsers obey."""

from __future__ import annotations

import re
import secrets
from importlib.metadata import version

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.telemetry.logs import CURRENT_REQUEST

REQUEST_ID = "X-Request-ID"
VERSION = "Servotune-Version"
"""Of the service, by which clients see whether they fit."""

_GIVEN_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
ALWAYS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
#: Nothing of the API is a page: a browser that takes it for one may do nothing with it.
NO_PAGE = "default-src 'none'; frame-ancestors 'none'"
_YEAR = 365 * 24 * 3600


class Edge:
    """ASGI middleware, outside of everything that may fail.

    Parameters
    ----------
    app : ASGI application
    encrypted : bool
        Whether browsers reach the service by HTTPS, and only so.
    """

    def __init__(self, app: ASGIApp, *, encrypted: bool) -> None:
        self._app = app
        self._headers = dict(ALWAYS)
        self._version = version("servotune")
        if encrypted:
            self._headers["Strict-Transport-Security"] = f"max-age={_YEAR}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Give the request an id, ``scope["state"]["request_id"]``, and the reply its headers."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        given = Headers(scope=scope).get(REQUEST_ID, "")
        request_id = given if _GIVEN_ID.fullmatch(given) else secrets.token_hex(8)
        scope.setdefault("state", {})["request_id"] = request_id
        CURRENT_REQUEST.set(request_id)
        path: str = scope["path"]

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in self._headers.items():
                    headers[name] = value
                headers[REQUEST_ID] = request_id
                headers.setdefault("Content-Security-Policy", NO_PAGE)
                if path.startswith("/v1"):
                    headers.setdefault("Cache-Control", "no-store")
                    headers[VERSION] = self._version
            await send(message)

        await self._app(scope, receive, send_with_headers)
