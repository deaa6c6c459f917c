"""Workers that stop, die or hang: no job is lost, none is done twice, none kills for ever."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from datetime import datetime

import pytest
from sqlalchemy import false, select, text, update
from sqlalchemy.orm import Session

from storage.errors import StateError
from storage.ids import new_id
from storage.jobs import maintenance
from storage.jobs.engine import SHAPE
from storage.jobs.worker import Worker
from storage.models import DEFAULT_WORKSPACE, Elected, Job, JobStatus, Workspace
from storage.models.base import utc_now
from storage.repositories import JobRepository, ResultRepository, WorkerRepository
from storage.repositories import jobs as changes
from tests.support.desk import COMPUTE, Desk, exists, wait_for, wait_until_gone
from tests.support.patience import PATIENCE

WORK = """
import sys, threading
from storage.jobs.worker import Worker
Worker(sys.argv[1], compute=sys.argv[2], heartbeat=float(sys.argv[3])).run(threading.Event())
"""


def start_worker(url: str, *, heartbeat: float = 0.2) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", WORK, url, COMPUTE, str(heartbeat)])


@pytest.fixture
def desk(fresh_database) -> Iterator[Desk]:
    desk = Desk(fresh_database)
    yield desk
    desk.queue.close()


def test_a_rolled_back_request_leaves_nothing(desk):
    with desk.database.sessions() as session:
        job_id = desk.queue.enqueue(session, kind="square", body={}, workspace_id=DEFAULT_WORKSPACE).id
        session.rollback()
    with desk.database.session() as session:
        assert session.get(Job, job_id) is None
        dbos = "" if desk.database.engine.dialect.name == "sqlite" else "dbos."
        assert session.scalar(text(f"SELECT count(*) FROM {dbos}workflow_status")) == 0
    kept = desk.ask("square")
    with desk.database.session() as session:
        assert session.scalars(text(f"SELECT workflow_uuid FROM {dbos}workflow_status")).all() == [kept]


def test_a_job_that_outlived_its_workers_three_times_fails(desk, database_url):
    job_id = desk.ask("spin")
    with desk.database.session() as session:
        for _ in range(3):
            assert changes.begin(session, job_id, worker="dead-0", ticket=job_id) is not None
    worker = Worker(database_url, compute=COMPUTE)
    worker.start()
    job = desk.wait(job_id)
    worker.stop()
    assert job.status == "failed"
    assert job.error["title"] == "Interrupted too often"


def test_a_stopping_worker_gives_its_job_back(desk, database_url):
    worker = Worker(database_url, compute=COMPUTE)
    stop = threading.Event()
    thread = threading.Thread(target=worker.run, args=[stop])
    thread.start()
    job_id = desk.ask("spin")
    process = desk.process_of(job_id)
    stop.set()
    thread.join()
    assert not exists(process)
    job = desk.get(job_id)
    assert (job.status, job.attempts, job.worker) == ("queued", 0, None)
    with desk.database.session() as session:
        assert WorkerRepository(session).alive() == []
    worker = Worker(database_url, compute=COMPUTE)
    worker.start()
    assert desk.wait(job_id, "running").attempts == 1
    worker.stop()


def test_a_worker_refuses_a_database_that_is_not_migrated(empty_database_url):
    with pytest.raises(StateError, match="migrated"):
        Worker(empty_database_url, compute=COMPUTE).start()
    assert Worker.current is None


def test_a_killed_workers_job_is_finished_by_the_next_one(desk: Desk, database_url, tmp_path):
    log = tmp_path / "log"
    job_id = desk.ask("kill_worker", log=str(log), times=1)
    worker = start_worker(database_url)
    assert worker.wait(timeout=PATIENCE) == -signal.SIGKILL
    (child,) = map(int, log.read_text().split())
    wait_until_gone(child)
    assert desk.get(job_id).status == "running"
    follower = Worker(database_url, compute=COMPUTE)
    follower.start()
    job = desk.wait(job_id)
    follower.stop()
    assert (job.status, job.attempts) == ("succeeded", 2)
    assert len(log.read_text().split()) == 2


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_job_that_kills_its_workers_fails(desk: Desk, database_url, tmp_path):
    job_id = desk.ask("kill_worker", log=str(tmp_path / "log"), times=99)
    for _ in range(3):
        assert start_worker(database_url).wait(timeout=PATIENCE) == -signal.SIGKILL
    last = Worker(database_url, compute=COMPUTE)
    last.start()
    job = desk.wait(job_id)
    last.stop()
    assert job.status == "failed"
    assert job.error["title"] == "Interrupted too often"
    assert len((tmp_path / "log").read_text().split()) == 3


@pytest.fixture
def hanging(database_url) -> Iterator[subprocess.Popen[bytes]]:
    """A worker that may be stopped and woken, gone when the test is over."""
    process = start_worker(database_url, heartbeat=1.0)
    yield process
    process.kill()
    process.wait()


def test_a_living_worker_takes_over_from_a_dead_one(desk: Desk, database_url, hanging):
    job_id = desk.ask("linger")
    first = desk.process_of(job_id)
    dead_name = desk.get(job_id).worker
    # slower hearts than elsewhere: on a busy machine the living one must not be taken for dead when the other comes back
    heir = Worker(database_url, compute=COMPUTE, heartbeat=1.0)
    heir.start()
    try:
        assert heir.name.endswith("-1")
        # as a machine that hangs: its job must go on elsewhere
        with desk.database.session() as session:
            # with SQLite's one lock in hand: whoever stands still in the middle of a write there holds up everybody
            session.execute(update(Job).where(false()).values(attempts=0))
            hanging.send_signal(signal.SIGSTOP)
        give_up_at = time.monotonic() + PATIENCE
        while desk.get(job_id).worker != heir.name:
            assert time.monotonic() < give_up_at
            time.sleep(0.05)
        assert desk.get(job_id).attempts == 2
        # Its name is forgotten after its jobs have been handed on: one that comes back in between keeps it.
        wait_for(lambda: _forgotten(desk, dead_name), "the dead one forgotten")
        # Back to life, it finds that the job is not its own any more.
        hanging.send_signal(signal.SIGCONT)
        wait_until_gone(first)
        job = desk.get(job_id)
        assert (job.status, job.attempts, job.worker) == ("running", 2, heir.name)
        # It has lost its name, and works on under another one; what it takes before it notices, it gives back.
        other = desk.ask("linger")
        wait_for(lambda: desk.get(other).worker not in {None, heir.name, dead_name}, "another name")
    finally:
        heir.stop()


def test_a_job_that_the_engine_claimed_and_never_began_is_begun(desk: Desk, database_url):
    """As it is left when the database goes away between the claim and the start of the job."""
    worker = Worker(database_url, compute=COMPUTE, heartbeat=0.2)
    worker.start()
    try:
        claimed = _claimed_by(desk, worker.name)
        job = desk.wait(claimed)
        assert (job.status, job.attempts, job.worker) == ("succeeded", 1, worker.name)
        running = desk.ask("linger")  # one that is in hand stays there, however long it takes
        desk.process_of(running)
        ticket, beats = desk.get(running).ticket, set()
        wait_for(lambda: beats.add(_seen(desk, worker.name)) or len(beats) > 10, "ten heartbeats")
        assert (desk.get(running).ticket, desk.get(running).attempts) == (ticket, 1)
    finally:
        worker.stop()


def test_what_was_claimed_under_a_lost_name_is_found_by_whoever_begins(
    desk: Desk, database_url, monkeypatch: pytest.MonkeyPatch
):
    """As it is left by a worker that comes back after it was forgotten, and claims a job before it notices that."""
    monkeypatch.setattr(maintenance, "_RECONCILE_INTERVAL", 3600.0)
    elected = Worker(database_url, compute=COMPUTE, heartbeat=0.2)
    elected.start()
    try:
        wait_for(lambda: _beats(desk) >= 2, "the end of its first look")
        claimed = _claimed_by(desk, "lost-0")
        beginner = start_worker(database_url)
        try:
            assert desk.wait(claimed).status == "succeeded"
        finally:
            beginner.kill()
            beginner.wait()
    finally:
        elected.stop()


def test_a_job_that_an_earlier_version_has_cut_is_computed_whole(desk: Desk, database_url):
    """Some parts done, one in the queue, one in the hands of a worker of that version; and one job that is paused meanwhile."""
    whole, held = desk.ask("square", values=[3], pause=0), desk.ask("square", values=[4], pause=0)
    with desk.database.session() as session:
        for parent in (whole, held):
            _cut(session, desk, parent)
        stored = session.get_one(Workspace, DEFAULT_WORKSPACE).stored_bytes
    desk.pause(held)
    assert stored > 0
    worker = Worker(database_url, compute=COMPUTE, heartbeat=0.2)
    worker.start()
    try:
        assert desk.wait(whole).status == "succeeded"
        assert desk.get(held).paused
        with desk.database.session() as session:
            assert set(session.scalars(select(Job.id))) == {whole, held}
            own = session.get_one(Workspace, DEFAULT_WORKSPACE).stored_bytes
            assert own < stored
        desk.resume(held)
        assert desk.wait(held).status == "succeeded"
    finally:
        worker.stop()


def _cut(session: Session, desk: Desk, parent: str) -> None:
    """Leave a job as a version did that cut it into parts."""
    row = session.get_one(Job, parent)
    row.status, row.ticket, row.attempts = JobStatus.RUNNING, None, 1
    row.started_at = utc_now()
    result = ResultRepository(session, DEFAULT_WORKSPACE).create(
        kind=row.kind, body={"n": [1.0] * 100}, within_quota=False
    )
    parts = [
        Job(
            id=new_id("job"), workspace_id=DEFAULT_WORKSPACE, kind=row.kind, body=row.body | {"part": {}}, status=status,
            parent_id=parent, part=number,
        )
        for number, status in enumerate((JobStatus.SUCCEEDED, JobStatus.QUEUED, JobStatus.RUNNING), start=-1)
    ]  # fmt: skip
    parts[0].result_id, parts[0].finished_at = result.id, utc_now()
    session.add_all(parts)
    session.flush()
    desk.queue.carry(session, parts[1:])


def _claimed_by(desk: Desk, name: str) -> str:
    """Create a job that the engine has claimed for a worker, and that this one has not begun."""
    dbos = "" if desk.database.engine.dialect.name == "sqlite" else "dbos."
    claim = text(
        f"UPDATE {dbos}workflow_status SET status = 'PENDING', executor_id = :name, application_version = :shape"
        " WHERE workflow_uuid = :ticket"
    )
    with desk.database.session() as session:
        row = desk.queue.enqueue(session, kind="square", body={"values": [3]}, workspace_id=DEFAULT_WORKSPACE)
        session.execute(claim, {"name": name, "shape": SHAPE, "ticket": row.ticket})
        return row.id


def _beats(desk: Desk) -> int:
    with desk.database.session() as session:
        return session.scalar(select(Elected.beats).where(Elected.role == "queue")) or 0


def _forgotten(desk: Desk, name: str) -> bool:
    with desk.database.session() as session:
        return WorkerRepository(session).get(name) is None


def _seen(desk: Desk, name: str) -> datetime:
    with desk.database.session() as session:
        return WorkerRepository(session).get(name).seen_at


def test_when_the_keeper_dies_another_one_hands_out_what_was_put_aside(desk, database_url):
    workers = [start_worker(database_url) for _ in range(2)]
    try:
        keeper = elected(desk)
        assert keeper in {worker.pid for worker in workers}
        (other,) = {worker.pid for worker in workers} - {keeper}
        next(worker for worker in workers if worker.pid == keeper).kill()
        with desk.database.session() as session:  # put aside: in nobody's queue, until a keeper finds it
            job_id = JobRepository(session, DEFAULT_WORKSPACE).create(kind="square", body={"values": [1, 2]}).id
        assert desk.wait(job_id).status == "succeeded"
        assert elected(desk) == other
    finally:
        for worker in workers:
            worker.kill()
            worker.wait()


def elected(desk: Desk) -> int:
    """Return the process of the worker that does what is done for all, as soon as there is one."""

    def process() -> str | None:
        with desk.database.session() as session:
            return session.scalar(select(Elected.process).where(Elected.role == "queue"))

    wait_for(lambda: process() is not None, "an elected worker")
    return int(str(process()).split("/")[-2])
