"""Webhooks as their users see them: made, changed, tried, deleted, and what was sent to them."""

from __future__ import annotations

from typing import Any

from sqlalchemy.orm import Session

from api.problems.documents import invalid
from api.schemas.webhooks import WebhookRequest
from api.services.operation.app_context import Caller, Installation
from api.services.webhooks.ssrf_guard import ForbiddenUrlError, checked_url, judged
from storage.models import Webhook, WebhookDelivery
from storage.repositories import WebhookRepository
from storage.repositories.webhooks import new_secret


def check(service: Installation, request: WebhookRequest) -> dict[str, Any]:
    """Make sure that an address may be called; return what is kept of a webhook.

    A name that has no address now is let through: every attempt asks again, and its delivery says what was wrong.

    Raises
    ------
    Problem
        422 with the place of what is wrong.
    """
    try:
        judged(checked_url(request.url), allowed=service.settings.webhook_networks)
    except ForbiddenUrlError as error:
        raise invalid(f"url {error}", "url") from error
    events = list(dict.fromkeys(request.events))
    return {"name": request.name, "url": request.url, "events": events, "active": request.active}


def create(
    service: Installation, session: Session, caller: Caller, values: dict[str, Any]
) -> tuple[dict[str, Any], str]:
    """Keep a checked webhook; return it, and its secret apart."""
    secret = new_secret()
    row = WebhookRepository(session, caller.workspace).create(**values, secret=service.vault.seal(secret))
    return to_wire(row), secret


def get(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return a webhook without its secret."""
    return to_wire(WebhookRepository(session, caller.workspace).get(identifier))


def page(session: Session, caller: Caller, *, cursor: str | None, limit: int) -> dict[str, Any]:
    """Return one page of the webhooks, newest first."""
    found = WebhookRepository(session, caller.workspace).page(cursor=cursor, limit=limit)
    return {"items": [to_wire(row) for row in found.items], "next_cursor": found.next_cursor}


def update(
    session: Session, caller: Caller, identifier: str, values: dict[str, Any], *, expected_revision: int
) -> dict[str, Any]:
    """Replace a webhook by a checked one; its secret stays, its failures are forgotten."""
    repository = WebhookRepository(session, caller.workspace)
    return to_wire(repository.update(identifier, expected_revision=expected_revision, **values))


def delete(session: Session, caller: Caller, identifier: str, *, expected_revision: int) -> None:
    """Forget a webhook and what was sent to it."""
    WebhookRepository(session, caller.workspace).delete(identifier, expected_revision=expected_revision)


def test(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Send a message that tells of nothing."""
    return delivery_to_wire(WebhookRepository(session, caller.workspace).test(identifier))


def deliveries(
    session: Session, caller: Caller, identifier: str, *, status: str | None, cursor: str | None, limit: int
) -> dict[str, Any]:
    """Return one page of what was sent, newest first."""
    repository = WebhookRepository(session, caller.workspace)
    found = repository.deliveries(identifier, status=status, cursor=cursor, limit=limit)
    return {"items": [delivery_to_wire(row) for row in found.items], "next_cursor": found.next_cursor}


def to_wire(row: Webhook) -> dict[str, Any]:
    """Return what is known of a webhook; its secret is not."""
    document = {"name": row.name, "url": row.url, "events": row.events, "active": row.active}
    return {
        **document,
        "id": row.id,
        "revision": row.revision,
        "created_at": row.created_at.isoformat(),
        "disabled_reason": row.disabled_reason,
        "failures": row.failures,
        "retry_at": row.retry_at.isoformat() if row.retry_at else None,
        "document": document,
    }


def delivery_to_wire(row: WebhookDelivery) -> dict[str, Any]:
    """Return a message and what became of it."""
    return {
        "id": row.id,
        "event": row.event,
        "status": str(row.status),
        "attempts": row.attempts,
        "next_at": row.next_at.isoformat() if row.next_at else None,
        "response_status": row.response_status,
        "error": row.error,
        "created_at": row.created_at.isoformat(),
        "finished_at": row.finished_at.isoformat() if row.finished_at else None,
        "payload": row.payload,
    }
