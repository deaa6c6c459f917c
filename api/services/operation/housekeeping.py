"""What has to be thrown away from time to time."""

from __future__ import annotations

import logging
from collections.abc import Callable
from datetime import datetime, timedelta

from api.services.operation.app_context import Installation
from storage import audit
from storage.blobs import forget_unused
from storage.errors import UNAVAILABLE
from storage.models.base import utc_now
from storage.moving import forget_objects
from storage.repositories import SignInRepository, alerts, idempotency, jobs, schedules, webhooks

INTERVAL = 3600.0
"""s between two rounds."""

#: How far the log of a webhook reaches back.
_DELIVERIES = timedelta(days=30)
#: How long a blob that nothing refers to is left alone: somebody may be about to.
_UNUSED = timedelta(days=1)

#: How long the job engine's own rows of ended jobs are kept: nothing reads them.
_ENGINE_ROWS = timedelta(days=1)
#: The most transactions of a kind in one go.
_ROUNDS = 50

_log = logging.getLogger(__name__)


def tidy(service: Installation) -> None:
    """Forget stored replies, sign-ins, audit entries, alerts, deliveries, jobs and their events that are too old, and blobs that nobody needs; a database or an object store that is away is asked next time."""
    now = utc_now()
    try:
        with service.database.session() as session:
            idempotency.forget(session, before=now - timedelta(hours=service.settings.idempotency_hours))
            SignInRepository(session).forget()
            oldest = now - timedelta(days=service.settings.audit_days)
            audit.forget(session, before=oldest)
            schedules.forget(session, before=oldest)
            alerts.forget(session, before=oldest)
            webhooks.forget(session, before=now - _DELIVERIES)
        _forget_blobs(service, before=now - _UNUSED)
        _forget_jobs(service, before=now - timedelta(days=service.settings.job_days), ended=now - _ENGINE_ROWS)
        _again(lambda: _forget_events(service, before=now - timedelta(days=service.settings.event_days)))
        forget_objects(service.database, before=now - _UNUSED)  # last: the store may be away when the database is there
    except UNAVAILABLE as error:
        _log.warning("what is too old could not be forgotten: %s", error)


def _forget_jobs(service: Installation, *, before: datetime, ended: datetime) -> None:
    """Forget old jobs, and what the job engine remembers of jobs that have ended; a bounded number at a time."""

    def forget() -> int:
        with service.database.session() as session:
            return jobs.forget(session, before=before)

    _again(forget)
    _again(lambda: service.queue.forget(before=ended))


def _forget_events(service: Installation, *, before: datetime) -> int:
    with service.database.session() as session:
        return jobs.forget_events(session, before=before)


def _forget_blobs(service: Installation, *, before: datetime) -> None:
    """Look at every blob, some at a time: writers wait for no more than that."""
    last: str | None = ""
    while last is not None:
        with service.database.session() as session:
            _, last = forget_unused(session, before=before, after=last)


def _again(forget: Callable[[], int]) -> None:
    """Forget until nothing is left, for a bounded number of transactions: the next hour goes on."""
    for _ in range(_ROUNDS):
        if not forget():
            break
