"""Workspaces themselves: made, renamed and limited by whoever runs the installation."""

from __future__ import annotations

from collections.abc import Mapping

from sqlalchemy import select, update
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from storage.audit import record
from storage.errors import NotFoundError, RevisionConflictError, StateError
from storage.ids import new_id
from storage.insertion import insert_if_absent
from storage.models import Workspace
from storage.pagination import Page, paginate


class WorkspaceRepository:
    """The workspaces of the installation, or only one of them.

    Parameters
    ----------
    only : str, optional
        The workspace that the caller may see; any other does not exist for it.
    """

    def __init__(self, session: Session, *, only: str | None = None) -> None:
        self._session = session
        self._only = only

    def create(self, *, name: str, limits: Mapping[str, int] | None = None) -> Workspace:
        """Make a workspace.

        Raises
        ------
        StateError
            When there is one of this name.
        """
        identifier = new_id("ws")
        values = {"name": name, "limits": dict(limits) if limits else None}
        if not insert_if_absent(self._session, Workspace, id=identifier, **values):
            raise _taken(name)
        record(self._session, identifier, "workspace.create", identifier, name=name)
        return self.get(identifier)

    def get(self, identifier: str) -> Workspace:
        """Return a workspace; raise `NotFoundError` when it is none that the caller may see."""
        workspace = self._session.get(Workspace, identifier, populate_existing=True)
        if workspace is None or self._only not in {None, identifier}:
            raise NotFoundError("workspace", identifier)
        return workspace

    def page(self, *, cursor: str | None = None, limit: int = 100) -> Page[Workspace]:
        """Return the workspaces, newest first."""
        rows = select(Workspace)
        if self._only is not None:
            rows = rows.where(Workspace.id == self._only)
        return paginate(self._session, rows, Workspace, cursor=cursor, limit=limit)

    def update(
        self, identifier: str, *, name: str, limits: Mapping[str, int] | None, expected_revision: int
    ) -> Workspace:
        """Give a workspace another name or other limits; of two writers that know the same revision, one wins.

        Raises
        ------
        RevisionConflictError
            When the current revision is not the expected one.
        StateError
            When another workspace has this name.
        """
        self.get(identifier)
        change = (
            update(Workspace)
            .where(Workspace.id == identifier, Workspace.revision == expected_revision)
            .values(name=name, limits=dict(limits) if limits else None, revision=expected_revision + 1)
            .returning(Workspace.id)
            .execution_options(synchronize_session=False)
        )
        try:
            with self._session.begin_nested():
                changed = self._session.execute(change).one_or_none()
        except IntegrityError as error:
            raise _taken(name) from error
        workspace = self.get(identifier)
        if changed is None:
            raise RevisionConflictError(identifier, expected=expected_revision, actual=workspace.revision)
        record(self._session, identifier, "workspace.update", identifier, name=name, limits=workspace.limits)
        return workspace


def _taken(name: str) -> StateError:
    return StateError(f"name of a workspace must be a new one, got {name!r}")
