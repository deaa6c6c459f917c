"""What is written down of a job while it is computed, and how it ends: each in one transaction, for which a database that is away is waited."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping
from typing import Any, NoReturn, TypeVar

from sqlalchemy.orm import Session

from storage.errors import UNAVAILABLE, why_unavailable
from storage.jobs.queue import JobQueue
from storage.models import Job, JobStatus
from storage.models.base import Document
from storage.repositories import jobs
from storage.repositories.results import PackedBody, ResultRepository
from storage.session import Database

#: The pauses (s) between two tries to write while the database is away, and the longest of them.
_PAUSE, _LONGEST_PAUSE = 0.5, 5.0

_log = logging.getLogger(__name__)

Value = TypeVar("Value")


class Stopped(BaseException):
    """The worker stops: the job engine must keep the job for the next one, so this is no outcome of the job."""


class Outcomes:
    """Writes down what becomes of jobs.

    Every method raises `Stopped` when ``stopping`` is set while the database is away.
    """

    def __init__(self, database: Database, queue: JobQueue, stopping: threading.Event) -> None:
        self._database = database
        self._queue = queue
        self._stopping = stopping

    def write(self, work: Callable[[Session], Value]) -> Value:
        """Do some work in a transaction; wait for a database or an object store that is away, for there is nothing else to do."""
        pause = _PAUSE
        while True:
            try:
                with self._database.session() as session:
                    return work(session)
            except UNAVAILABLE as error:
                if self._stopping.wait(pause):
                    raise Stopped from error
                _log.warning("what becomes of a job waits, %s: %s", why_unavailable(error), error)
                pause = min(2 * pause, _LONGEST_PAUSE)

    def let_go(self, job: Job) -> str:
        """Give what was put aside its turn; return the status in which the job is left."""

        def release(session: Session) -> str:
            self._queue.release(session, job.workspace_id)
            left = session.get(Job, job.id, populate_existing=True)
            return "deleted" if left is None else left.status

        return self.write(release)

    def keep_best(self, job: Job, result: Mapping[str, Any]) -> None:
        """Store what a cancelled computation has handed over."""

        def keep(session: Session) -> None:
            if jobs.is_cancelled(session, job.id, attempt=job.attempts):
                ready = ResultRepository(session, job.workspace_id).pack(result)
                jobs.attach(session, job.id, self._result(session, job, result, ready))

        self.write(keep)

    def progress(self, job: Job, fraction: float, message: str | None) -> None:
        """Say how far a job is."""
        self._report(job, fraction, message)

    def message(self, job: Job, text: str) -> None:
        """Add a line to what a job tells."""
        self._report(job, None, text)

    def _report(self, job: Job, progress: float | None, message: str | None) -> None:
        self.write(
            lambda session: jobs.report(session, job.id, attempt=job.attempts, progress=progress, message=message)
        )

    def keep_state(self, job: Job, state: dict[str, Any]) -> None:
        """Keep from where the next worker goes on if this one dies."""
        self.write(lambda session: jobs.keep_state(session, job.id, attempt=job.attempts, state=state))

    def succeed(self, job: Job, result: Mapping[str, Any]) -> None:
        """End a job with its result."""

        def keep(session: Session) -> None:
            ready = ResultRepository(session, job.workspace_id).pack(result)  # nobody is locked out meanwhile
            if not jobs.lock(session, job.id, attempt=job.attempts):
                return
            kept = self._result(session, job, result, ready)
            jobs.finish(session, job.id, status=JobStatus.SUCCEEDED, attempt=job.attempts, result_id=kept)

        self.write(keep)

    def _result(self, session: Session, job: Job, result: Mapping[str, Any], ready: PackedBody) -> str:
        """Store a result and return its id."""
        system = result.get("system")
        system = system if isinstance(system, Mapping) else {}
        versions = result.get("versions")
        row = ResultRepository(session, job.workspace_id).create(
            kind=job.kind,
            body=ready,
            request=job.body,
            system_id=system.get("id"),
            system_revision=system.get("revision"),
            versions=versions if isinstance(versions, Mapping) else None,
            within_quota=False,
        )
        return row.id

    def internal_error(self, job: Job, kind: str) -> None:
        """End a job that met an exception of this kind."""
        detail = f"the computation met an internal error ({kind}); the service's log tells more under {job.id}"
        self.fail(job, "internal", "Internal error", detail)

    def fail(self, job: Job, slug: str, title: str, detail: str) -> None:
        """End a job with a problem of ours."""
        self.refuse(job, {"type": f"urn:servotune:problem:{slug}", "title": title, "detail": detail})

    def refuse(self, job: Job, problem: Document) -> None:
        """End a job with the problem that its computation told."""
        self.write(
            lambda session: jobs.finish(session, job.id, status=JobStatus.FAILED, attempt=job.attempts, error=problem)
        )

    def give_back(self, job: Job) -> NoReturn:
        """Let another worker begin it anew, because this one stops."""
        self.write(lambda session: jobs.give_back(session, job.id, attempt=job.attempts))
        raise Stopped
