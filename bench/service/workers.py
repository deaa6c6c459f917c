"""How throughput grows with workers: jobs that compute, and the rates of the queue itself.

Each worker has a core of its own, as `deploy/servotune-worker@.service` gives it one. A job spends processor time, not
wall-clock time, so the ratio says what the queue costs.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from bench.service.processor import processor_time
from storage import Database, open_database
from storage.jobs.queue import JobQueue
from storage.models import DEFAULT_WORKSPACE, JobStatus
from storage.repositories import JobRepository, WorkerRepository

_CODE = (
    "import os, sys, threading; os.sched_setaffinity(0, {int(sys.argv[2])}); from storage.jobs.worker import Worker; "
    "Worker(sys.argv[1], compute='bench.service.computing:run').run(threading.Event())"
)

_STARTING = 4
"""Workers that start at the same time: all at once take the processors for so long that some count as dead."""


class Desk:
    """Asks for jobs and waits for them."""

    def __init__(self, url: str) -> None:
        self.database: Database = open_database(url)
        self.database.migrate()
        self.queue = JobQueue(self.database)

    def ask(self, kind: str, **body: float) -> str:
        """Ask for one job."""
        with self.database.session() as session:
            return self.queue.enqueue(session, kind=kind, body=body, workspace_id=DEFAULT_WORKSPACE).id

    def wait(self, job: str) -> float:
        """Return how long (s) the job took, from the first start to its end."""
        while True:
            with self.database.session() as session:
                row = JobRepository(session, DEFAULT_WORKSPACE).get(job)
            if JobStatus(row.status).final:
                assert row.status == JobStatus.SUCCEEDED, row.error
                assert row.started_at is not None
                assert row.finished_at is not None
                return (row.finished_at - row.started_at).total_seconds()
            time.sleep(0.05)

    def close(self) -> None:
        """Let go of the database."""
        self.queue.close()
        self.database.dispose()


def _alive(desk: Desk) -> int:
    with desk.database.session() as session:
        return len(WorkerRepository(session).alive())


@contextmanager
def working(desk: Desk, url: str, count: int) -> Iterator[None]:
    """Run workers, each on a core of its own, from when all of them are there."""
    cores = sorted(os.sched_getaffinity(0))
    running: list[subprocess.Popen[bytes]] = []
    try:
        for number in range(count):
            core = str(cores[number % len(cores)])
            running.append(subprocess.Popen([sys.executable, "-c", _CODE, url, core]))  # noqa: S603 - our own code
            while _alive(desk) <= number - _STARTING:
                time.sleep(0.1)
        while _alive(desk) < count:
            time.sleep(0.1)
        desk.wait(desk.ask("nothing"))
        time.sleep(1.0)
        yield
    finally:
        for worker in running:
            worker.terminate()
        for worker in running:
            worker.wait()


def work(url: str, *, jobs: int, seconds: float) -> dict[int, float]:
    """Return how long so many jobs, each of so many seconds of work, take with one and with two workers."""
    taken = {}
    for number in (1, 2):
        desk = Desk(url)
        with working(desk, url, number):
            begun = time.perf_counter()
            for job in [desk.ask("work", work=seconds) for _ in range(jobs)]:
                desk.wait(job)
            taken[number] = time.perf_counter() - begun
        desk.close()
    return taken


def rates(url: str, *, jobs: int) -> tuple[dict[str, float], float]:
    """Return jobs asked for in a second, and done in a second by one worker and by two; and the processor time (s) of Postgres that a job took by two."""
    found = {}
    spent = 0.0
    for number in (1, 2):
        desk = Desk(url)
        with working(desk, url, number):
            spent, begun = processor_time("postgres"), time.perf_counter()
            asked = [desk.ask("nothing") for _ in range(jobs)]
            found["asked"] = jobs / (time.perf_counter() - begun)
            begun = time.perf_counter()
            for job in asked:
                desk.wait(job)
            found[f"done, {number} worker{'s' * (number > 1)}"] = jobs / (time.perf_counter() - begun)
            spent = (processor_time("postgres") - spent) / jobs
        desk.close()
    return found, spent
