"""/v1/comments: what people write about systems, datasets, jobs and kept results."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response
from sqlalchemy.orm import Session

from api.http.auth import Reader, Writer
from api.http.bodies import DocumentRoute
from api.http.calls import (
    CreationDep,
    Cursor,
    IfMatch,
    InstallationDep,
    Limit,
    answer,
    etag,
    expected_revision,
    respond,
)
from api.schemas.comments import CommentReply, CommentRequest
from api.schemas.replies import Page
from api.services.comments import comments
from api.services.comments.comments import REVISION
from storage.repositories import Answer

router = APIRouter(prefix="/v1/comments", tags=["comments"], route_class=DocumentRoute)


@router.post("", status_code=201, response_model=CommentReply, summary="Write a comment")
def create(request: CommentRequest, caller: Writer, creation: CreationDep) -> Response:
    """On a system, a dataset, a job or a kept result; it is deleted with that."""

    def work(session: Session) -> Answer:
        body = comments.create(session, caller, request)
        return answer(body, status=201, headers={"Location": f"/v1/comments/{body['id']}", "ETag": etag(REVISION)})

    return creation.create(work)


@router.get("", response_model=Page[CommentReply], summary="List the comments")
def page(
    caller: Reader,
    service: InstallationDep,
    about: Annotated[str | None, Query(max_length=64, description="id of what they are about")] = None,
    cursor: Cursor = None,
    limit: Limit = 100,
) -> Response:
    """Newest first."""
    with service.database.session() as session:
        return respond(answer(comments.page(session, caller, subject=about, cursor=cursor, limit=limit)))


@router.get("/{identifier}", response_model=CommentReply, summary="Get a comment")
def get(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return it as it was written, and its ETag."""
    with service.database.session() as session:
        body = comments.get(session, caller, identifier)
    return respond(answer(body, headers={"ETag": etag(REVISION)}))


@router.delete("/{identifier}", status_code=204, summary="Delete a comment")
def delete(identifier: str, caller: Writer, service: InstallationDep, if_match: IfMatch = None) -> Response:
    """One's own; an admin's key deletes any."""
    with service.database.session() as session:
        expected = expected_revision(if_match, lambda: REVISION)
        comments.delete(session, caller, identifier, expected_revision=expected)
    return Response(status_code=204)
