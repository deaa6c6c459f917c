"""System documents with their revisions."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import and_, delete, select, update
from sqlalchemy.orm import Session

from storage import quotas
from storage.audit import record
from storage.errors import NotFoundError, RevisionConflictError
from storage.ids import new_id
from storage.lineage import model_key, remember
from storage.models import Comment, System, SystemRevision
from storage.models.base import MAX_INTEGER, Document, utc_now
from storage.pagination import EVERY, Narrowing, Page, paginate
from storage.upcasting import CURRENT, upcast


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredSystem:
    """A system document at one of its revisions; ``created_at`` is that of the system."""

    id: str
    name: str
    revision: int
    document: Document
    schema_version: int
    created_at: datetime
    revised_at: datetime


class SystemRepository:
    """The system documents of one workspace."""

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def create(
        self, *, name: str, document: Document, schema_version: int = CURRENT, derived_from: str | None = None
    ) -> StoredSystem:
        """Keep a new document as revision 1; raise `QuotaExceededError` when there are too many.

        ``derived_from`` is what its numbers come from: a job, for its lineage.
        """
        system = System(id=new_id("sys"), workspace_id=self._workspace_id, name=name, revision=1)
        self._session.add(system)
        self._session.flush()
        stored = self._append(system, document, schema_version, action="system.create", derived_from=derived_from)
        quotas.count_system(self._session, self._workspace_id, _size(document))
        return stored

    def get(self, identifier: str, *, revision: int | None = None) -> StoredSystem:
        """Return a document at its current or a given revision.

        Raises
        ------
        NotFoundError
            When the system is not in this workspace, was deleted, or never had that revision.
        """
        number = System.revision if revision is None else max(0, min(revision, MAX_INTEGER))
        found = self._session.execute(  # both in one question: this is what is asked most
            select(System, SystemRevision)
            .join(SystemRevision, and_(SystemRevision.system_id == System.id, SystemRevision.number == number))
            .where(System.id == identifier, System.workspace_id == self._workspace_id, System.deleted_at.is_(None))
        ).one_or_none()
        if found is None:
            self._head(identifier)
            raise NotFoundError("revision", f"{identifier}/{revision}")
        return _stored(*found)

    def kept_revision(self, identifier: str, number: int) -> Document:
        """Return the document of a revision, also of a system that was deleted: results keep what they used.

        Raises
        ------
        NotFoundError
            When this workspace never had it.
        """
        system = self._session.get(System, identifier)
        row = None
        if system is not None and system.workspace_id == self._workspace_id:
            row = self._session.get(SystemRevision, (identifier, number))
        if row is None:
            raise NotFoundError("revision", f"{identifier}/{number}")
        return upcast(row.document, row.schema_version)

    def update(
        self,
        identifier: str,
        *,
        name: str,
        document: Document,
        expected_revision: int,
        schema_version: int = CURRENT,
        derived_from: str | None = None,
    ) -> StoredSystem:
        """Append a revision; of two writers that know the same revision, one wins. ``derived_from`` as in `create`.

        Raises
        ------
        NotFoundError
            When the system is not in this workspace or was deleted.
        RevisionConflictError
            When the current revision is not the expected one.
        """
        system = self._move(
            identifier, expected_revision, name=name, revision=expected_revision + 1, updated_at=utc_now()
        )
        stored = self._append(system, document, schema_version, action="system.update", derived_from=derived_from)
        quotas.add_bytes(self._session, self._workspace_id, _size(document))
        return stored

    def delete(self, identifier: str, *, expected_revision: int) -> None:
        """Hide a system; its revisions stay for the results that used them, its comments go. Raises as `update` does."""
        self._move(identifier, expected_revision, deleted_at=utc_now())
        self._session.execute(delete(Comment).where(Comment.system_id == identifier))
        record(self._session, self._workspace_id, "system.delete", identifier, revision=expected_revision)

    def page(self, *, narrowing: Narrowing = EVERY, cursor: str | None = None, limit: int = 100) -> Page[System]:
        """Return the heads (without documents) of the systems that are not deleted, newest first."""
        rows = select(System).where(System.workspace_id == self._workspace_id, System.deleted_at.is_(None))
        return paginate(self._session, narrowing.of(rows, System), System, cursor=cursor, limit=limit)

    def revisions(self, identifier: str, *, before: int | None = None, limit: int = 100) -> list[SystemRevision]:
        """Return the revisions of a system below ``before``, newest first."""
        self._head(identifier)
        rows = select(SystemRevision).where(SystemRevision.system_id == identifier)
        if before is not None:
            rows = rows.where(SystemRevision.number < min(before, MAX_INTEGER))
        return list(self._session.scalars(rows.order_by(SystemRevision.number.desc()).limit(limit)))

    def _head(self, identifier: str) -> System:
        system = self._session.get(System, identifier)
        if system is None or system.workspace_id != self._workspace_id or system.deleted_at is not None:
            raise NotFoundError("system", identifier)
        return system

    def _move(self, identifier: str, expected_revision: int, **values: object) -> System:
        """Change the head, provided that it is at the expected revision when the change takes place."""
        system = self._head(identifier)
        if system.revision != expected_revision:
            raise RevisionConflictError(identifier, expected=expected_revision, actual=system.revision)
        moved = self._session.execute(
            update(System)
            .where(System.id == identifier, System.revision == expected_revision, System.deleted_at.is_(None))
            .values(**values)
            .returning(System.id)
            .execution_options(synchronize_session=False)
        ).one_or_none()
        self._session.refresh(system)
        if moved is None:
            self._head(identifier)
            raise RevisionConflictError(identifier, expected=expected_revision, actual=system.revision)
        return system

    def _append(
        self, system: System, document: Document, schema_version: int, *, action: str, derived_from: str | None
    ) -> StoredSystem:
        row = SystemRevision(
            system_id=system.id, number=system.revision, document=document, schema_version=schema_version
        )
        self._session.add(row)
        self._session.flush()
        sources = [] if row.number == 1 else [model_key(system.id, row.number - 1)]
        sources += [] if derived_from is None else [derived_from]
        remember(self._session, self._workspace_id, model_key(system.id, row.number), sources)
        record(self._session, self._workspace_id, action, system.id, revision=row.number)
        return _stored(system, row)


def _size(document: Document) -> int:
    return len(json.dumps(document))


def _stored(system: System, row: SystemRevision) -> StoredSystem:
    return StoredSystem(
        id=system.id,
        name=system.name,
        revision=row.number,
        document=upcast(row.document, row.schema_version),
        schema_version=CURRENT,
        created_at=system.created_at,
        revised_at=row.created_at,
    )
