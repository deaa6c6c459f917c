"""/v1/session and /v1/tickets: how a browser gets in without keeping a key."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response

from api.http import cookies
from api.http.auth import COOKIE, Reader, cookie_of, csrf_token
from api.http.calls import InstallationDep, answer, respond
from api.schemas.access import CallerReply, TicketReply
from api.services.access import sign_ins

router = APIRouter(prefix="/v1", tags=["access"])


@router.post("/session", status_code=201, response_model=CallerReply, summary="Sign a browser in")
def sign_in(caller: Reader, service: InstallationDep) -> Response:
    """Send the key as `Authorization: Bearer <key>` once; the cookie that comes back does as much, out of reach of scripts."""
    with service.database.session() as session:
        body, token = sign_ins.sign_in(service, session, caller)
    response = respond(answer({**body, "csrf_token": csrf_token(token)}, status=201))
    lasts = int(service.settings.sign_in_hours * 3600)
    cookies.put(response, COOKIE, token, seconds=lasts, encrypted=service.settings.encrypted)
    return response


@router.get("/session", response_model=CallerReply, summary="Who am I?")
def who(request: Request, caller: Reader, service: InstallationDep) -> Response:
    """Return what the key or the browser may do, and the token that a page must send with what changes something."""
    cookie = cookie_of(request.headers, service) if caller.expires_at is not None else None
    return respond(answer({**sign_ins.to_wire(caller), "csrf_token": csrf_token(cookie) if cookie else None}))


@router.delete("/session", status_code=204, summary="Sign a browser out")
def sign_out(caller: Reader, service: InstallationDep) -> Response:
    """Let the cookie open nothing any more, here or where it was copied to."""
    with service.database.session() as session:
        sign_ins.sign_out(session, caller)
    service.callers.forget()
    response = Response(status_code=204)
    cookies.forget(response, COOKIE, encrypted=service.settings.encrypted)
    return response


@router.post("/tickets", status_code=201, response_model=TicketReply, summary="Get a ticket for a WebSocket")
def ticket(caller: Reader, service: InstallationDep) -> Response:
    """It opens one connection as the caller, within 30 s."""
    with service.database.session() as session:
        return respond(answer(sign_ins.ticket(session, caller), status=201))
