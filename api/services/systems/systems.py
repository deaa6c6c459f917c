"""System documents: kept with their revisions, and compiled once for each."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from sqlalchemy.orm import Session

from api.convert.studies import warnings_to_wire
from api.convert.systems import diagram_from_wire
from api.problems.documents import invalid
from api.problems.pointers import Place
from api.schemas.systems import SystemDocument
from api.services.lineage.lineage import check_free, check_origin
from api.services.operation.app_context import Caller, Installation
from engine.diagram.diagram import Diagram
from storage.errors import NotFoundError
from storage.models import System, SystemRevision
from storage.pagination import Narrowing
from storage.repositories import SystemRepository
from storage.repositories.systems import StoredSystem
from storage.upcasting import CURRENT


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """The system of a request: its document, its diagram, and the stored revision it came from."""

    document: dict[str, Any]
    diagram: Diagram
    reference: Mapping[str, Any] | None

    @property
    def place(self) -> Place | None:
        """Where the document stands in the request, None when the request only names it."""
        return ("system",) if self.reference is None else None

    def warnings(self) -> list[dict[str, str]]:
        """Return the diagram's warnings with their places in the request."""
        return warnings_to_wire(self.diagram.warnings, place=self.place)


def document_of(document: SystemDocument) -> dict[str, Any]:
    """Return the JSON that the caller sent: units as written, no default filled in."""
    return document.model_dump(by_alias=True, exclude_unset=True)


#: The revision of the stored system that is meant; the current one where there is none.
_REVISION: ContextVar[int | None] = ContextVar("revision", default=None)


@contextmanager
def at_revision(number: int | None) -> Iterator[None]:
    """Let a request that names a stored system mean this revision of it: the one when the request was made."""
    token = _REVISION.set(number)
    try:
        yield
    finally:
        _REVISION.reset(token)


@lru_cache(maxsize=256)
def _compiled(text: str, place: Place) -> Diagram:
    return diagram_from_wire(SystemDocument.model_validate_json(text), place=place)


def compiled(document: Mapping[str, Any], *, place: Place) -> Diagram:
    """Return the checked diagram of a validated document; the same document is compiled once.

    Raises
    ------
    Problem
        422 with the place of what is wrong.
    """
    return _compiled(json.dumps(document, sort_keys=False), place)


def subject_of(service: Installation, caller: Caller, given: str | SystemDocument) -> Subject:
    """Return the system that a request means: a stored one by its identifier, or the document itself.

    Raises
    ------
    Problem
        422 with the place in the request.
    """
    if isinstance(given, SystemDocument):
        document = document_of(given)
        return Subject(document=document, diagram=compiled(document, place=("system",)), reference=None)
    with service.database.session() as session:
        try:
            stored = SystemRepository(session, caller.workspace).get(given, revision=_REVISION.get())
        except NotFoundError as error:
            raise invalid(f"system must be a stored system or a document, got {given!r}", "system") from error
    diagram = compiled(stored.document, place=("system",))
    return Subject(document=stored.document, diagram=diagram, reference={"id": stored.id, "revision": stored.revision})


def _stored_to_wire(stored: StoredSystem, diagram: Diagram) -> dict[str, Any]:
    return {
        "id": stored.id,
        "revision": stored.revision,
        "created_at": stored.created_at.isoformat(),
        "revised_at": stored.revised_at.isoformat(),
        "document": stored.document,
        "warnings": warnings_to_wire(diagram.warnings, place=()),
    }


def create(
    session: Session, caller: Caller, document: SystemDocument, *, derived_from: str | None = None
) -> dict[str, Any]:
    """Keep a new document, proven to be a diagram; ``derived_from`` is what its numbers come from."""
    check_origin(session, caller, derived_from)
    wire = document_of(document)
    diagram = compiled(wire, place=())
    stored = SystemRepository(session, caller.workspace).create(
        name=document.name, document=wire, schema_version=CURRENT, derived_from=derived_from
    )
    return _stored_to_wire(stored, diagram)


def get(session: Session, caller: Caller, identifier: str, *, revision: int | None = None) -> dict[str, Any]:
    """Return a document at its current or a given revision."""
    stored = SystemRepository(session, caller.workspace).get(identifier, revision=revision)
    return _stored_to_wire(stored, compiled(stored.document, place=()))


def update(
    session: Session,
    caller: Caller,
    identifier: str,
    document: SystemDocument,
    *,
    expected_revision: int,
    derived_from: str | None = None,
) -> dict[str, Any]:
    """Append a revision; ``derived_from`` is what its numbers come from."""
    check_origin(session, caller, derived_from)
    wire = document_of(document)
    diagram = compiled(wire, place=())
    stored = SystemRepository(session, caller.workspace).update(
        identifier,
        name=document.name,
        document=wire,
        expected_revision=expected_revision,
        schema_version=CURRENT,
        derived_from=derived_from,
    )
    return _stored_to_wire(stored, diagram)


def delete(session: Session, caller: Caller, identifier: str, *, expected_revision: int, force: bool = False) -> None:
    """Hide a system, unless a schedule needs it; results keep its revisions."""
    repository = SystemRepository(session, caller.workspace)
    repository.get(identifier)
    check_free(session, caller, identifier, force=force)
    repository.delete(identifier, expected_revision=expected_revision)


def page(session: Session, caller: Caller, *, narrowing: Narrowing, cursor: str | None, limit: int) -> dict[str, Any]:
    """Return one page of the systems, newest first, without their documents."""
    found = SystemRepository(session, caller.workspace).page(narrowing=narrowing, cursor=cursor, limit=limit)
    return {"items": [_head(row) for row in found.items], "next_cursor": found.next_cursor}


def _head(row: System) -> dict[str, Any]:
    return {
        "id": row.id,
        "name": row.name,
        "revision": row.revision,
        "created_at": row.created_at.isoformat(),
        "updated_at": row.updated_at.isoformat(),
    }


def revisions(session: Session, caller: Caller, identifier: str, *, cursor: str | None, limit: int) -> dict[str, Any]:
    """Return one page of a system's revisions, newest first."""
    if cursor is not None and not (cursor.isascii() and cursor.isdigit()):
        raise invalid(f"cursor must be the next_cursor of the page before, got {cursor!r}")
    before = int(cursor) if cursor is not None else None
    rows = SystemRepository(session, caller.workspace).revisions(identifier, before=before, limit=limit + 1)
    shown = rows[:limit]
    return {
        "items": [_revision(row) for row in shown],
        "next_cursor": str(shown[-1].number) if len(rows) > limit else None,
    }


def _revision(row: SystemRevision) -> dict[str, Any]:
    return {"id": row.system_id, "revision": row.number, "created_at": row.created_at.isoformat()}


def current_revision(session: Session, caller: Caller, identifier: str) -> int:
    """Return the number of the current revision."""
    return SystemRepository(session, caller.workspace).get(identifier).revision
