"""/v1/audit: who changed what."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response

from api.http.auth import Admin
from api.http.calls import Cursor, InstallationDep, Limit, answer, respond
from api.schemas.access import AuditReply
from api.schemas.replies import Page
from api.services.access import audit

router = APIRouter(prefix="/v1/audit", tags=["access"])

Word = Annotated[str | None, Query(max_length=64)]


@router.get("", response_model=Page[AuditReply], summary="Read the audit log")
def page(
    caller: Admin,
    service: InstallationDep,
    action: Word = None,
    target: Word = None,
    principal: Word = None,
    cursor: Cursor = None,
    limit: Limit = 100,
) -> Response:
    """Newest first; an entry is there exactly when the change is."""
    with service.database.session() as session:
        body = audit.page(
            session, caller, action=action, target=target, principal=principal, cursor=cursor, limit=limit
        )
    return respond(answer(body))
