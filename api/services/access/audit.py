"""The log of who changed what."""

from __future__ import annotations

from typing import Any

from sqlalchemy.orm import Session

from api.services.operation.app_context import Caller
from storage.audit import entries
from storage.models import AuditEntry


def page(
    session: Session,
    caller: Caller,
    *,
    action: str | None,
    target: str | None,
    principal: str | None,
    cursor: str | None,
    limit: int,
) -> dict[str, Any]:
    """Return one page of the log of the caller's workspace, newest first."""
    found = entries(
        session, caller.workspace, action=action, target=target, principal=principal, cursor=cursor, limit=limit
    )
    return {"items": [_to_wire(row) for row in found.items], "next_cursor": found.next_cursor}


def _to_wire(row: AuditEntry) -> dict[str, Any]:
    return {
        "id": row.id,
        "created_at": row.created_at.isoformat(),
        "principal": row.principal,
        "request_id": row.request_id,
        "action": row.action,
        "target": row.target,
        "detail": row.detail,
    }
