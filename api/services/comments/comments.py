"""Comments as their writers and readers see them."""

from __future__ import annotations

from typing import Any

from sqlalchemy.orm import Session

from api.problems.documents import Problem, invalid
from api.schemas.comments import CommentRequest
from api.services.operation.app_context import Caller
from storage.errors import NotFoundError, RevisionConflictError
from storage.models import Comment
from storage.repositories import CommentRepository
from storage.repositories.comments import about, author_of

REVISION = 1
"""A comment is never changed: it has one revision."""


def create(session: Session, caller: Caller, request: CommentRequest) -> dict[str, Any]:
    """Keep a comment.

    Raises
    ------
    Problem
        422 when there is nothing that it could be about.
    """
    author = author_of(session, caller.principal)
    try:
        row = CommentRepository(session, caller.workspace).create(
            subject=request.about, author_id=author, author_name=caller.name, text=request.text
        )
    except NotFoundError as error:
        detail = (
            f"about must be the id of a system, a dataset, a job or a kept result that exists, got {request.about!r}"
        )
        raise invalid(detail, "about") from error
    return _to_wire(row, caller, author)


def get(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return a comment."""
    row = CommentRepository(session, caller.workspace).get(identifier)
    return _to_wire(row, caller, author_of(session, caller.principal))


def page(session: Session, caller: Caller, *, subject: str | None, cursor: str | None, limit: int) -> dict[str, Any]:
    """Return one page of the comments, newest first."""
    found = CommentRepository(session, caller.workspace).page(subject=subject, cursor=cursor, limit=limit)
    author = author_of(session, caller.principal)
    return {"items": [_to_wire(row, caller, author) for row in found.items], "next_cursor": found.next_cursor}


def delete(session: Session, caller: Caller, identifier: str, *, expected_revision: int) -> None:
    """Delete a comment.

    Raises
    ------
    Problem
        403 when it is another's and the caller is no admin.
    RevisionConflictError
        When another revision than the only one is expected.
    """
    repository = CommentRepository(session, caller.workspace)
    row = repository.get(identifier)
    if expected_revision != REVISION:
        raise RevisionConflictError(identifier, expected=expected_revision, actual=REVISION)
    if not _deletable(row, caller, author_of(session, caller.principal)):
        detail = f"a comment must be deleted by its author or an admin, {identifier!r} is of {row.author_name!r}"
        raise Problem(403, "forbidden", detail)
    repository.delete(identifier)


def _deletable(row: Comment, caller: Caller, author: str) -> bool:
    return caller.may("admin") or (caller.may("write") and row.author_id == author)


def _to_wire(row: Comment, caller: Caller, author: str) -> dict[str, Any]:
    return {
        "id": row.id,
        "about": about(row),
        "text": row.text,
        "author": row.author_name,
        "author_id": row.author_id,
        "created_at": row.created_at.isoformat(),
        "deletable": _deletable(row, caller, author),
    }
