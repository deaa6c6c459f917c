"""Webhooks and what is sent to them.

An event writes one delivery for every webhook that waits for it, in the transaction of what happened: there is a message
exactly when there is something to tell. Whoever sends moves ``next_at`` on first, provided that it still is what was seen:
of two processes that find a delivery due, one sends it.
"""

from __future__ import annotations

import base64
import secrets
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from types import MappingProxyType
from typing import Any, ClassVar

from sqlalchemy import CursorResult, and_, delete, func, or_, select, update
from sqlalchemy.orm import Session

from storage import quotas
from storage.audit import record
from storage.ids import new_id
from storage.models import DeliveryStatus, Job, Webhook, WebhookDelivery
from storage.models.base import Document, utc_now
from storage.pagination import Page, paginate
from storage.repositories.revised import RevisedRepository

#: The event that a user sends, to an inactive webhook too.
TEST = "webhook.test"


@dataclass(frozen=True, slots=True, kw_only=True)
class Parcel:
    """What is to be sent now, its secret sealed; ``attempt`` counts from 1, ``failures`` those of the webhook in a row before this one."""

    id: str
    webhook_id: str
    workspace_id: str
    url: str
    secret: str
    payload: Document
    attempt: int
    failures: int


def new_secret() -> str:
    """Return a secret as the Standard Webhooks specification has it."""
    return "whsec_" + base64.b64encode(secrets.token_bytes(32)).decode()


def renew_secrets(session: Session, renewed: Callable[[str], str]) -> int:
    """Keep every secret as it is to be kept now; return how many had to change."""
    changed = 0
    for identifier, kept in session.execute(select(Webhook.id, Webhook.secret)).all():
        if (now := renewed(kept)) != kept:
            session.execute(update(Webhook).where(Webhook.id == identifier, Webhook.secret == kept).values(secret=now))
            changed += 1
    return changed


class WebhookRepository(RevisedRepository[Webhook]):
    """The webhooks of one workspace; a change lets one begin anew, its failures are forgotten."""

    _row, _prefix, _name, _told_as = Webhook, "wh", "webhook", "webhook"
    _reset: ClassVar[Mapping[str, Any]] = MappingProxyType({"failures": 0, "retry_at": None, "disabled_reason": None})

    def create(self, *, name: str, url: str, events: Sequence[str], active: bool, secret: str) -> Webhook:
        """Keep a webhook with its sealed secret; raise `QuotaExceededError` when there are too many."""
        quotas.admit_webhook(self._session, self._workspace_id)
        return self._add(name=name, url=url, events=list(events), secret=secret, active=active)

    def test(self, identifier: str) -> WebhookDelivery:
        """Write down a message to one webhook that tells of nothing, whether it is active or not."""
        delivery = _delivery(self.get(identifier), TEST, {})
        self._session.add(delivery)
        self._session.flush()
        record(self._session, self._workspace_id, "webhook.test", identifier)
        return delivery

    def deliveries(
        self, identifier: str, *, status: str | None = None, cursor: str | None = None, limit: int = 100
    ) -> Page[WebhookDelivery]:
        """Return what was sent to a webhook and what waits to be, newest first."""
        self.get(identifier)
        rows = select(WebhookDelivery).where(WebhookDelivery.webhook_id == identifier)
        if status is not None:
            rows = rows.where(WebhookDelivery.status == status)
        return paginate(self._session, rows, WebhookDelivery, cursor=cursor, limit=limit)


def notify(session: Session, workspace_id: str, event: str, data: Mapping[str, Any]) -> int:
    """Write down a message to every active webhook of a workspace that waits for this event; return how many do."""
    # The lock keeps a webhook from being deleted before its delivery, which belongs to it, is committed.
    waiting = session.scalars(
        select(Webhook)
        .where(Webhook.workspace_id == workspace_id, Webhook.active.is_(True))
        .with_for_update(read=True, key_share=True)
    ).all()
    told = [webhook for webhook in waiting if event in webhook.events]
    session.add_all(_delivery(webhook, event, data) for webhook in told)
    session.flush()
    return len(told)


def tell_end(session: Session, job_id: str) -> None:
    """Tell that a job has ended, in the transaction in which it does."""
    job = session.get_one(Job, job_id, populate_existing=True)
    assert job.finished_at is not None
    data = {
        "id": job.id,
        "kind": job.kind,
        "status": str(job.status),
        "schedule": job.schedule_id,
        "finished_at": job.finished_at.isoformat(),
        "result": f"/v1/jobs/{job.id}/result" if job.result_id else None,
        "error": job.error,
    }
    notify(session, job.workspace_id, f"job.{job.status}", data)


def _delivery(webhook: Webhook, event: str, data: Mapping[str, Any]) -> WebhookDelivery:
    now = utc_now()
    payload = {"type": event, "timestamp": now.isoformat(), "workspace": webhook.workspace_id, "data": dict(data)}
    return WebhookDelivery(id=new_id("msg"), webhook_id=webhook.id, event=event, payload=payload, next_at=now)


