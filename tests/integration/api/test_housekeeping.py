"""What is too old is forgotten: stored replies, and blobs that nothing refers to any more."""

from __future__ import annotations

from datetime import timedelta

import numpy as np
from sqlalchemy import distinct, func, select, update

from api.services.jobs.computing import Computing
from api.services.operation.app_context import Installation
from api.services.operation.housekeeping import tidy
from api.settings import Settings
from storage.blobs import forget_unused, put_bytes, sha256_of
from storage.jobs.queue import JobQueue
from storage.models import DEFAULT_WORKSPACE, Blob, BlobChunk, Idempotency, JobEvent, JobStatus
from storage.models.base import utc_now
from storage.repositories import Answer, Claim, IdempotencyRepository, JobRepository, ResultRepository
from storage.repositories import jobs as changes


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


def test_old_reports_of_progress_go_and_what_changed_a_job_stays(database) -> None:
    settings = Settings(event_days=30)
    queue = JobQueue(database)
    service = Installation(settings=settings, database=database, queue=queue, computing=Computing(settings))
    with database.session() as session:
        jobs = {
            name: JobRepository(session, DEFAULT_WORKSPACE).create(kind="x", body={}).id for name in ("old", "young")
        }
        for identifier in jobs.values():
            changes.begin(session, identifier, worker="lab-0")
            changes.report(session, identifier, attempt=1, progress=0.5, message=None)
            changes.report(session, identifier, attempt=1, progress=None, message="half")
            changes.finish(session, identifier, status=JobStatus.SUCCEEDED, attempt=1)
        past = utc_now() - timedelta(days=30, minutes=1)
        session.execute(update(JobEvent).where(JobEvent.job_id == jobs["old"]).values(at=past))
    tidy(service)
    queue.close()
    with database.session() as session:
        events = {name: JobRepository(session, DEFAULT_WORKSPACE).events(jobs[name]) for name in jobs}
    assert [event.id for event in events["young"]] == [1, 2, 3, 4, 5]
    assert [event.id for event in events["old"]] == [1, 2, 5]
    assert {event.type for event in events["old"]} == {"status"}


def test_one_pass_forgets_no_more_events_than_it_may_the_oldest_first(database) -> None:
    with database.session() as session:
        identifier = JobRepository(session, DEFAULT_WORKSPACE).create(kind="x", body={}).id
        changes.begin(session, identifier, worker="lab-0")
        for step in range(10):
            changes.report(session, identifier, attempt=1, progress=step / 10, message=None)
    later = utc_now() + timedelta(hours=1)
    with database.session() as session:
        assert changes.forget_events(session, before=later, limit=4) == 4
    with database.session() as session:
        assert [event.id for event in JobRepository(session, DEFAULT_WORKSPACE).events(identifier)] == [
            1,
            2,
            *range(7, 13),
        ]
        assert changes.forget_events(session, before=later, limit=100) == 6
        assert changes.forget_events(session, before=later, limit=100) == 0


def test_unused_blobs_are_found_a_few_at_a_time(database) -> None:
    with database.session() as session:
        kept = ResultRepository(session, DEFAULT_WORKSPACE).create(kind="simulation", body={"y": np.arange(50.0)})
        for number in range(6):
            put_bytes(session, bytes([number]))
    later, last, gone, looks = utc_now() + timedelta(hours=1), "", 0, 0
    while last is not None:
        with database.session() as session:
            count, last = forget_unused(session, before=later, after=last, limit=2)
        assert count <= 2
        gone, looks = gone + count, looks + 1
    assert (gone, looks, blobs(database)) == (6, 5, 1)
    with database.session() as session:
        results = ResultRepository(session, DEFAULT_WORKSPACE)
        np.testing.assert_array_equal(results.body(results.get(kept.id))["y"], np.arange(50.0))
