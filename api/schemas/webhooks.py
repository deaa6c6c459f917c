"""Webhooks and alerts: what is asked and what is replied."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal

from pydantic import Field

from api.schemas.replies import Reply
from api.schemas.values import Document

Event = Literal["job.succeeded", "job.failed", "job.cancelled", "alert.validation", "alert.schedule"]


class WebhookRequest(Document):
    """An address that is told of events."""

    name: str = Field(min_length=1, max_length=200)
    url: str = Field(
        min_length=1,
        max_length=2000,
        description="https:// or http://, with a public address",
        examples=["https://ci.example.com/servotune"],
    )
    events: list[Event] = Field(min_length=1, max_length=20, description="what it is told")
    active: bool = True


class WebhookReply(Reply):
    """A webhook; `active` is false, too, when the service has given it up, and `disabled_reason` then says why."""

    id: str
    name: str
    revision: int
    created_at: datetime
    url: str
    events: list[Event]
    active: bool
    disabled_reason: str | None
    failures: int = Field(description="attempts that failed in a row; 0 after one that arrived")
    retry_at: datetime | None = Field(description="before which nothing is sent, after a failure")
    document: dict[str, Any]


class MadeWebhook(WebhookReply):
    """A new webhook."""

    secret: str | None = Field(
        description="signs what is sent, shown only now: null when an `Idempotency-Key` repeats the reply"
    )


class DeliveryReply(Reply):
    """A message to a webhook and what became of it."""

    id: str = Field(description="the header `webhook-id`, the same at every attempt")
    event: str
    status: Literal["pending", "delivered", "failed"]
    attempts: int
    next_at: datetime | None = Field(description="of the next attempt; null when there is none")
    response_status: int | None = Field(description="the status that the receiver answered last")
    error: str | None = Field(description="why the last attempt failed")
    created_at: datetime
    finished_at: datetime | None
    payload: dict[str, Any]


class AlertReply(Reply):
    """Something that somebody should look at."""

    id: str
    kind: Literal["validation", "schedule"]
    source: str = Field(description="id of the job or the run of a schedule that raised it")
    detail: str
    data: dict[str, Any]
    created_at: datetime
