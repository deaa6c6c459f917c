from __future__ import annotations

from datetime import timedelta

import pytest

from storage.jobs.liveness import Pulse
from storage.models import DEFAULT_WORKSPACE, JobStatus, Worker
from storage.models.base import utc_now
from storage.repositories import JobRepository, WorkerRepository
from storage.repositories import jobs as changes

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


class Clock:
    now = 50.0

    def __call__(self) -> float:
        return self.now


def test_silence_is_death_whatever_the_clocks_of_the_machines_say(database):
    clock = Clock()
    pulse = Pulse(10.0, clock=clock)
    with database.session() as session:
        workers = WorkerRepository(session)
        assert workers.last_seen() is None
        for name, ahead in {"on time": 0, "fast": 3600, "slow": -3600}.items():
            workers.claim(name, token=name, replaces=None, **HOLDER)
            session.get_one(Worker, name).seen_at = utc_now() + timedelta(seconds=ahead)
        session.flush()
        assert pulse.dead(workers.heartbeats()) == []
        for _ in range(5):
            clock.now += 1.9
            workers.beat("on time", "on time")
            assert pulse.dead(workers.heartbeats()) == []
        clock.now += 0.6
        assert {worker.id for worker in pulse.dead(workers.heartbeats())} == {"fast", "slow"}
        workers.retire("on time", "on time")
        assert len(pulse.dead(workers.heartbeats())) == 3


def test_while_nobody_can_look_nobody_dies(database):
    """The database was away for an hour, or this process stood still: the others need a heartbeat to come back."""
    clock = Clock()
    pulse = Pulse(10.0, clock=clock)
    with database.session() as session:
        workers = WorkerRepository(session)
        for name in ("back", "dead"):
            workers.claim(name, token=name, replaces=None, **HOLDER)
        assert pulse.dead(workers.heartbeats()) == []
        clock.now += 3600.0
        assert pulse.dead(workers.heartbeats()) == []
        clock.now += 2.0
        workers.beat("back", "back")
        for _ in range(3):
            assert pulse.dead(workers.heartbeats()) == []
            clock.now += 2.0
        clock.now += 0.5
        assert [worker.id for worker in pulse.dead(workers.heartbeats())] == ["dead"]


def test_a_dead_worker_is_buried_unless_it_shows_itself(database):
    with database.session() as session:
        workers = WorkerRepository(session)
        workers.claim("lab-0", token="a", replaces=None, **HOLDER)
        last_seen = workers.get("lab-0").seen_at
        workers.bury("lab-0", token="a", seen_at=last_seen - timedelta(seconds=2))
        assert workers.beat("lab-0", "a")
        workers.bury("lab-0", token="a", seen_at=workers.get("lab-0").seen_at)
        assert not workers.beat("lab-0", "a")


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
