"""What a user does with jobs, and how a test watches processes."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

from storage import Database
from storage.jobs.queue import JobQueue
from storage.models import DEFAULT_WORKSPACE, Job
from storage.repositories import JobRepository
from tests.support.patience import PATIENCE

COMPUTE = "tests.support.computing:run"
FINAL = ("succeeded", "failed", "cancelled")


class Desk:
    """What a user does with jobs."""

    def __init__(self, database: Database) -> None:
        self.database = database
        self.queue = JobQueue(database)

    def ask(self, kind: str, **body: Any) -> str:
        return self.ask_in(DEFAULT_WORKSPACE, kind, **body)

    def ask_in(self, workspace: str, kind: str, *, queue: dict[str, Any] | None = None, **body: Any) -> str:
        with self.database.session() as session:
            return self.queue.enqueue(session, kind=kind, body=body, workspace_id=workspace, **(queue or {})).id

    def get(self, job_id: str) -> Job:
        with self.database.session() as session:
            return JobRepository(session, DEFAULT_WORKSPACE).get(job_id)

    def events(self, job_id: str, after: int = 0) -> list[tuple[int, str, dict[str, Any]]]:
        with self.database.session() as session:
            rows = JobRepository(session, DEFAULT_WORKSPACE).events(job_id, after=after)
            return [(row.id, row.type, row.payload) for row in rows]

    def wait(self, job_id: str, *statuses: str, timeout: float = PATIENCE) -> Job:
        give_up_at = time.monotonic() + timeout
        while (job := self.get(job_id)).status not in (statuses or FINAL):
            assert time.monotonic() < give_up_at, f"job is {job.status} after {timeout} s"
            time.sleep(0.01)
        return job

    def process_of(self, job_id: str) -> int:
        """Wait for the message in which ``spin`` or ``linger`` tells its process id."""
        give_up_at = time.monotonic() + PATIENCE
        while not (told := [payload for _id, type_, payload in self.events(job_id) if type_ == "message"]):
            assert time.monotonic() < give_up_at
            time.sleep(0.01)
        return int(told[-1]["message"])

    def pause(self, job_id: str) -> Job:
        with self.database.session() as session:
            return JobRepository(session, DEFAULT_WORKSPACE).pause(job_id)

    def resume(self, job_id: str) -> Job:
        with self.database.session() as session:
            return self.queue.resume(session, DEFAULT_WORKSPACE, job_id)

    def cancel(self, job_id: str) -> Job:
        with self.database.session() as session:
            return JobRepository(session, DEFAULT_WORKSPACE).cancel(job_id)


def exists(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def wait_until_gone(process: int) -> None:
    give_up_at = time.monotonic() + PATIENCE
    while exists(process):
        assert time.monotonic() < give_up_at, f"process {process} still runs after {PATIENCE} s"
        time.sleep(0.01)


def wait_for(found: Callable[[], bool], what: str, timeout: float = PATIENCE) -> None:
    """Wait until something is so."""
    give_up_at = time.monotonic() + timeout
    while not found():
        assert time.monotonic() < give_up_at, f"{what}: not after {timeout} s"
        time.sleep(0.01)
