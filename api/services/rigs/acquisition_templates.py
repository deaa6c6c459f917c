"""Templates of measurements: what is asked for again and again, with or without what differs each time."""

from __future__ import annotations

from typing import Any

from sqlalchemy.orm import Session

from api.problems.documents import invalid
from api.schemas.acquisitions import AcquisitionBody, AcquisitionRequest
from api.services.operation.app_context import Caller, Installation
from api.services.rigs import acquisitions
from storage.models import AcquisitionTemplate
from storage.repositories import AcquisitionTemplateRepository


def check(service: Installation, caller: Caller, request: AcquisitionRequest) -> dict[str, Any]:
    """Return what is kept of a template; one that names everything is proven to make sense on its rig.

    Raises
    ------
    Problem
        422 with the place of what is wrong.
    """
    if request.template is not None:
        raise invalid("template must be left out of a template", "template")
    document = request.model_dump(by_alias=True, exclude_unset=True, mode="json")
    if not document.get("name"):
        raise invalid("name must be given", "name")
    needed = {name for name, field in AcquisitionBody.model_fields.items() if field.is_required()}
    if needed <= {key for key, value in document.items() if value is not None}:
        acquisitions.prepare(service, caller, request)
    return document


def create(session: Session, caller: Caller, document: dict[str, Any]) -> dict[str, Any]:
    """Keep a template."""
    repository = AcquisitionTemplateRepository(session, caller.workspace)
    return to_wire(repository.create(name=document["name"], document=document))


def get(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return a template."""
    return to_wire(AcquisitionTemplateRepository(session, caller.workspace).get(identifier))


def page(session: Session, caller: Caller, *, cursor: str | None, limit: int) -> dict[str, Any]:
    """Return one page of the templates, newest first."""
    found = AcquisitionTemplateRepository(session, caller.workspace).page(cursor=cursor, limit=limit)
    return {"items": [to_wire(row) for row in found.items], "next_cursor": found.next_cursor}


def update(
    session: Session, caller: Caller, identifier: str, document: dict[str, Any], *, expected_revision: int
) -> dict[str, Any]:
    """Replace a template."""
    repository = AcquisitionTemplateRepository(session, caller.workspace)
    return to_wire(
        repository.update(identifier, expected_revision=expected_revision, name=document["name"], document=document)
    )


def delete(session: Session, caller: Caller, identifier: str, *, expected_revision: int) -> None:
    """Forget a template."""
    AcquisitionTemplateRepository(session, caller.workspace).delete(identifier, expected_revision=expected_revision)


def to_wire(row: AcquisitionTemplate) -> dict[str, Any]:
    """Return a template."""
    return {
        "id": row.id,
        "name": row.name,
        "revision": row.revision,
        "created_at": row.created_at.isoformat(),
        "document": row.document,
    }
