"""Measurements to be asked for again."""

from __future__ import annotations

from typing import Any

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from storage.audit import record
from storage.errors import NotFoundError, RevisionConflictError
from storage.ids import new_id
from storage.models import AcquisitionTemplate
from storage.models.base import Document
from storage.pagination import Page, paginate


class AcquisitionTemplateRepository:
    """The templates of one workspace."""

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def create(self, *, name: str, document: Document) -> AcquisitionTemplate:
        """Keep a template."""
        row = AcquisitionTemplate(id=new_id("tpl"), workspace_id=self._workspace_id, name=name, document=document)
        self._session.add(row)
        self._session.flush()
        record(self._session, self._workspace_id, "acquisition_template.create", row.id)
        return row

    def get(self, identifier: str) -> AcquisitionTemplate:
        """Return a template; raise `NotFoundError` when it is not in this workspace."""
        row = self._session.get(AcquisitionTemplate, identifier, populate_existing=True)
        if row is None or row.workspace_id != self._workspace_id:
            raise NotFoundError("template", identifier)
        return row

    def page(self, *, cursor: str | None = None, limit: int = 100) -> Page[AcquisitionTemplate]:
        """Return the templates of the workspace, newest first."""
        rows = select(AcquisitionTemplate).where(AcquisitionTemplate.workspace_id == self._workspace_id)
        return paginate(self._session, rows, AcquisitionTemplate, cursor=cursor, limit=limit)

    def update(
        self, identifier: str, *, expected_revision: int, action: str = "update", **values: Any
    ) -> AcquisitionTemplate:
        """Change a template; of two writers that know the same revision, one wins.

        Raises
        ------
        RevisionConflictError
            When the current revision is not the expected one.
        """
        self.get(identifier)
        changed = self._session.execute(
            update(AcquisitionTemplate)
            .where(AcquisitionTemplate.id == identifier, AcquisitionTemplate.revision == expected_revision)
            .values(revision=AcquisitionTemplate.revision + 1, **values)
            .returning(AcquisitionTemplate.id)
            .execution_options(synchronize_session=False)
        ).one_or_none()
        row = self.get(identifier)
        if changed is None:
            raise RevisionConflictError(identifier, expected=expected_revision, actual=row.revision)
        record(self._session, self._workspace_id, f"acquisition_template.{action}", identifier, revision=row.revision)
        return row

    def delete(self, identifier: str, *, expected_revision: int) -> None:
        """Forget a template; raises as `update` does."""
        row = self.update(identifier, expected_revision=expected_revision, action="delete")
        self._session.delete(row)
        self._session.flush()
