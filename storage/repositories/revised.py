"""Rows that a user makes, changes and deletes: of two writers that know the same revision of one, one wins.

::

    UPDATE ... SET revision = revision + 1, ... WHERE id = ... AND revision = <the one that the writer knows>
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Generic, TypeVar

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from storage.audit import record
from storage.errors import NotFoundError, RevisionConflictError
from storage.ids import new_id
from storage.models import AcquisitionTemplate, Schedule, Webhook
from storage.pagination import Page, paginate

Row = TypeVar("Row", AcquisitionTemplate, Schedule, Webhook)


class RevisedRepository(Generic[Row]):
    """The rows of one sort in one workspace; a sort says how its rows are called, and how they are made."""

    _row: type[Row]
    #: In front of the ids.
    _prefix: ClassVar[str]
    #: What the audit log calls it, and what a user is told that there is none of.
    _name: ClassVar[str]
    _told_as: ClassVar[str]
    #: What every change sets besides.
    _reset: ClassVar[Mapping[str, Any]] = MappingProxyType({})

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def _add(self, **values: Any) -> Row:
        row = self._row(id=new_id(self._prefix), workspace_id=self._workspace_id, **values)
        self._session.add(row)
        self._session.flush()
        record(self._session, self._workspace_id, f"{self._name}.create", row.id)
        return row

    def get(self, identifier: str) -> Row:
        """Return a row as it is now; raise `NotFoundError` when it is not in this workspace."""
        row = self._session.get(self._row, identifier, populate_existing=True)
        if row is None or row.workspace_id != self._workspace_id:
            raise NotFoundError(self._told_as, identifier)
        return row

    def page(self, *, cursor: str | None = None, limit: int = 100) -> Page[Row]:
        """Return the rows of the workspace, newest first."""
        rows = select(self._row).where(self._row.workspace_id == self._workspace_id)
        return paginate(self._session, rows, self._row, cursor=cursor, limit=limit)

    def update(self, identifier: str, *, expected_revision: int | None, action: str = "update", **values: Any) -> Row:
        """Change a row, and write down that ``action`` was done with it.

        Parameters
        ----------
        expected_revision : int or None
            None changes it whatever its revision is.

        Raises
        ------
        NotFoundError
            When it is not in this workspace.
        RevisionConflictError
            When its revision is not the expected one.
        """
        self.get(identifier)
        changing = update(self._row).where(self._row.id == identifier)
        if expected_revision is not None:
            changing = changing.where(self._row.revision == expected_revision)
        changed = self._session.execute(
            changing.values(revision=self._row.revision + 1, **self._reset, **values)
            .returning(self._row.id)
            .execution_options(synchronize_session=False)
        ).one_or_none()
        row = self.get(identifier)
        if changed is None:
            assert expected_revision is not None
            raise RevisionConflictError(identifier, expected=expected_revision, actual=row.revision)
        record(self._session, self._workspace_id, f"{self._name}.{action}", identifier, revision=row.revision)
        return row

    def delete(self, identifier: str, *, expected_revision: int) -> None:
        """Forget a row, with whatever belongs to it alone. Raises as `update` does."""
        row = self.update(identifier, expected_revision=expected_revision, action="delete")
        self._session.delete(row)
        self._session.flush()
