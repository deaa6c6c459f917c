"""Writes down who changed what, in the transaction of the change: there is an entry exactly when there is a change."""

from __future__ import annotations

from contextvars import ContextVar
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import CursorResult, delete, select
from sqlalchemy.orm import Session

from storage.ids import new_id
from storage.models import AuditEntry
from storage.pagination import Page, paginate


@dataclass(frozen=True, slots=True, kw_only=True)
class Actor:
    """Who acts: the id of a key or a sign-in, and the request in which it does so."""

    principal: str
    request_id: str | None = None


#: Who acts now; a request sets it for everything that is done on its behalf. Otherwise the installation acts itself.
ACTOR: ContextVar[Actor] = ContextVar("actor", default=Actor(principal="installation"))  # noqa: B039 - it is frozen


def record(session: Session, workspace_id: str, action: str, target: str, **detail: Any) -> None:
    """Add an entry to the log of a workspace.

    Parameters
    ----------
    action : str
        ``<kind of thing>.<what was done>``: ``system.update``.
    target : str
        The id of the thing.
    detail
        JSON that says more; never a secret.
    """
    actor = ACTOR.get()
    session.add(
        AuditEntry(
            id=new_id("aud"),
            workspace_id=workspace_id,
            principal=actor.principal,
            request_id=actor.request_id,
            action=action,
            target=target,
            detail=detail or None,
        )
    )
    session.flush()


def entries(
    session: Session,
    workspace_id: str,
    *,
    action: str | None = None,
    target: str | None = None,
    principal: str | None = None,
    cursor: str | None = None,
    limit: int = 100,
) -> Page[AuditEntry]:
    """Return the log of a workspace, newest first."""
    rows = select(AuditEntry).where(AuditEntry.workspace_id == workspace_id)
    for column, value in (
        (AuditEntry.action, action),
        (AuditEntry.target, target),
        (AuditEntry.principal, principal),
    ):
        if value is not None:
            rows = rows.where(column == value)
    return paginate(session, rows, AuditEntry, cursor=cursor, limit=limit)


def forget(session: Session, *, before: datetime) -> int:
    """Delete entries written before a time; return how many."""
    result = session.execute(delete(AuditEntry).where(AuditEntry.created_at < before))
    assert isinstance(result, CursorResult)
    return result.rowcount
