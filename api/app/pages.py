"""The browser client: the built pages of `web/`, served by the service itself.

Every address that is not one of the API is a page when a browser asks for one: the client reads its state from there. Scripts and
styles carry the hash of their content in their names, so browsers keep them for ever; the page itself is asked for anew.
"""

from __future__ import annotations

import mimetypes
import secrets
from pathlib import Path

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import Match, Route
from starlette.types import Scope

from api.app import documentation

STATIC = Path(__file__).parent.parent / "static"
#: What the page may do: its own scripts and styles, its own service, pictures it draws itself. No other host anywhere.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src-elem 'self' 'nonce-{nonce}'; style-src-attr 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self'; connect-src 'self'; worker-src 'self'; manifest-src 'self'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
_REFERENCE = "reference.html"
_NONCE = "__NONCE__"
_FOR_EVER = "public, max-age=31536000, immutable"


class _Page(Route):
    """A page for whoever looks at an address that is none of the API's; all else passes by."""

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """Take reading requests outside of /v1 alone: every other one is answered as if there were no pages."""
        if scope["type"] != "http" or scope["method"] not in {"GET", "HEAD"} or scope["path"].startswith("/v1"):
            return Match.NONE, {}
        return super().matches(scope)


def _asset(request: Request) -> Response:
    """Return a script, style or picture, compressed where the browser can read that."""
    name = request.path_params["name"]
    path = STATIC / "assets" / name
    if path.parent != STATIC / "assets" or not path.is_file():
        raise HTTPException(404)
    headers = {"Cache-Control": _FOR_EVER, "Vary": "Accept-Encoding"}
    kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
    packed = path.with_name(path.name + ".gz")
    accepted = {part.split(";")[0].strip() for part in request.headers.get("accept-encoding", "").split(",")}
    if "gzip" in accepted and packed.is_file():
        return FileResponse(packed, media_type=kind, headers={**headers, "Content-Encoding": "gzip"})
    return FileResponse(path, media_type=kind, headers=headers)


def _page(request: Request) -> Response:
    """Return the client to a browser that asks for a page; whoever else asks learns that there is nothing."""
    if request.url.path == "/favicon.svg" and (STATIC / "favicon.svg").is_file():
        return FileResponse(STATIC / "favicon.svg", headers={"Cache-Control": "public, max-age=86400"})
    index = STATIC / "index.html"
    if "text/html" not in request.headers.get("accept", "") or not index.is_file():
        raise HTTPException(404)
    # Seconds of loading that whoever looks at pages would wait for with the first large study or report; scripts may need neither.
    request.app.state.installation.computing.warm_up()
    nonce = secrets.token_urlsafe(16)
    return Response(
        index.read_text(encoding="utf-8").replace(_NONCE, nonce),
        media_type="text/html",
        headers={"Content-Security-Policy": POLICY.format(nonce=nonce), "Cache-Control": "no-cache"},
    )


def _reference(_request: Request) -> Response:
    """Return the reference of the interface; its viewer is built with the client and asks no other host."""
    page = STATIC / _REFERENCE
    if not page.is_file():
        raise HTTPException(
            404, "the reference must be built with the pages (make web); the contract is at /openapi.json"
        )
    headers = {"Content-Security-Policy": POLICY.format(nonce=secrets.token_urlsafe(16)), "Cache-Control": "no-cache"}
    return Response(page.read_text(encoding="utf-8"), media_type="text/html", headers=headers)


ROUTES = (
    _Page("/docs/api", _reference),
    _Page("/docs", documentation.page),
    _Page("/docs/{path:path}", documentation.page),
    _Page("/assets/{name}", _asset),
    _Page("/{path:path}", _page),
)
