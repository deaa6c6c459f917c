"""Who is calling: a bearer key for everything under /v1, checked before anything of the request is read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

from fastapi import Depends, Request
from fastapi.security import HTTPBearer
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from api.errors import KNOWN, Problem, problem_of
from api.handlers import problem_response
from api.services.installation import Caller
from api.services.keys import caller_of

PROTECTED = "/v1"

#: Declares the scheme in the OpenAPI document; the check itself is the middleware's.
bearer = HTTPBearer(auto_error=False, description="an API key, `Authorization: Bearer <key>`")


class Authentication:
    """ASGI middleware: 401 without a valid key, whatever the path, method or body below /v1."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through with its caller in ``scope["state"]``, or answer 401."""
        if scope["type"] != "http" or not _is_protected(scope["path"]):
            await self.app(scope, receive, send)
            return
        try:
            caller = await self._caller(scope)
        except Problem as problem:
            await problem_response(problem)(scope, receive, send)
            return
        scope.setdefault("state", {})["caller"] = caller
        await self.app(scope, receive, send)

    async def _caller(self, scope: Scope) -> Caller:
        given = Headers(scope=scope).get("authorization")
        if given is None:
            raise _unauthorized("the header Authorization: Bearer <key> must be sent, got none")
        scheme, _, token = given.partition(" ")
        if scheme.lower() != "bearer" or not token.strip():
            raise _unauthorized("the header Authorization must be Bearer <key>, got another scheme")
        try:
            caller = await run_in_threadpool(caller_of, scope["app"].state.installation.database, token.strip())
        except KNOWN as error:
            problem = problem_of(error)
            assert problem is not None
            raise problem from error
        if caller is None:
            raise _unauthorized("the key must be one that exists and is not revoked, got another")
        return caller


def _is_protected(path: str) -> bool:
    return path == PROTECTED or path.startswith(PROTECTED + "/")


def _unauthorized(detail: str) -> Problem:
    return Problem(401, "unauthorized", detail, headers={"WWW-Authenticate": "Bearer"})


def scoped(*scopes: str) -> Callable[..., Caller]:
    """Return the dependency that gives the caller, or 403 when its key has none of the scopes."""

    def caller(request: Request) -> Caller:
        found: Caller = request.state.caller
        if not found.may(*scopes):
            has = ", ".join(sorted(found.scopes)) or "none"
            raise Problem(403, "forbidden", f"the key must have the scope {' or '.join(scopes)}, got {has}")
        return found

    return caller


Reader = Annotated[Caller, Depends(scoped("read", "write", "run", "acquire"))]
Writer = Annotated[Caller, Depends(scoped("write"))]
Runner = Annotated[Caller, Depends(scoped("run"))]
Uploader = Annotated[Caller, Depends(scoped("write", "acquire"))]
