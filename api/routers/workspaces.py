"""/v1/workspaces: rooms that know nothing of each other."""

from __future__ import annotations

from fastapi import APIRouter, Response
from sqlalchemy.orm import Session

from api.http.auth import Operator, Reader
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
from api.schemas.access import WorkspaceHead, WorkspaceReply, WorkspaceRequest
from api.schemas.replies import Page
from api.services.access import workspaces
from storage.repositories import Answer

router = APIRouter(prefix="/v1/workspaces", tags=["access"], route_class=DocumentRoute)


@router.post("", status_code=201, response_model=WorkspaceReply, summary="Make a workspace")
def create(request: WorkspaceRequest, caller: Operator, creation: CreationDep) -> Response:
    """Its first key is made by `POST /v1/keys` with its id as `workspace`."""

    def work(session: Session) -> Answer:
        body = workspaces.create(session, caller, request)
        headers = {"Location": f"/v1/workspaces/{body['id']}", "ETag": etag(body["revision"])}
        return answer(body, status=201, headers=headers)

    return creation.create(work)


@router.get("", response_model=Page[WorkspaceHead], summary="List the workspaces")
def page(caller: Reader, service: InstallationDep, cursor: Cursor = None, limit: Limit = 100) -> Response:
    """The caller's own; all of them for whoever runs the installation."""
    with service.database.session() as session:
        return respond(answer(workspaces.page(session, caller, cursor=cursor, limit=limit)))


@router.get("/{identifier}", response_model=WorkspaceReply, summary="Get a workspace")
def get(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return its limits and what is used of them."""
    with service.database.session() as session:
        body = workspaces.get(session, caller, identifier)
    return respond(answer(body, headers={"ETag": etag(body["revision"])}))


@router.put("/{identifier}", response_model=WorkspaceReply, summary="Change a workspace")
def update(
    identifier: str, request: WorkspaceRequest, caller: Operator, service: InstallationDep, if_match: IfMatch = None
) -> Response:
    """Give it another name or other limits."""
    with service.database.session() as session:
        expected = expected_revision(if_match, lambda: workspaces.get(session, caller, identifier)["revision"])
        body = workspaces.update(session, caller, identifier, request, expected_revision=expected)
    return respond(answer(body, headers={"ETag": etag(body["revision"])}))
