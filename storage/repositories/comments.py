"""Comments on systems, datasets, jobs and kept results."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from sqlalchemy import ColumnElement, false, func, select
from sqlalchemy.orm import Session

from storage.audit import record
from storage.errors import NotFoundError, StateError
from storage.ids import new_id
from storage.models import Comment, Dataset, Job, Result, SignIn, System
from storage.pagination import Page, paginate

#: Comments on one thing.
MOST = 500

#: What an identifier begins with -> its table, and the column of the comments on it.
_SUBJECTS: Mapping[str, tuple[type[Any], str]] = MappingProxyType(
    {
        "sys": (System, "system_id"),
        "ds": (Dataset, "dataset_id"),
        "job": (Job, "job_id"),
        "res": (Result, "result_id"),
    }
)


def author_of(session: Session, principal: str) -> str:
    """Return whom a comment belongs to: the key behind a browser's sign-in, which outlives that, else the principal itself."""
    visitor = session.get(SignIn, principal)
    return principal if visitor is None or visitor.key_id is None else visitor.key_id


def about(row: Comment) -> str:
    """Return the id of what a comment is about."""
    found = row.system_id or row.dataset_id or row.job_id or row.result_id
    assert found is not None
    return found


class CommentRepository:
    """The comments of one workspace."""

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def create(self, *, subject: str, author_id: str, author_name: str, text: str) -> Comment:
        """Keep a comment on a thing.

        Raises
        ------
        NotFoundError
            When there is no such system, dataset, job or kept result in this workspace.
        StateError
            When there are `MOST` on it.
        """
        column = self._hold(subject)
        count = self._session.scalar(select(func.count()).select_from(Comment).where(_is_about(subject))) or 0
        if count >= MOST:
            raise StateError(f"{subject!r} must have at most {MOST} comments, it has {count}")
        row = Comment(
            id=new_id("com"),
            workspace_id=self._workspace_id,
            author_id=author_id,
            author_name=author_name,
            text=text,
            **{column: subject},
        )
        self._session.add(row)
        self._session.flush()
        record(self._session, self._workspace_id, "comment.create", row.id, about=subject)
        return row

    def get(self, identifier: str) -> Comment:
        """Return a comment; raise `NotFoundError` when it is not in this workspace."""
        row = self._session.get(Comment, identifier)
        if row is None or row.workspace_id != self._workspace_id:
            raise NotFoundError("comment", identifier)
        return row

    def page(self, *, subject: str | None = None, cursor: str | None = None, limit: int = 100) -> Page[Comment]:
        """Return the comments, or those on one thing, newest first; there are none on what is not there."""
        rows = select(Comment).where(Comment.workspace_id == self._workspace_id)
        if subject is not None:
            rows = rows.where(_is_about(subject))
        return paginate(self._session, rows, Comment, cursor=cursor, limit=limit)

    def delete(self, identifier: str) -> None:
        """Delete a comment; raise `NotFoundError` when it is not in this workspace."""
        row = self.get(identifier)
        self._session.delete(row)
        self._session.flush()
        record(self._session, self._workspace_id, "comment.delete", identifier, about=about(row), author=row.author_id)

    def _hold(self, subject: str) -> str:
        """Return the column of the comments on a thing, which cannot be deleted until the transaction ends."""
        table, column = _SUBJECTS.get(subject.partition("_")[0], (None, ""))
        if table is not None:
            held = select(table.id).where(table.id == subject, table.workspace_id == self._workspace_id)
            if table is System:
                held = held.where(System.deleted_at.is_(None))
            if self._session.scalar(held.with_for_update(read=True)) is not None:
                return column
        raise NotFoundError("system, dataset, job or kept result", subject)


def _is_about(subject: str) -> ColumnElement[bool]:
    _, column = _SUBJECTS.get(subject.partition("_")[0], (None, ""))
    return false() if not column else getattr(Comment, column) == subject
