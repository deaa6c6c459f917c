"""Browsers: signed in with a key, kept in by a cookie; and the tickets with which they open a WebSocket."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Any

from sqlalchemy.orm import Session

from api.problems.documents import Problem
from api.services.access.openid import Person
from api.services.access.principal_cache import Found
from api.services.operation.app_context import Caller, Installation
from storage.errors import NotFoundError
from storage.repositories import SignInRepository, Visitor, WorkspaceRepository
from storage.session import Database

#: How long a ticket opens a WebSocket.
TICKET_LASTS = timedelta(seconds=30)


def visitor_of(database: Database, cookie: str) -> Found | None:
    """Return who has this cookie, None when its sign-in is over."""
    with database.session() as session:
        visitor = SignInRepository(session).visitor(cookie)
    if visitor is None:
        return None
    return Found(caller=_caller(visitor, ends=True), key=visitor.key_id, expires_at=visitor.expires_at)


def holder_of(database: Database, ticket: str) -> Caller | None:
    """Return who may open a WebSocket with this ticket, which it may do once; None when nobody may."""
    with database.session() as session:
        visitor = SignInRepository(session).redeem(ticket)
    return None if visitor is None else _caller(visitor, ends=False)


def _caller(visitor: Visitor, *, ends: bool) -> Caller:
    return Caller(
        principal=visitor.principal,
        workspace=visitor.workspace_id,
        scopes=visitor.scopes,
        name=visitor.name,
        expires_at=visitor.expires_at if ends else None,
    )


def sign_in(service: Installation, session: Session, caller: Caller) -> tuple[dict[str, Any], str]:
    """Sign the browser in that sent a key; return who it is now, and the token for its cookie.

    Raises
    ------
    Problem
        409 for a caller that came with a cookie.
    """
    if caller.expires_at is not None:
        raise Problem(409, "conflict", "a browser must sign in with a key, this one has signed in already")
    lasts = timedelta(hours=service.settings.sign_in_hours)
    row, token = SignInRepository(session).open(
        workspace_id=caller.workspace, name=caller.name, lasts=lasts, key_id=caller.principal
    )
    signed_in = Caller(
        principal=row.id,
        workspace=row.workspace_id,
        scopes=caller.scopes,
        name=row.name,
        expires_at=row.expires_at,
    )
    return to_wire(signed_in), token


def admit(service: Installation, session: Session, person: Person) -> str:
    """Sign the browser of somebody in whom the OpenID provider knows; return the token for its cookie.

    Raises
    ------
    Problem
        403 for a role in a workspace that does not exist.
    """
    workspace = person.role.workspace
    try:
        WorkspaceRepository(session).get(workspace)
    except NotFoundError as error:
        detail = f"the workspace of a role must exist, got {workspace!r} in SERVOTUNE_OIDC_ROLES"
        raise Problem(403, "sign-in-refused", detail) from error
    lasts = timedelta(hours=service.settings.sign_in_hours)
    _row, token = SignInRepository(session).open(
        workspace_id=workspace, name=person.name, lasts=lasts, scopes=person.role.scopes
    )
    return token


def sign_out(session: Session, caller: Caller) -> None:
    """Let the cookie open nothing any more; a caller with a key has nothing to sign out of."""
    SignInRepository(session).close(caller.principal)


def ticket(session: Session, caller: Caller) -> dict[str, Any]:
    """Return a ticket that opens one WebSocket."""
    given, expires_at = SignInRepository(session).give_ticket(
        principal=caller.principal,
        workspace_id=caller.workspace,
        scopes=sorted(caller.scopes),
        lasts=TICKET_LASTS,
    )
    return {"ticket": given, "expires_at": expires_at.isoformat()}


def to_wire(caller: Caller) -> dict[str, Any]:
    """Return who calls."""
    return {
        "principal": caller.principal,
        "name": caller.name,
        "workspace": caller.workspace,
        "scopes": sorted(caller.scopes),
        "expires_at": _iso(caller.expires_at),
    }


def _iso(time: datetime | None) -> str | None:
    return time.isoformat() if time else None
