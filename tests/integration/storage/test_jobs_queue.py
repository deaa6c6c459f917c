"""The order of jobs, and what makes them wait, go on, or end."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest
from dbos._sys_db import SystemDatabase
from sqlalchemy import func, select, text, update

from storage.errors import StateError
from storage.jobs.worker import Worker
from storage.models import DEFAULT_WORKSPACE, Job, Priority, Result, Workspace
from storage.models.base import utc_now
from storage.repositories import JobRepository, ResultRepository
from storage.repositories import jobs as changes
from tests.support import slow_to_load
from tests.support.desk import COMPUTE, Desk, wait_for, wait_until_gone


@pytest.fixture
def desk(fresh_database) -> Iterator[Desk]:
    desk = Desk(fresh_database)
    yield desk
    desk.queue.close()


@pytest.fixture
def worker(desk, database_url) -> Iterator[Worker]:
    worker = Worker(database_url, compute=COMPUTE, heartbeat=0.2)
    yield worker
    if Worker.current is worker:
        worker.stop()


def steps(log: Path) -> list[int]:
    return [int(line) for line in log.read_text().split()] if log.exists() else []


def order_of(desk: Desk, jobs: dict[str, str]) -> list[str]:
    """Wait for all jobs, return their names in the order in which they began."""
    begun = {name: desk.wait(job).started_at for name, job in jobs.items()}
    return sorted(begun, key=begun.get)


def test_priorities_decide_within_a_workspace_and_workspaces_take_turns(desk, worker):
    with desk.database.session() as session:
        session.add(Workspace(id="ws_small", name="small"))
    quick = {"values": [1], "pause": 0}
    jobs = {
        f"low {n}": desk.ask_in(DEFAULT_WORKSPACE, "square", queue={"priority": Priority.LOW}, **quick)
        for n in range(8)
    }
    jobs |= {
        f"high {n}": desk.ask_in(DEFAULT_WORKSPACE, "square", queue={"priority": Priority.HIGH}, **quick)
        for n in range(8)
    }
    jobs |= {f"small {n}": desk.ask_in("ws_small", "square", **quick) for n in range(3)}
    with desk.database.session() as session:
        assert {session.get_one(Job, job).priority for name, job in jobs.items() if "low" in name} == {Priority.LOW}
    worker.start()
    for name, job in jobs.items():
        if "small" in name:
            with desk.database.session() as session:
                found = JobRepository(session, "ws_small")
                wait_for(lambda f=found, j=job: f.get(j).status == "succeeded", "the small workspace's job")
    del jobs["small 0"], jobs["small 1"], jobs["small 2"]
    order = order_of(desk, jobs)
    assert all(name.startswith("high") for name in order[:8]), order
    with desk.database.session() as session:
        rank = dict(
            session.execute(
                select(Job.workspace_id, func.max(func.coalesce(Job.started_at, None))).group_by(Job.workspace_id)
            ).all()
        )
    # Seventeen jobs were asked for before its last one, and it did not have to wait for them all (chance: 1 in 2**16).
    assert rank["ws_small"] < rank[DEFAULT_WORKSPACE]


def test_a_workspace_computes_as_many_jobs_at_a_time_as_it_may(desk, database_url):
    with desk.database.session() as session:
        session.execute(update(Workspace).values(limits={"running_jobs": 2}))
    worker = Worker(database_url, compute=COMPUTE, slots=4, heartbeat=0.2)
    worker.start()
    jobs = [desk.ask("linger") for _ in range(4)]

    def states() -> list[str]:
        return sorted(desk.get(job).status for job in jobs)

    wait_for(lambda: states() == ["queued", "queued", "running", "running"], "two run")
    with desk.database.session() as session:
        aside = select(func.count()).where(Job.ticket.is_(None))
        wait_for(lambda: session.scalar(aside) == 2, "the others are put aside")
    running = [job for job in jobs if desk.get(job).status == "running"]
    for job in running:
        desk.cancel(job)
    wait_for(lambda: states() == ["cancelled", "cancelled", "running", "running"], "the others follow")
    worker.stop()


def test_a_paused_job_is_nowhere_and_goes_on_from_where_it_was(desk, worker, tmp_path):
    log, hold = tmp_path / "log", tmp_path / "log.hold"
    hold.touch()
    job = desk.ask("climb", steps=3, log=str(log), pause=1.05)
    worker.start()
    wait_for(lambda: desk.get(job).progress > 0, "the first step")
    paused = desk.pause(job)
    assert (paused.status, paused.paused, paused.worker) == ("queued", True, None)
    assert desk.pause(job).last_event == paused.last_event
    assert desk.events(job)[-1][1:] == ("status", {"status": "queued", "paused": True})
    hold.unlink()
    other = desk.wait(desk.ask("square", values=[1], pause=0))  # the slot is free
    assert other.status == "succeeded"
    assert steps(log) == [0]
    resumed = desk.resume(job)
    assert (resumed.status, resumed.paused) == ("queued", False)
    assert desk.resume(job).round == resumed.round
    ended = desk.wait(job)
    assert (ended.status, steps(log)) == ("succeeded", [0, 1, 2])
    with pytest.raises(StateError, match="must not have ended"):
        desk.pause(job)
    with pytest.raises(StateError, match="must not have ended"):
        desk.resume(job)


def test_a_job_out_of_time_fails_and_its_process_is_gone(desk, worker):
    worker.start()
    desk.wait(desk.ask("square", values=[1], pause=0))  # what computes is loaded
    limited = desk.ask_in(DEFAULT_WORKSPACE, "spin", queue={"time_limit": 0.8})
    process = desk.process_of(limited)
    job = desk.wait(limited)
    assert (job.status, job.error["type"]) == ("failed", "urn:servotune:problem:overdue")
    assert "within its time_limit of 0.8 s" in job.error["detail"]
    wait_until_gone(process)
    blocker = desk.ask("linger")
    desk.wait(blocker, "running")
    late = desk.wait(desk.ask_in(DEFAULT_WORKSPACE, "linger", queue={"deadline": utc_now() + timedelta(seconds=0.3)}))
    assert (late.status, late.attempts) == ("failed", 0)
    assert "before its deadline" in late.error["detail"]


def test_what_nobody_carries_is_found(desk, worker):
    lost = desk.ask("square", values=[1], pause=0)
    dbos = "" if desk.database.engine.dialect.name == "sqlite" else "dbos."
    with desk.database.session() as session:
        session.execute(text(f"DELETE FROM {dbos}workflow_status"))  # what a restored backup may lack
    worker.start()
    assert desk.wait(lost).status == "succeeded"


def test_workers_take_as_many_jobs_as_they_have_slots(desk, database_url):
    """The engine keeps one number of slots for all workers in the database: the last one that started says it."""
    import subprocess

    code = "import sys, threading; from storage.jobs.worker import Worker; Worker(sys.argv[1], compute=sys.argv[2], slots=1).run(threading.Event())"
    worker = Worker(database_url, compute=COMPUTE, slots=3)
    worker.start()
    other = subprocess.Popen([sys.executable, "-c", code, database_url, COMPUTE])
    with desk.database.session() as session:
        wait_for(lambda: len(session.execute(text("SELECT id FROM worker")).all()) == 2, "the second worker")
    jobs = [desk.ask("linger") for _ in range(6)]
    wait_for(lambda: [desk.get(job).status for job in jobs].count("running") == 4, "four run")
    with desk.database.session() as session:
        held = dict(
            session.execute(select(Job.worker, func.count()).where(Job.status == "running").group_by(Job.worker)).all()
        )
    assert held[worker.name] == 3
    dbos = "" if desk.database.engine.dialect.name == "sqlite" else "dbos."
    with desk.database.session() as session:
        taken = session.scalar(text(f"SELECT count(*) FROM {dbos}workflow_status WHERE status = 'PENDING'"))
    assert taken == 4  # nobody holds a job that another could compute
    worker.stop()
    other.kill()
    other.wait()


def test_old_jobs_are_forgotten_with_what_they_left(desk, worker, monkeypatch):
    worker.start()
    # The engine writes down that a job has ended after the job has, and a worker that stops waits for it.
    late, write_down = threading.Event(), SystemDatabase.update_workflow_outcome
    monkeypatch.setattr(
        SystemDatabase, "update_workflow_outcome", lambda *args, **how: late.wait(0.5) or write_down(*args, **how)
    )
    old = desk.wait(desk.ask("square", values=[1, 2], pause=0))
    young = desk.wait(desk.ask("square", values=[1], pause=0))
    worker.stop()
    with desk.database.session() as session:
        assert changes.forget(session, before=young.finished_at) == 1
    with desk.database.session() as session:
        assert session.scalars(select(Job.id)).all() == [young.id]
        assert session.scalars(select(Result.id)).all() == [young.result_id]
        results = ResultRepository(session, DEFAULT_WORKSPACE)
        assert session.get_one(Workspace, DEFAULT_WORKSPACE).stored_bytes == results._size(results.get(young.result_id))
    assert old.id != young.id
    assert desk.queue.forget(before=utc_now() + timedelta(minutes=1)) == 2
    dbos = "" if desk.database.engine.dialect.name == "sqlite" else "dbos."
    with desk.database.session() as session:
        assert session.scalar(text(f"SELECT count(*) FROM {dbos}workflow_status")) == 0


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_job_waits_in_the_queue_while_a_worker_loads_and_its_time_limit_does_not_count_that(
    fresh_database, database_url
):
    desk = Desk(fresh_database)
    limited = desk.ask_in(DEFAULT_WORKSPACE, "x", queue={"time_limit": 2.0})
    worker = Worker(database_url, compute="tests.support.slow_to_load:run")
    began = time.monotonic()
    worker.start()
    # Another worker, which has loaded, could take it.
    while time.monotonic() < began + 0.5 * slow_to_load.LOADING:
        assert desk.get(limited).status == "queued"
        time.sleep(0.1)
    job = desk.wait(limited)
    worker.stop()
    desk.queue.close()
    assert (job.status, job.error) == ("succeeded", None)
    assert job.started_at - job.created_at >= timedelta(seconds=2.0)  # that time lies before its start
