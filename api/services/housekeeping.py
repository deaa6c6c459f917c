"""What has to be thrown away from time to time."""

from __future__ import annotations

import logging
from datetime import timedelta

from api.services.installation import Installation
from storage import audit
from storage.blobs import forget_unused
from storage.errors import UNAVAILABLE
from storage.models.base import utc_now
from storage.repositories import SignInRepository, alerts, idempotency, schedules, webhooks

INTERVAL = 3600.0
"""s between two rounds."""

#: How far the log of a webhook reaches back.
_DELIVERIES = timedelta(days=30)
#: How long a blob that nothing refers to is left alone: somebody may be about to.
_UNUSED = timedelta(days=1)

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
    except UNAVAILABLE as error:
        _log.warning("what is too old could not be forgotten: %s", error)