def claim_due(
    session: Session, *, now: datetime, lease: timedelta, limit: int, busy: Collection[str] = ()
) -> list[Parcel]:
    """Take at most ``limit`` deliveries that are due, of each webhook the oldest, none of the ``busy`` ones.

    Parameters
    ----------
    lease : timedelta
        When a delivery is due again whose outcome nobody writes down.
    busy : collection of str
        Webhooks that are being sent something at this moment.
    """
    if limit <= 0:
        return []
    first = (
        select(
            WebhookDelivery.id,
            func.row_number().over(partition_by=WebhookDelivery.webhook_id, order_by=WebhookDelivery.id).label("place"),
        )
        .join(Webhook, Webhook.id == WebhookDelivery.webhook_id)
        .where(
            WebhookDelivery.next_at <= now,
            WebhookDelivery.webhook_id.not_in(busy),
            or_(
                WebhookDelivery.event == TEST,
                and_(Webhook.active.is_(True), or_(Webhook.retry_at.is_(None), Webhook.retry_at <= now)),
            ),
        )
        .subquery()
    )
    rows = session.execute(
        select(WebhookDelivery, Webhook)
        .join(first, first.c.id == WebhookDelivery.id)
        .join(Webhook, Webhook.id == WebhookDelivery.webhook_id)
        .where(first.c.place == 1)
        .order_by(WebhookDelivery.next_at)
        .limit(limit)
    ).all()
    return [
        Parcel(
            id=row.id,
            webhook_id=webhook.id,
            workspace_id=webhook.workspace_id,
            url=webhook.url,
            secret=webhook.secret,
            payload=row.payload,
            attempt=row.attempts + 1,
            failures=webhook.failures,
        )
        for row, webhook in rows
        if _claim(session, row, until=now + lease)
    ]


def _claim(session: Session, row: WebhookDelivery, *, until: datetime) -> bool:
    taken = session.execute(
        update(WebhookDelivery)
        .where(WebhookDelivery.id == row.id, WebhookDelivery.next_at == row.next_at)
        .values(next_at=until, attempts=row.attempts + 1)
        .returning(WebhookDelivery.id)
        .execution_options(synchronize_session=False)
    )
    return taken.one_or_none() is not None


def delivered(session: Session, parcel: Parcel, *, response_status: int) -> None:
    """Write down that a delivery has arrived."""
    if _settle(session, parcel, status=DeliveryStatus.DELIVERED, response_status=response_status, error=None):
        session.execute(
            update(Webhook)
            .where(Webhook.id == parcel.webhook_id, Webhook.failures > 0)
            .values(failures=0, retry_at=None)
            .execution_options(synchronize_session=False)
        )


def failed(
    session: Session, parcel: Parcel, *, error: str, response_status: int | None, until: datetime, last: bool
) -> None:
    """Write down that an attempt has failed, and send the webhook nothing for a while.

    Parameters
    ----------
    until : datetime
        The end of that while.
    last : bool
        Whether this delivery is given up.
    """
    status = DeliveryStatus.FAILED if last else DeliveryStatus.PENDING
    next_at = None if last else until
    if _settle(session, parcel, status=status, next_at=next_at, response_status=response_status, error=error):
        session.execute(
            update(Webhook)
            .where(Webhook.id == parcel.webhook_id)
            .values(failures=Webhook.failures + 1, retry_at=until)
            .execution_options(synchronize_session=False)
        )


def disable(session: Session, parcel: Parcel, *, reason: str) -> None:
    """Send nothing more to a webhook, what waits among it, until somebody makes it active again."""
    disabled = session.execute(
        update(Webhook)
        .where(Webhook.id == parcel.webhook_id, Webhook.active.is_(True))
        .values(active=False, disabled_reason=reason, revision=Webhook.revision + 1)
        .returning(Webhook.id)
        .execution_options(synchronize_session=False)
    ).one_or_none()
    session.execute(
        update(WebhookDelivery)
        .where(WebhookDelivery.webhook_id == parcel.webhook_id, WebhookDelivery.status == DeliveryStatus.PENDING)
        .values(status=DeliveryStatus.FAILED, next_at=None, finished_at=utc_now(), error="the webhook was disabled")
        .execution_options(synchronize_session=False)
    )
    if disabled is not None:
        record(session, parcel.workspace_id, "webhook.disable", parcel.webhook_id, reason=reason)


def _settle(
    session: Session, parcel: Parcel, *, status: DeliveryStatus, next_at: datetime | None = None, **values: Any
) -> bool:
    """Write an outcome down, unless another process has taken the delivery meanwhile or it is gone."""
    settled = session.execute(
        update(WebhookDelivery)
        .where(
            WebhookDelivery.id == parcel.id,
            WebhookDelivery.attempts == parcel.attempt,
            WebhookDelivery.status == DeliveryStatus.PENDING,
        )
        .values(
            status=status,
            next_at=next_at,
            finished_at=None if status is DeliveryStatus.PENDING else utc_now(),
            **values,
        )
        .returning(WebhookDelivery.id)
        .execution_options(synchronize_session=False)
    )
    return settled.one_or_none() is not None


def forget(session: Session, *, before: datetime) -> int:
    """Delete deliveries that ended before a time; return how many."""
    result = session.execute(
        delete(WebhookDelivery).where(
            WebhookDelivery.created_at < before, WebhookDelivery.status != DeliveryStatus.PENDING
        )
    )
    assert isinstance(result, CursorResult)
    return result.rowcount
