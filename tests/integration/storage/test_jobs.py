"""Jobs on a worker in this process, computed in its children."""

from __future__ import annotations

import logging
import os
import signal
import time
from collections.abc import Iterator

import numpy as np
import pytest

from storage import open_database
from storage.errors import StateError
from storage.jobs.worker import Worker
from storage.models import DEFAULT_WORKSPACE
from storage.repositories import ResultRepository, WorkerRepository
from tests.support.desk import COMPUTE, Desk, wait_until_gone


@pytest.fixture(scope="module")
def busy_desk(module_database_url) -> Iterator[Desk]:
    """A desk with a worker of two slots behind it, shared by the tests that leave it as it was."""
    database = open_database(module_database_url)
    desk = Desk(database)
    worker = Worker(module_database_url, compute=COMPUTE, slots=2)
    worker.start()
    yield desk
    worker.stop()
    desk.queue.close()
    database.dispose()


def test_a_job_runs_and_its_result_is_kept(busy_desk):
    job = busy_desk.wait(busy_desk.ask("square", values=[1, 2, 3]))
    assert (job.status, job.progress, job.attempts, job.error) == ("succeeded", 1.0, 1, None)
    assert job.created_at <= job.started_at <= job.finished_at
    with busy_desk.database.session() as session:
        results = ResultRepository(session, DEFAULT_WORKSPACE)
        result = results.get(job.result_id)
        body = results.body(result)
    assert (result.kind, result.request) == ("square", {"values": [1, 2, 3]})
    np.testing.assert_array_equal(body["squares"]["values"], [1.0, 4.0, 9.0])
    assert body["count"] == 3
    assert body["process"] != os.getpid()


def test_events_come_in_order_and_can_be_resumed(busy_desk):
    job = busy_desk.wait(busy_desk.ask("square", values=[1]))
    events = busy_desk.events(job.id)
    assert [id_ for id_, _type, _payload in events] == list(range(1, len(events) + 1))
    statuses = [payload["status"] for _id, type_, payload in events if type_ == "status"]
    assert statuses == ["queued", "running", "succeeded"]
    progress = [payload["progress"] for _id, type_, payload in events if type_ == "progress"]
    assert progress == sorted(progress)
    assert progress[0] == 0.2
    assert events[-2][1:] == ("message", {"message": "done"})
    assert busy_desk.events(job.id, after=3) == events[3:]


def test_reports_are_throttled(busy_desk):
    job = busy_desk.wait(busy_desk.ask("chatter", seconds=0.5))
    assert job.status == "succeeded"
    types = [type_ for _id, type_, _payload in busy_desk.events(job.id)]
    assert 2 <= types.count("progress") <= 6
    assert 20 <= types.count("message") <= 26  # a burst of 20, then ten per second


def test_a_warm_worker_begins_at_once(busy_desk):
    busy_desk.wait(busy_desk.ask("square", values=[1], pause=0))
    waits = []
    for _ in range(3):
        job = busy_desk.wait(busy_desk.ask("square", values=[1], pause=0))
        waits.append((job.finished_at - job.created_at).total_seconds())
    assert min(waits) < 0.5


def test_cancel_kills_a_busy_loop_within_a_second(busy_desk):
    job_id = busy_desk.ask("spin")
    process = busy_desk.process_of(job_id)
    job = busy_desk.cancel(job_id)
    assert job.status == "cancelled"
    wait_until_gone(process)
    assert busy_desk.events(job_id)[-1][1:] == ("status", {"status": "cancelled"})
    assert busy_desk.cancel(job_id).finished_at == job.finished_at  # a second time changes nothing


@pytest.mark.parametrize(
    ("kind", "body", "problem"),
    [
        ("crash", {}, ("internal", "(ZeroDivisionError)")),
        ("not_json", {}, ("internal", "internal error")),
        ("die", {"signal": int(signal.SIGKILL)}, ("process-died", "killed by SIGKILL")),
        ("die", {"signal": int(signal.SIGSEGV)}, ("process-died", "killed by SIGSEGV")),
    ],
)
def test_a_job_that_goes_wrong_fails_with_a_problem(busy_desk, caplog, kind, body, problem):
    slug, detail = problem
    with caplog.at_level(logging.ERROR, "storage.jobs.supervision"):
        job = busy_desk.wait(busy_desk.ask(kind, **body))
    assert (job.status, job.result_id, job.error["type"]) == ("failed", None, f"urn:servotune:problem:{slug}")
    assert detail in job.error["detail"]
    assert busy_desk.events(job.id)[-1][2] == {"status": "failed", "error": job.error}
    # What went wrong inside is for the log, not for the user.
    assert "secret" not in str(job.error)
    assert ("a secret of the implementation" in caplog.text) == (kind == "crash")


def test_a_refusal_is_told_as_it_is(busy_desk):
    job = busy_desk.wait(busy_desk.ask("refuse"))
    assert job.status == "failed"
    assert job.error == {
        "type": "urn:test:refused",
        "title": "Refused",
        "detail": "gain must be > 0, got -1",
        "at": ["gain"],
    }


def test_two_slots_work_at_the_same_time(busy_desk):
    jobs = [busy_desk.ask("spin") for _ in range(3)]
    first, second = (busy_desk.process_of(job) for job in jobs[:2])
    assert first != second
    time.sleep(0.3)
    assert busy_desk.get(jobs[2]).status == "queued"
    busy_desk.cancel(jobs[2])
    for job in jobs[:2]:
        busy_desk.cancel(job)
    for process in (first, second):
        wait_until_gone(process)
    assert busy_desk.get(jobs[2]).attempts == 0


def test_a_process_has_one_worker(busy_desk):
    with pytest.raises(StateError, match="one worker"):
        Worker(busy_desk.database.url, compute=COMPUTE).start()


def test_the_worker_is_seen(busy_desk):
    with busy_desk.database.session() as session:
        (worker,) = WorkerRepository(session).alive()
    assert (worker.pid, worker.slots) == (os.getpid(), 2)
