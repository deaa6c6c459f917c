"""/v1/systems: documents with revisions."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Response
from sqlalchemy.orm import Session

from api.http.auth import Reader, Writer
from api.http.bodies import DocumentRoute
from api.http.calls import (
    CreationDep,
    Cursor,
    Force,
    IfMatch,
    InstallationDep,
    Limit,
    OfAName,
    answer,
    etag,
    expected_revision,
    respond,
)
from api.schemas.replies import Page, RevisionHead, StateSpaceReply, StoredSystem, SystemHead
from api.schemas.systems import SystemDocument
from api.services.systems import exports, systems
from storage.repositories import Answer

MATLAB = "application/x-matlab-data"

FileFormat = Annotated[Literal["json", "mat"], Query(alias="format", description="a JSON document or a MATLAB file")]
OpenAt = Annotated[
    list[str] | None,
    Query(
        max_length=20,
        description="cut the loop here: `loop` is then the last input and output; given again, open it there too",
    ),
]

DerivedFrom = Annotated[
    str | None,
    Query(max_length=64, description="the finished job or kept study that its numbers come from, for the lineage"),
]

router = APIRouter(prefix="/v1/systems", tags=["systems"], route_class=DocumentRoute)


@router.post("", status_code=201, response_model=StoredSystem, summary="Keep a system document")
def create(
    document: SystemDocument, caller: Writer, creation: CreationDep, derived_from: DerivedFrom = None
) -> Response:
    """Check the document and keep it as revision 1."""

    def work(session: Session) -> Answer:
        body = systems.create(session, caller, document, derived_from=derived_from)
        headers = {"Location": f"/v1/systems/{body['id']}", "ETag": etag(body["revision"])}
        return answer(body, status=201, headers=headers)

    return creation.create(work)


@router.get("", response_model=Page[SystemHead], summary="List the systems")
def page(
    caller: Reader, service: InstallationDep, narrowing: OfAName, cursor: Cursor = None, limit: Limit = 100
) -> Response:
    """Newest first, without the documents."""
    with service.database.session() as session:
        return respond(answer(systems.page(session, caller, narrowing=narrowing, cursor=cursor, limit=limit)))


@router.get("/{identifier}", response_model=StoredSystem, summary="Get a system")
def get(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return the document at its current revision, with its ETag."""
    with service.database.session() as session:
        body = systems.get(session, caller, identifier)
    return respond(answer(body, headers={"ETag": etag(body["revision"])}))


@router.put("/{identifier}", response_model=StoredSystem, summary="Change a system")
def update(
    identifier: str,
    document: SystemDocument,
    caller: Writer,
    service: InstallationDep,
    if_match: IfMatch = None,
    derived_from: DerivedFrom = None,
) -> Response:
    """Append a revision; `If-Match` names the one that the change is meant for."""
    with service.database.session() as session:
        expected = expected_revision(if_match, lambda: systems.current_revision(session, caller, identifier))
        body = systems.update(
            session, caller, identifier, document, expected_revision=expected, derived_from=derived_from
        )
    return respond(answer(body, headers={"ETag": etag(body["revision"])}))


@router.delete("/{identifier}", status_code=204, summary="Delete a system")
def delete(
    identifier: str, caller: Writer, service: InstallationDep, *, if_match: IfMatch = None, force: Force = False
) -> Response:
    """Hide the system; results keep the revisions that they used, and 409 lists the schedules that need it."""
    with service.database.session() as session:
        expected = expected_revision(if_match, lambda: systems.current_revision(session, caller, identifier))
        systems.delete(session, caller, identifier, expected_revision=expected, force=force)
    return Response(status_code=204)


@router.get("/{identifier}/revisions", response_model=Page[RevisionHead], summary="List the revisions of a system")
def revisions(
    identifier: str, caller: Reader, service: InstallationDep, cursor: Cursor = None, limit: Limit = 100
) -> Response:
    """Newest first, without the documents."""
    with service.database.session() as session:
        return respond(answer(systems.revisions(session, caller, identifier, cursor=cursor, limit=limit)))


@router.get("/{identifier}/revisions/{number}", response_model=StoredSystem, summary="Get a revision of a system")
def revision(identifier: str, number: int, caller: Reader, service: InstallationDep) -> Response:
    """Return the document as it was."""
    with service.database.session() as session:
        body = systems.get(session, caller, identifier, revision=number)
    return respond(answer(body, headers={"ETag": etag(body["revision"])}))


@router.get(
    "/{identifier}/state-space",
    response_model=StateSpaceReply,
    responses={200: {"content": {MATLAB: {"schema": {"type": "string", "format": "binary"}}}}},
    summary="Export the realised state space of a system",
)
def state_space(
    identifier: str,
    caller: Reader,
    service: InstallationDep,
    file_format: FileFormat = "json",
    open_at: OpenAt = None,
) -> Response:
    """Return A, B, C, D in SI with the names of states, inputs and outputs; with delays, the form of MATLAB's `setDelayModel`."""
    place = open_at[0] if open_at is not None and len(open_at) == 1 else open_at
    with service.database.session() as session:
        found = exports.stored_state_space(session, caller, identifier, open_at=place)
    if file_format == "json":
        return respond(answer(found.document()))
    headers = {"Content-Disposition": f'attachment; filename="{identifier}.mat"'}
    return Response(found.file(), media_type=MATLAB, headers=headers)
