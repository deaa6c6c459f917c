"""/v1/acquisition-templates: measurements to be asked for again."""

from __future__ import annotations

from fastapi import APIRouter, Response
from sqlalchemy.orm import Session

from api.http.auth import Reader, Runner
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
from api.schemas.acquisitions import AcquisitionRequest, TemplateReply
from api.schemas.replies import Page
from api.services.rigs import acquisition_templates as templates
from storage.repositories import Answer

router = APIRouter(prefix="/v1/acquisition-templates", tags=["acquisitions"], route_class=DocumentRoute)


@router.post("", status_code=201, response_model=TemplateReply, summary="Keep a template")
def create(request: AcquisitionRequest, caller: Runner, service: InstallationDep, creation: CreationDep) -> Response:
    """Leave out what differs each time; one that names everything is proven to make sense on its rig."""
    document = templates.check(service, caller, request)

    def work(session: Session) -> Answer:
        body = templates.create(session, caller, document)
        headers = {"Location": f"/v1/acquisition-templates/{body['id']}", "ETag": etag(body["revision"])}
        return answer(body, status=201, headers=headers)

    return creation.create(work)


@router.get("", response_model=Page[TemplateReply], summary="List the templates")
def page(caller: Reader, service: InstallationDep, cursor: Cursor = None, limit: Limit = 100) -> Response:
    """Newest first."""
    with service.database.session() as session:
        return respond(answer(templates.page(session, caller, cursor=cursor, limit=limit)))


@router.get("/{identifier}", response_model=TemplateReply, summary="Get a template")
def get(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return it with its ETag."""
    with service.database.session() as session:
        body = templates.get(session, caller, identifier)
    return respond(answer(body, headers={"ETag": etag(body["revision"])}))


@router.put("/{identifier}", response_model=TemplateReply, summary="Change a template")
def update(
    identifier: str, request: AcquisitionRequest, caller: Runner, service: InstallationDep, if_match: IfMatch = None
) -> Response:
    """Replace it; what was asked for with it stays as it was."""
    with service.database.session() as session:
        expected = expected_revision(if_match, lambda: templates.get(session, caller, identifier)["revision"])
        templates.get(session, caller, identifier)
    document = templates.check(service, caller, request)
    with service.database.session() as session:
        body = templates.update(session, caller, identifier, document, expected_revision=expected)
    return respond(answer(body, headers={"ETag": etag(body["revision"])}))


@router.delete("/{identifier}", status_code=204, summary="Delete a template")
def delete(identifier: str, caller: Runner, service: InstallationDep, if_match: IfMatch = None) -> Response:
    """Forget it; what was asked for with it stays."""
    with service.database.session() as session:
        expected = expected_revision(if_match, lambda: templates.get(session, caller, identifier)["revision"])
        templates.delete(session, caller, identifier, expected_revision=expected)
    return Response(status_code=204)
