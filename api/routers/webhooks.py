"""/v1/webhooks: who is told when something ends; /v1/alerts: what somebody should look at."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Response
from sqlalchemy.orm import Session

from api.http.auth import Admin, Reader
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
    shown_once,
)
from api.schemas.replies import Page
from api.schemas.webhooks import AlertReply, DeliveryReply, MadeWebhook, WebhookReply, WebhookRequest
from api.services.webhooks import alerts, webhooks
from storage.repositories import Answer

router = APIRouter(prefix="/v1", tags=["webhooks"], route_class=DocumentRoute)


@router.post("/webhooks", status_code=201, response_model=MadeWebhook, summary="Make a webhook")
def create(request: WebhookRequest, caller: Admin, service: InstallationDep, creation: CreationDep) -> Response:
    """Tell an address of jobs that end and of alerts; the reply shows the secret that signs what is sent."""
    values = webhooks.check(service, request)

    def work(session: Session) -> Answer:
        body, secret = webhooks.create(service, session, caller, values)
        headers = {"Location": f"/v1/webhooks/{body['id']}", "ETag": etag(body["revision"])}
        return shown_once(body, secret={"secret": secret}, status=201, headers=headers)

    return creation.create(work)


@router.get("/webhooks", response_model=Page[WebhookReply], summary="List the webhooks")
def page(caller: Admin, service: InstallationDep, cursor: Cursor = None, limit: Limit = 100) -> Response:
    """Newest first, without their secrets."""
    with service.database.session() as session:
        return respond(answer(webhooks.page(session, caller, cursor=cursor, limit=limit)))


@router.get("/webhooks/{identifier}", response_model=WebhookReply, summary="Get a webhook")
def get(identifier: str, caller: Admin, service: InstallationDep) -> Response:
    """Return it without its secret, and its ETag."""
    with service.database.session() as session:
        body = webhooks.get(session, caller, identifier)
    return respond(answer(body, headers={"ETag": etag(body["revision"])}))


@router.put("/webhooks/{identifier}", response_model=WebhookReply, summary="Change a webhook")
def update(
    identifier: str, request: WebhookRequest, caller: Admin, service: InstallationDep, if_match: IfMatch = None
) -> Response:
    """Keep the secret; forget the failures, so that one that was disabled begins again."""
    with service.database.session() as session:
        expected = expected_revision(if_match, lambda: webhooks.get(session, caller, identifier)["revision"])
        webhooks.get(session, caller, identifier)
    values = webhooks.check(service, request)
    with service.database.session() as session:
        body = webhooks.update(session, caller, identifier, values, expected_revision=expected)
    return respond(answer(body, headers={"ETag": etag(body["revision"])}))


@router.delete("/webhooks/{identifier}", status_code=204, summary="Delete a webhook")
def delete(identifier: str, caller: Admin, service: InstallationDep, if_match: IfMatch = None) -> Response:
    """Forget it and what was sent to it; what waits is not sent any more."""
    with service.database.session() as session:
        expected = expected_revision(if_match, lambda: webhooks.get(session, caller, identifier)["revision"])
        webhooks.delete(session, caller, identifier, expected_revision=expected)
    return Response(status_code=204)


@router.post("/webhooks/{identifier}/test", status_code=202, response_model=DeliveryReply, summary="Try a webhook")
def test(identifier: str, caller: Admin, creation: CreationDep) -> Response:
    """Send a message that tells of nothing, to an inactive webhook too."""

    def work(session: Session) -> Answer:
        return answer(webhooks.test(session, caller, identifier), status=202)

    return creation.create(work)


@router.get("/webhooks/{identifier}/deliveries", response_model=Page[DeliveryReply], summary="List what was sent")
def deliveries(
    identifier: str,
    caller: Admin,
    service: InstallationDep,
    status: Literal["pending", "delivered", "failed"] | None = None,
    cursor: Cursor = None,
    limit: Limit = 100,
) -> Response:
    """Newest first: what arrived, what is tried again and when, what was given up and why."""
    with service.database.session() as session:
        body = webhooks.deliveries(session, caller, identifier, status=status, cursor=cursor, limit=limit)
    return respond(answer(body))


@router.get("/alerts", response_model=Page[AlertReply], summary="List the alerts")
def alert_page(
    caller: Reader,
    service: InstallationDep,
    kind: Literal["validation", "schedule"] | None = None,
    source: Annotated[str | None, Query(max_length=64, description="id of what raised them")] = None,
    cursor: Cursor = None,
    limit: Limit = 100,
) -> Response:
    """Newest first."""
    with service.database.session() as session:
        body = alerts.page(session, caller, kind=kind, source=source, cursor=cursor, limit=limit)
    return respond(answer(body))


@router.get("/alerts/{identifier}", response_model=AlertReply, summary="Get an alert")
def alert(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return what should be looked at."""
    with service.database.session() as session:
        return respond(answer(alerts.get(session, caller, identifier)))
