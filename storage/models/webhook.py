"""Who is told when something ends: addresses outside, what was sent to them, and the alerts that tell of trouble."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Any

from sqlalchemy import CheckConstraint, ForeignKey, Index
from sqlalchemy.orm import Mapped, mapped_column

from storage.models.base import Base, Id, Word, utc_now


class DeliveryStatus(StrEnum):
    """What became of one message to one address; the last two are final."""

    PENDING = "pending"
    DELIVERED = "delivered"
    FAILED = "failed"


class Webhook(Base):
    """An address that is told of events.

    ``secret`` signs what is sent; it is kept as a `storage.vault.Vault` has sealed it. ``failures`` counts the attempts that failed in a row;
    before ``retry_at`` nothing is sent; ``disabled_reason`` says why the service itself made it inactive.
    """

    __tablename__ = "webhook"
    __table_args__ = (Index(None, "workspace_id", "created_at", "id"),)

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"))
    name: Mapped[str]
    url: Mapped[str]
    events: Mapped[list[Any]]
    secret: Mapped[str]
    active: Mapped[bool]
    failures: Mapped[int] = mapped_column(default=0)
    retry_at: Mapped[datetime | None]
    disabled_reason: Mapped[str | None]
    revision: Mapped[int] = mapped_column(default=1)
    created_at: Mapped[datetime] = mapped_column(default=utc_now)


class WebhookDelivery(Base):
    """One message to one address; ``next_at`` is when it is tried next, None when it is not any more."""

    __tablename__ = "webhook_delivery"
    __table_args__ = (
        Index(None, "webhook_id", "created_at", "id"),
        Index(None, "next_at"),
        Index(None, "created_at"),
        CheckConstraint("status IN ('pending', 'delivered', 'failed')", name="status"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    webhook_id: Mapped[str] = mapped_column(ForeignKey("webhook.id", ondelete="CASCADE"))
    event: Mapped[str] = mapped_column(Word)
    payload: Mapped[dict[str, Any]]
    status: Mapped[str] = mapped_column(Word, default=DeliveryStatus.PENDING)
    attempts: Mapped[int] = mapped_column(default=0)
    next_at: Mapped[datetime | None]
    response_status: Mapped[int | None]
    error: Mapped[str | None]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)
    finished_at: Mapped[datetime | None]


class Alert(Base):
    """Something that somebody should look at: a validation that failed, a schedule that could not run.

    ``source`` is the id of what raised it; it raises one alert of a kind.
    """

    __tablename__ = "alert"
    __table_args__ = (
        Index(None, "workspace_id", "created_at", "id"),
        Index(None, "kind", "source", unique=True),
        Index(None, "created_at"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    workspace_id: Mapped[str] = mapped_column(ForeignKey("workspace.id"))
    kind: Mapped[str] = mapped_column(Word)
    source: Mapped[str] = mapped_column(Id)
    detail: Mapped[str]
    data: Mapped[dict[str, Any]]
    created_at: Mapped[datetime] = mapped_column(default=utc_now)
