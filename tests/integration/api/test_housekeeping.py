"""What is too old is forgotten: stored replies, and blobs that nothing refers to any more."""

from __future__ import annotations

from datetime import timedelta

import numpy as np
from sqlalchemy import distinct, func, select, update

from api.services.jobs.computing import Computing
from api.services.operation.app_context import Installation
from api.services.operation.housekeeping import tidy
from api.settings import Settings
from storage.blobs import put_bytes, sha256_of
from storage.jobs.queue import JobQueue
from storage.models import DEFAULT_WORKSPACE, Blob, BlobChunk, Idempotency
from storage.models.base import utc_now
from storage.repositories import Answer, Claim, IdempotencyRepository, ResultRepository


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


def test_blobs_of_what_was_deleted_go_and_shared_ones_stay(database) -> None:
    settings = Settings()
    queue = JobQueue(database)
    service = Installation(settings=settings, database=database, queue=queue, computing=Computing(settings))
    own, shared = np.arange(100.0), np.arange(200.0)
    with database.session() as session:
        results = ResultRepository(session, DEFAULT_WORKSPACE)
        gone = results.create(kind="simulation", body={"own": own, "shared": shared})
        kept = results.create(kind="simulation", body={"shared": shared})
        put_bytes(session, b"nobody has referred to this yet")
    assert blobs(database) == 3
    with database.session() as session:
        ResultRepository(session, DEFAULT_WORKSPACE).delete(gone.id)
        past = utc_now() - timedelta(days=1, minutes=1)
        new = sha256_of(b"nobody has referred to this yet")
        session.execute(update(Blob).where(Blob.sha256 != new).values(created_at=past))
    tidy(service)
    queue.close()
    assert blobs(database) == 2
    with database.session() as session:
        results = ResultRepository(session, DEFAULT_WORKSPACE)
        np.testing.assert_array_equal(results.body(results.get(kept.id))["shared"], shared)
        assert session.scalar(select(func.count(distinct(BlobChunk.sha256)))) == 2


def blobs(database) -> int:
    with database.session() as session:
        return session.scalar(select(func.count()).select_from(Blob))
