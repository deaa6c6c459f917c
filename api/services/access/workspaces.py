"""Workspaces: what each may have and has."""

from __future__ import annotations

from typing import Any

from sqlalchemy.orm import Session

from api.schemas.access import WorkspaceRequest
from api.services.operation.app_context import Caller
from storage import quotas
from storage.models import Workspace
from storage.repositories import WorkspaceRepository


def _seen_by(session: Session, caller: Caller) -> WorkspaceRepository:
    """Return the workspaces that a caller may see: all of them for whoever runs the installation, else its own."""
    return WorkspaceRepository(session, only=None if caller.is_operator else caller.workspace)


def create(session: Session, caller: Caller, request: WorkspaceRequest) -> dict[str, Any]:
    """Make a workspace."""
    row = _seen_by(session, caller).create(name=request.name, limits=_limits(request))
    return _to_wire(session, row)


def get(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return a workspace with its limits and what is used of them."""
    return _to_wire(session, _seen_by(session, caller).get(identifier))


def page(session: Session, caller: Caller, *, cursor: str | None, limit: int) -> dict[str, Any]:
    """Return one page of the workspaces, newest first."""
    found = _seen_by(session, caller).page(cursor=cursor, limit=limit)
    return {"items": [_head(row) for row in found.items], "next_cursor": found.next_cursor}


def update(
    session: Session, caller: Caller, identifier: str, request: WorkspaceRequest, *, expected_revision: int
) -> dict[str, Any]:
    """Give a workspace another name or other limits."""
    row = _seen_by(session, caller).update(
        identifier, name=request.name, limits=_limits(request), expected_revision=expected_revision
    )
    return _to_wire(session, row)


def _limits(request: WorkspaceRequest) -> dict[str, int] | None:
    return request.limits.model_dump(exclude_none=True) if request.limits else None


def _head(row: Workspace) -> dict[str, Any]:
    return {"id": row.id, "name": row.name, "revision": row.revision, "created_at": row.created_at.isoformat()}


def _to_wire(session: Session, row: Workspace) -> dict[str, Any]:
    document = {"name": row.name, "limits": row.limits} if row.limits else {"name": row.name}
    return {
        **_head(row),
        "document": document,
        "limits": quotas.limits_of(row),
        "used": quotas.usage(session, row),
    }
