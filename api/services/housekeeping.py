"""What has to be thrown away from time to time."""

from __future__ import annotations

import logging
from datetime import timedelta

from api.services.installation import Installation
from storage.errors import UNAVAILABLE
from storage.models.base import utc_now
from storage.repositories.idempotency import forget

INTERVAL = 3600.0
"""s between two rounds."""

_log = logging.getLogger(__name__)


def tidy(service: Installation) -> None:
    """Forget stored replies that are too old to be repeated; a database that does not answer is asked next time."""
    before = utc_now() - timedelta(hours=service.settings.idempotency_hours)
    try:
        with service.database.session() as session:
            forget(session, before=before)
    except UNAVAILABLE as error:
        _log.warning("old stored replies could not be forgotten: %s", error)
