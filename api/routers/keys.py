"""/v1/keys: who may come in, and what for."""

from __future__ import annotations

from fastapi import APIRouter, Response
from sqlalchemy.orm import Session

from api.http.auth import Admin
from api.http.bodies import DocumentRoute
from api.http.calls import CreationDep, Cursor, InstallationDep, Limit, answer, respond, shown_once
from api.schemas.access import KeyReply, KeyRequest, NewKeyReply, RotationRequest
from api.schemas.replies import Page
from api.services.access import keys
from storage.repositories import Answer

router = APIRouter(prefix="/v1/keys", tags=["access"], route_class=DocumentRoute)


@router.post("", status_code=201, response_model=NewKeyReply, summary="Make a key")
def create(request: KeyRequest, caller: Admin, creation: CreationDep) -> Response:
    """Show the key once: the service keeps only its hash."""

    def work(session: Session) -> Answer:
        body, token = keys.create(session, caller, request)
        return shown_once(body, secret={"key": token}, status=201, headers={"Location": f"/v1/keys/{body['id']}"})

    return creation.create(work)


@router.get("", response_model=Page[KeyReply], summary="List the keys")
def page(caller: Admin, service: InstallationDep, cursor: Cursor = None, limit: Limit = 100) -> Response:
    """Newest first, those that do not open any more among them."""
    service.callers.uses.write()
    with service.database.session() as session:
        return respond(answer(keys.page(session, caller, cursor=cursor, limit=limit)))


@router.get("/{identifier}", response_model=KeyReply, summary="Get a key")
def get(identifier: str, caller: Admin, service: InstallationDep) -> Response:
    """Return what it may do, when it was last used and when it ends."""
    service.callers.uses.write()
    with service.database.session() as session:
        return respond(answer(keys.get(session, caller, identifier)))


@router.post("/{identifier}/rotate", status_code=201, response_model=NewKeyReply, summary="Replace a key")
def rotate(
    identifier: str, request: RotationRequest, caller: Admin, creation: CreationDep, service: InstallationDep
) -> Response:
    """Make a key that may the same; the old one ends after the overlap."""

    def work(session: Session) -> Answer:
        body, token = keys.rotate(session, caller, identifier, request)
        return shown_once(body, secret={"key": token}, status=201, headers={"Location": f"/v1/keys/{body['id']}"})

    response = creation.create(work)
    service.callers.forget()
    return response


@router.delete("/{identifier}", status_code=204, summary="Revoke a key")
def revoke(identifier: str, caller: Admin, service: InstallationDep) -> Response:
    """Let it open nothing any more: at once, and within a second where other processes serve; browsers that signed in with it are out, too."""
    with service.database.session() as session:
        keys.revoke(session, caller, identifier)
    service.callers.forget()
    return Response(status_code=204)
