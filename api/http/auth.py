"""Who is calling: a bearer key, or the cookie of a browser that has signed in; checked before anything of the request is read.

A cookie is sent by a browser whoever made it send the request, so a request that changes something must also carry what
only a page of this service can know (the synchronizer token of OWASP's cheat sheet on cross-site request forgery): the
hash of the cookie's token, which `GET /v1/session` tells. A WebSocket, which a browser opens without any header, needs a ticket.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Awaitable, Callable
from functools import partial
from http import HTTPStatus
from typing import Annotated

from fastapi import Depends, Request
from fastapi.security import HTTPBearer
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders, QueryParams
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.http import cookies
from api.http.handlers import problem_response
from api.http.presence import POLICY_VIOLATION, Stay
from api.http.rate_limits import Allowance, Rates
from api.problems.documents import Problem
from api.problems.exceptions import KNOWN, problem_of
from api.services.access.keys import caller_of
from api.services.access.sign_ins import holder_of, visitor_of
from api.services.operation.app_context import Caller, Installation
from storage.audit import ACTOR, Actor

PROTECTED = "/v1"
COOKIE = "servotune_sign_in"
CSRF_HEADER = "X-CSRF-Token"

#: Methods that change nothing (RFC 9110, 9.2.1).
_SAFE = frozenset({"GET", "HEAD", "OPTIONS"})

#: Declares the scheme in the OpenAPI document; the check itself is the middleware's.
bearer = HTTPBearer(auto_error=False, description="an API key, `Authorization: Bearer <key>`")


class Authentication:
    """ASGI middleware: 401 without a valid key, whatever the path, method or body below /v1; 429 for one that comes too often.

    Parameters
    ----------
    rates : Rates
        Requests of each caller.
    failures : Rates
        Wrong keys of each address; beyond them a wrong one gets 429. A right one always opens: many people share an address.
    """

    def __init__(self, app: ASGIApp, *, rates: Rates, failures: Rates) -> None:
        self.app = app
        self._rates = rates
        self._failures = failures

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through with its caller in ``scope["state"]``, or refuse it."""
        if scope["type"] not in {"http", "websocket"} or not _is_protected(scope["path"]):
            await self.app(scope, receive, send)
            return
        try:
            caller = await self._admit(scope)
            allowance = self._rates.take(caller.principal)
            if allowance is not None and allowance.wait > 0.0:
                raise _too_often(allowance)
        except KNOWN as error:
            problem = problem_of(error)
            assert problem is not None
            await _refuse(problem, scope, receive, send)
            return
        state = scope.setdefault("state", {})
        state["caller"] = caller
        acting = ACTOR.set(Actor(principal=caller.principal, request_id=state.get("request_id")))
        try:
            service: Installation = scope["app"].state.installation
            answer = send if allowance is None else _telling(allowance, send)
            await Stay(service.callers, caller, answer).serve(self.app, scope, receive)
        finally:
            ACTOR.reset(acting)

    async def _admit(self, scope: Scope) -> Caller:
        try:
            return await _caller(scope["app"].state.installation, scope)
        except Problem as error:
            if error.status == HTTPStatus.UNAUTHORIZED and _shows_something(scope):
                allowance = self._failures.take(_address(scope))
                if allowance is not None and allowance.wait > 0.0:
                    raise _too_many_wrong(allowance) from error
            raise


def _address(scope: Scope) -> str:
    client = scope.get("client")
    return str(client[0]) if client else ""


def _shows_something(scope: Scope) -> bool:
    """Return whether a caller shows a key, a cookie or a ticket, whether it opens or not."""
    headers = Headers(scope=scope)
    ticket = QueryParams(scope["query_string"]).get("ticket", "") if scope["type"] == "websocket" else ""
    return bool(headers.get("authorization") or cookie_of(headers, scope["app"].state.installation) or ticket)


