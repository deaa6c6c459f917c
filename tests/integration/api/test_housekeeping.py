"""Stored replies are repeated for as long as the settings say, and then forgotten."""

from __future__ import annotations

from datetime import timedelta

from sqlalchemy import update

from api.services.computing import Computing
from api.services.housekeeping import tidy
from api.services.installation import Installation
from api.settings import Settings
from storage.jobs.queue import JobQueue
from storage.models import Idempotency
from storage.models.base import utc_now
from storage.repositories import Answer, Claim, IdempotencyRepository


def test_old_replies_are_forgotten_and_young_ones_are_not(database) -> None:
    settings = Settings(idempotency_hours=2)
    queue = JobQueue(database)
    service = Installation(settings=settings, database=database, queue=queue, computing=Computing(settings))
    reply = Answer(status_code=201, headers={}, body=b"{}")
    for key in ("old", "young"):
        with database.session() as session:
            keys = IdempotencyRepository(session, "key_1")
            claim = keys.claim(key, endpoint="POST /v1/systems", body_sha256="0" * 64)
            assert isinstance(claim, Claim)
            keys.finish(claim, reply)
    with database.session() as session:
        past = utc_now() - timedelta(hours=2, minutes=1)
        session.execute(update(Idempotency).where(Idempotency.key == "old").values(created_at=past))
    tidy(service)
    with database.session() as session:
        keys = IdempotencyRepository(session, "key_1")
        again = [keys.claim(key, endpoint="POST /v1/systems", body_sha256="0" * 64) for key in ("old", "young")]
    queue.close()
    assert isinstance(again[0], Claim)
    assert again[1] == reply
