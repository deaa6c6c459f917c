"""Sees one job through: a child computes it, the job's row tells how far it is and how it ended."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NoReturn, TypeVar

from sqlalchemy.orm import Session

from storage.errors import UNAVAILABLE
from storage.jobs.children import Child, ChildDied, Zygote
from storage.jobs.compute import ComputeJob, Crashed, Done, Frame, Message, Progress, Refused
from storage.models import Job, JobStatus
from storage.models.base import Document
from storage.repositories import jobs
from storage.repositories.results import ResultRepository
from storage.session import Database

#: How often a job may begin: a third worker that dies with it has had enough.
MAX_ATTEMPTS = 3
#: How often (s) a running job is asked whether it is still wanted.
_LOOK_INTERVAL = 0.2
#: The pauses (s) between two tries to write while the database is away, and the longest of them.
_PAUSE, _LONGEST_PAUSE = 0.5, 15.0

_log = logging.getLogger(__name__)

Value = TypeVar("Value")


class Stopped(BaseException):
    """The worker stops: the job engine must keep the job for the next one, so this is no outcome of the job."""


class Supervisor:
    """Does the jobs that the engine hands to this worker, at most ``slots`` at a time."""

    def __init__(self, database: Database, zygote: Zygote, *, worker: str, slots: int) -> None:
        self._database = database
        self._zygote = zygote
        self._worker = worker
        self._slots = threading.Semaphore(slots)
        self._stopping = threading.Event()
        self._idle = threading.Condition()
        self._busy = 0

    def stop(self, timeout: float) -> None:
        """Kill every child, give the jobs back, and wait until that is done."""
        self._stopping.set()
        with self._idle:
            self._idle.wait_for(lambda: self._busy == 0, timeout)

    def run(self, job_id: str) -> None:
        """Do one job, or find that there is nothing to do any more.

        Raises
        ------
        Stopped
            When the worker stops first.
        """
        with self._counted(), self._slot():
            job = self._write(lambda session: jobs.begin(session, job_id, worker=self._worker))
            if job is None:
                return
            if job.attempts > MAX_ATTEMPTS:
                detail = f"the job was begun {MAX_ATTEMPTS} times, and each time its worker died or was cut off"
                self._fail(job, "interrupted", "Interrupted too often", detail)
                return
            child = self._zygote.start(
                ComputeJob(
                    id=job.id,
                    kind=job.kind,
                    body=job.body,
                    workspace_id=job.workspace_id,
                    database_url=self._database.url,
                )
            )
            try:
                self._follow(job, child)
            except Exception as error:  # noqa: BLE001 - a result that is no JSON, or anything else: the job must end
                _log.exception("job %s (%s) cannot be brought to its end", job.id, job.kind)
                self._internal_error(job, type(error).__name__)
            finally:
                child.kill()

    def _follow(self, job: Job, child: Child) -> None:
        look_at = 0.0
        ended = False
        while not ended:
            if self._stopping.is_set():
                self._give_back(job)
            if time.monotonic() >= look_at:
                look_at = time.monotonic() + _LOOK_INTERVAL
                if not self._write(lambda session: jobs.is_wanted(session, job.id, attempt=job.attempts)):
                    return
            try:
                frame = child.receive(_LOOK_INTERVAL)
            except ChildDied as death:
                self._fail(job, "process-died", "The computation was cut off", str(death))
                return
            ended = frame is not None and self._take(job, frame)

    def _take(self, job: Job, frame: Frame) -> bool:
        """Write down what the child tells; True when it was its last word."""
        match frame:
            case Progress(fraction, message):
                self._write(
                    lambda session: jobs.report(
                        session, job.id, attempt=job.attempts, progress=fraction, message=message or None
                    )
                )
            case Message(text):
                self._write(
                    lambda session: jobs.report(session, job.id, attempt=job.attempts, progress=None, message=text)
                )
            case Done(result):
                self._succeed(job, result)
                return True
            case Refused(problem):
                self._finish_failed(job, problem)
                return True
            case Crashed(kind, traceback):
                _log.error("job %s (%s) failed:\n%s", job.id, job.kind, traceback)
                self._internal_error(job, kind)
                return True
        return False

    def _succeed(self, job: Job, result: Mapping[str, Any]) -> None:
        def keep(session: Session) -> None:
            if not jobs.lock(session, job.id, attempt=job.attempts):
                return
            system = result.get("system")
            system = system if isinstance(system, Mapping) else {}
            versions = result.get("versions")
            row = ResultRepository(session, job.workspace_id).create(
                kind=job.kind,
                body=result,
                request=job.body,
                system_id=system.get("id"),
                system_revision=system.get("revision"),
                versions=versions if isinstance(versions, Mapping) else None,
                within_quota=False,
            )
            jobs.finish(session, job.id, status=JobStatus.SUCCEEDED, attempt=job.attempts, result_id=row.id)

        self._write(keep)

    def _internal_error(self, job: Job, kind: str) -> None:
        detail = f"the computation met an internal error ({kind}); the service's log tells more under {job.id}"
        self._fail(job, "internal", "Internal error", detail)

    def _fail(self, job: Job, slug: str, title: str, detail: str) -> None:
        self._finish_failed(job, {"type": f"urn:servotune:problem:{slug}", "title": title, "detail": detail})

    def _finish_failed(self, job: Job, problem: Document) -> None:
        self._write(
            lambda session: jobs.finish(session, job.id, status=JobStatus.FAILED, attempt=job.attempts, error=problem)
        )

    def _give_back(self, job: Job) -> NoReturn:
        self._write(lambda session: jobs.give_back(session, job.id, attempt=job.attempts))
        raise Stopped

    def _write(self, work: Callable[[Session], Value]) -> Value:
        """Do some work in a transaction; wait for a database that is away, for there is nothing else to do."""
        pause = _PAUSE
        while True:
            try:
                with self._database.session() as session:
                    return work(session)
            except UNAVAILABLE as error:
                if self._stopping.wait(pause):
                    raise Stopped from error
                _log.warning("the database is away: %s", error)
                pause = min(2 * pause, _LONGEST_PAUSE)

    @contextmanager
    def _counted(self) -> Iterator[None]:
        with self._idle:
            self._busy += 1
        try:
            yield
        finally:
            with self._idle:
                self._busy -= 1
                self._idle.notify_all()

    @contextmanager
    def _slot(self) -> Iterator[None]:
        """Wait for a free slot: jobs that the engine recovers come on top of those that its queue hands out."""
        while not self._slots.acquire(timeout=_LOOK_INTERVAL):
            if self._stopping.is_set():
                raise Stopped
        try:
            if self._stopping.is_set():
                raise Stopped
            yield
        finally:
            self._slots.release()