async def _caller(service: Installation, scope: Scope) -> Caller:
    headers = Headers(scope=scope)
    given = headers.get("authorization")
    if given is not None:
        scheme, _, token = given.partition(" ")
        if scheme.lower() != "bearer" or not token.strip():
            raise _unauthorized("the header Authorization must be Bearer <key>, got another scheme")
        token = token.strip()
        caller = await service.callers.find(_hash("key", token), partial(caller_of, service.database, token))
        if caller is None:
            raise _unauthorized("the key must be a valid one, got one that is unknown, was revoked or has expired")
        return caller
    if scope["type"] == "websocket":
        ticket = QueryParams(scope["query_string"]).get("ticket", "")
        caller = await run_in_threadpool(holder_of, service.database, ticket)
        if caller is None or not await service.callers.opens(caller.principal):
            raise _unauthorized("the ticket must be a fresh one of POST /v1/tickets, got another or none")
        return caller
    cookie = cookie_of(headers, service)
    if cookie is None:
        raise _unauthorized("the header Authorization: Bearer <key> must be sent, got none")
    caller = await service.callers.find(_hash("cookie", cookie), partial(visitor_of, service.database, cookie))
    if caller is None:
        raise _unauthorized("the browser must have signed in and not out again, got a sign-in that is over")
    if scope["method"] not in _SAFE and not hmac.compare_digest(
        headers.get(CSRF_HEADER, "").encode(), csrf_token(cookie).encode()
    ):
        raise Problem(
            403, "csrf", f"a browser must send the header {CSRF_HEADER} with the csrf_token of GET /v1/session"
        )
    return caller


def _hash(kind: str, token: str) -> bytes:
    """Return what stands for a token in memory; the same text as a cookie is another one."""
    return hashlib.sha256(f"{kind}:{token}".encode(errors="surrogatepass")).digest()


def cookie_of(headers: Headers, service: Installation) -> str | None:
    """Return the token of a browser's sign-in."""
    return cookies.read(headers, COOKIE, encrypted=service.settings.encrypted)


def csrf_token(cookie: str) -> str:
    """Return what a page of this service must send beside the cookie; it does not tell the cookie's token."""
    return hashlib.sha256(b"csrf:" + cookie.encode()).hexdigest()


def _telling(allowance: Allowance, send: Send) -> Send:
    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in allowance.headers().items():
                headers.setdefault(name, value)
        await send(message)

    return send_with_headers


async def _refuse(problem: Problem, scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":
        await receive()  # the handshake
        await send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": problem.detail})
        return
    await problem_response(problem)(scope, receive, send)


def _is_protected(path: str) -> bool:
    return path == PROTECTED or path.startswith(PROTECTED + "/")


def _unauthorized(detail: str) -> Problem:
    return Problem(401, "unauthorized", detail, headers={"WWW-Authenticate": "Bearer"})


def _too_often(allowance: Allowance) -> Problem:
    detail = f"a caller must make at most {allowance.quota} requests in a minute, got more"
    return Problem(429, "too-many-requests", detail, headers=allowance.headers())


def _too_many_wrong(allowance: Allowance) -> Problem:
    detail = f"an address must show at most {allowance.quota} wrong keys in a minute, got more"
    return Problem(429, "too-many-wrong-keys", detail, headers={"Retry-After": allowance.headers()["Retry-After"]})


def scoped(*scopes: str) -> Callable[..., Awaitable[Caller]]:
    """Return the dependency that gives the caller, or 403 when its key has none of the scopes."""

    async def caller(request: Request) -> Caller:  # what is not waited for needs no thread
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
Acquirer = Annotated[Caller, Depends(scoped("acquire"))]
Admin = Annotated[Caller, Depends(scoped("admin"))]


async def _operator(caller: Admin) -> Caller:
    if not caller.is_operator:
        raise Problem(403, "forbidden", "the key must be an admin key of the workspace that runs the installation")
    return caller


Operator = Annotated[Caller, Depends(_operator)]
