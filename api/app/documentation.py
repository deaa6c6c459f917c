"""The documentation at /docs: the site that `make docs` builds from `docs/`, with the reference of the interface at /docs/api."""

from __future__ import annotations

import base64
import hashlib
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.staticfiles import StaticFiles

SITE = Path(__file__).parent.parent / "site"
#: As the client's pages: nothing from another host. The few lines of script inside a page are named by their hashes.
POLICY = (
    "default-src 'none'; script-src 'self' {hashes}; style-src 'self' 'unsafe-inline'; img-src 'self' data:; font-src 'self'; "
    "connect-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
_INLINE = re.compile(r"<script>(.*?)</script>", flags=re.DOTALL)


class _Site(StaticFiles):
    """The built files; a page says which scripts it may run."""

    def file_response(
        self, full_path: Any, stat_result: os.stat_result, scope: Any, status_code: int = 200
    ) -> Response:
        """Return a file, or that the browser's copy is still right; it asks each time, as a new version may be served."""
        reply = super().file_response(full_path, stat_result, scope, status_code)
        reply.headers["Cache-Control"] = "no-cache"
        if str(full_path).endswith(".html"):
            reply.headers["Content-Security-Policy"] = _policy(Path(full_path).read_text(encoding="utf-8"))
        return reply


def _policy(page: str) -> str:
    """Return what a page may do."""
    digests = sorted({hashlib.sha256(script.encode()).digest() for script in _INLINE.findall(page)})
    return POLICY.format(hashes=" ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests))


async def page(request: Request) -> Response:
    """Return a file of the site, its start where none is named, and an error that names the cure where it was not built."""
    if request.url.path == "/docs":
        return RedirectResponse("docs/", status_code=307)
    if not (SITE / "index.html").is_file():
        raise HTTPException(
            404,
            "the documentation must be built (make docs); the reference is at /docs/api, the contract at /openapi.json",
        )
    parameters: Mapping[str, str] = request.path_params
    return await _Site(directory=SITE, html=True).get_response(parameters.get("path") or ".", request.scope)
