"""Keys: the first admin key of an installation, those that admins make, and who is behind a token."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

from sqlalchemy.orm import Session

from api.problems.documents import invalid
from api.schemas.access import KeyRequest, RotationRequest
from api.services.access.principal_cache import Found
from api.services.operation.app_context import Caller
from storage.errors import NotFoundError
from storage.models import DEFAULT_WORKSPACE, ApiKey
from storage.models.base import utc_now
from storage.repositories import ApiKeyRepository, WorkspaceRepository, authenticate
from storage.session import Database


def caller_of(database: Database, token: str) -> Found | None:
    """Return who calls with this token, None when it opens nothing."""
    with database.session() as session:
        key = authenticate(session, token)
        if key is None:
            return None
        caller = Caller(
            principal=key.id,
            workspace=key.workspace_id,
            scopes=frozenset(str(scope) for scope in key.scopes),
            name=key.name,
        )
        return Found(caller=caller, key=key.id, expires_at=key.expires_at)


def bootstrap(database: Database, token: str | None) -> str | None:
    """Make the first admin key of an installation.

    Parameters
    ----------
    token : str or None
        The operator's own key; it is made an admin key whenever it is not one yet.

    Returns
    -------
    str or None
        The token of a key that was made at random now, and that nobody can read again.
    """
    with database.session() as session:
        keys = ApiKeyRepository(session, DEFAULT_WORKSPACE)
        if token is not None:
            keys.create(name="bootstrap", scopes=["admin"], token=token)
            return None
        if keys.has_admin():
            return None
        return keys.create(name="first admin key", scopes=["admin"])[1]


def create(session: Session, caller: Caller, request: KeyRequest) -> tuple[dict[str, Any], str]:
    """Make a key; return it, and its token apart.

    Raises
    ------
    Problem
        422 for a time that is over, or a workspace that the caller may not see.
    """
    if request.expires_at is not None and request.expires_at <= utc_now():
        raise invalid(f"expires_at must be in the future, got {request.expires_at.isoformat()}", "expires_at")
    workspace = request.workspace or caller.workspace
    try:
        WorkspaceRepository(session, only=None if caller.is_operator else caller.workspace).get(workspace)
    except NotFoundError as error:
        raise invalid(f"workspace must be one that exists, got {workspace!r}", "workspace") from error
    row, token = ApiKeyRepository(session, workspace).create(
        name=request.name, scopes=sorted(set(request.scopes)), expires_at=request.expires_at
    )
    return to_wire(row), token


def get(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return a key without its token."""
    return to_wire(ApiKeyRepository(session, caller.workspace).get(identifier))


def page(session: Session, caller: Caller, *, cursor: str | None, limit: int) -> dict[str, Any]:
    """Return one page of the keys, newest first."""
    found = ApiKeyRepository(session, caller.workspace).page(cursor=cursor, limit=limit)
    return {"items": [to_wire(row) for row in found.items], "next_cursor": found.next_cursor}


def rotate(session: Session, caller: Caller, identifier: str, request: RotationRequest) -> tuple[dict[str, Any], str]:
    """Make a key that may the same as an old one, which ends after the overlap."""
    row, token = ApiKeyRepository(session, caller.workspace).rotate(
        identifier, overlap=timedelta(seconds=request.overlap)
    )
    return {**to_wire(row), "replaces": identifier}, token


def revoke(session: Session, caller: Caller, identifier: str) -> None:
    """Let a key open nothing any more."""
    ApiKeyRepository(session, caller.workspace).revoke(identifier)


def to_wire(row: ApiKey) -> dict[str, Any]:
    """Return what is known of a key; its token is not."""
    return {
        "id": row.id,
        "workspace": row.workspace_id,
        "name": row.name,
        "scopes": row.scopes,
        "prefix": row.prefix,
        "created_at": row.created_at.isoformat(),
        "expires_at": row.expires_at.isoformat() if row.expires_at else None,
        "last_used_at": row.last_used_at.isoformat() if row.last_used_at else None,
        "revoked_at": row.revoked_at.isoformat() if row.revoked_at else None,
    }
