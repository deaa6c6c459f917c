"""What has to be thrown away from time to time."""

from __future__ import annotations

import logging
from datetime import timedelta

from api.services.installation import Installation
from storage import audit
from storage.errors import UNAVAILABLE
from storage.models.base import utc_now
from storage.repositories import SignInRepository, idempotency, schedules

INTERVAL = 3600.0
"""s between two rounds."""

_log = logging.getLogger(__name__)


def tidy(service: Installation) -> None:
    """Forget stored replies, sign-ins and audit entries that are too old; a database that is away is asked next time."""
    now = utc_now()
    try:
        with service.database.session() as session:
            idempotency.forget(session, before=now - timedelta(hours=service.settings.idempotency_hours))
            SignInRepository(session).forget()
            oldest = now - timedelta(days=service.settings.audit_days)
            audit.forget(session, before=oldest)
            schedules.forget(session, before=oldest)
    except UNAVAILABLE as error:
        _log.warning("what is too old could not be forgotten: %s", error)
