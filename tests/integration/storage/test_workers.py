from __future__ import annotations

from datetime import timedelta

import pytest

from storage.models import DEFAULT_WORKSPACE, JobStatus, Worker
from storage.models.base import utc_now
from storage.repositories import JobRepository, WorkerRepository
from storage.repositories import jobs as changes
from storage.repositories.workers import FORGOTTEN_AFTER, STALE_AFTER

HOLDER = {"host": "lab", "pid": 1, "slots": 1}


def test_a_name_has_one_holder(database):
    with database.session() as session:
        workers = WorkerRepository(session)
        assert workers.claim("lab-0", token="a", replaces=None, **HOLDER)
        assert not workers.claim("lab-0", token="b", replaces=None, **HOLDER)
        assert workers.claim("lab-0", token="c", replaces="a", **HOLDER)
        assert not workers.claim("lab-0", token="d", replaces="a", **HOLDER)
        assert not workers.beat("lab-0", "a")
        assert workers.beat("lab-0", "c")
        assert workers.get("lab-0").token == "c"


def test_silence_is_death_and_is_forgotten(database):
    with database.session() as session:
        workers = WorkerRepository(session)
        assert workers.last_seen() is None
        ages = {"fresh": timedelta(0), "silent": STALE_AFTER, "old": FORGOTTEN_AFTER + timedelta(seconds=1)}
        for name, age in ages.items():
            workers.claim(name, token=name, replaces=None, **HOLDER)
            session.get_one(Worker, name).seen_at = utc_now() - age
        session.flush()
        assert [worker.id for worker in workers.alive()] == ["fresh"]
        assert set(workers.dead()) == {"silent", "old"}
        workers.forget()
        assert workers.dead() == ["silent"]
        assert utc_now() - workers.last_seen() < timedelta(seconds=30)
        workers.retire("fresh", "fresh")
        assert workers.alive() == []
        assert set(workers.dead()) == {"silent", "fresh"}


@pytest.mark.parametrize("late", ["report", "finish", "give_back", "lock", "is_wanted"])
def test_an_attempt_that_lost_its_job_changes_nothing(database, late):
    with database.session() as session:
        jobs = JobRepository(session, DEFAULT_WORKSPACE)
        identifier = jobs.create(kind="x", body={}).id
        changes.begin(session, identifier, worker="lab-0")
        changes.begin(session, identifier, worker="lab-1")
        before = len(jobs.events(identifier))
        match late:
            case "report":
                assert not changes.report(session, identifier, attempt=1, progress=0.5, message=None)
            case "finish":
                assert not changes.finish(session, identifier, status=JobStatus.SUCCEEDED, attempt=1)
            case "give_back":
                changes.give_back(session, identifier, attempt=1)
            case "lock":
                assert not changes.lock(session, identifier, attempt=1)
            case _:
                assert not changes.is_wanted(session, identifier, attempt=1)
                assert changes.is_wanted(session, identifier, attempt=2)
        job = jobs.get(identifier)
        assert (job.status, job.worker, job.attempts, job.progress) == ("running", "lab-1", 2, 0.0)
        assert len(jobs.events(identifier)) == before
        assert jobs.events(identifier, after=10**30) == []


def test_a_finished_job_is_not_begun_again(database):
    with database.session() as session:
        jobs = JobRepository(session, DEFAULT_WORKSPACE)
        identifier = jobs.create(kind="x", body={}).id
        jobs.cancel(identifier)
        assert changes.begin(session, identifier, worker="lab-0") is None
        assert not changes.finish(session, identifier, status=JobStatus.SUCCEEDED)
        assert jobs.get(identifier).status == "cancelled"
