"""What has to be thrown away from time to time."""

from __future__ import annotations

import logging
from datetime import datetime, timedelta

from api.services.operation.app_context import Installation
from storage import audit
from storage.blobs import forget_unused
from storage.errors import UNAVAILABLE
from storage.models.base import utc_now
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
    """Forget stored replies, sign-ins, audit entries, alerts and deliveries that are too old, and blobs that nobody needs; a database that is away is asked next time."""
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
        # By itself: with many blobs it takes a while, and writers wait for it.
        with service.database.session() as session:
            forget_unused(session, before=now - _UNUSED)
        _forget_jobs(service, before=now - timedelta(days=service.settings.job_days), ended=now - _ENGINE_ROWS)
    except UNAVAILABLE as error:
        _log.warning("what is too old could not be forgotten: %s", error)


def _forget_jobs(service: Installation, *, before: datetime, ended: datetime) -> None:
    """Forget old jobs, and what the job engine remembers of jobs that have ended; a bounded number at a time."""
    for _ in range(_ROUNDS):
        with service.database.session() as session:
            if not jobs.forget(session, before=before):
                break
    for _ in range(_ROUNDS):
        if not service.queue.forget(before=ended):
            break
