"""Sees one job through: a child computes it, the job's row tells how far it is and how it ended."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import Any, NoReturn, TypeVar

from sqlalchemy.orm import Session

from storage.clock import shared_now
from storage.errors import UNAVAILABLE
from storage.jobs.children import Child, ChildDied, Zygote
from storage.jobs.compute import (
    ASKED_BY,
    CURRENT_JOB,
    ComputeJob,
    Crashed,
    Done,
    Frame,
    Kept,
    Listening,
    Message,
    Parts,
    Progress,
    Refused,
)
from storage.jobs.queue import JobQueue
from storage.models import Job, JobState, JobStatus
from storage.models.base import Document
from storage.repositories import jobs, parts
from storage.repositories.results import ResultRepository
from storage.session import Database

#: How often a job may begin without getting further: a third worker that dies with it has had enough.
MAX_ATTEMPTS = 3
#: How often (s) a part tells its parent how far it is.
_PART_INTERVAL = 1.0
#: How often (s) a running job is asked whether it is still wanted.
_LOOK_INTERVAL = 0.2
#: How long (s) a cancelled computation that listens may take to hand over what it has.
_LAST_WORD = 20.0
#: The pauses (s) between two tries to write while the database is away, and the longest of them.
_PAUSE, _LONGEST_PAUSE = 0.5, 5.0

_log = logging.getLogger(__name__)

Value = TypeVar("Value")

Traced = Callable[[Job], AbstractContextManager[Callable[[str], None]]]
"""What surrounds one attempt at a job for whoever collects traces; takes the status in which the attempt leaves it."""


def untraced(_: Job) -> AbstractContextManager[Callable[[str], None]]:
    """Surround an attempt with nothing."""
    return nullcontext(lambda _status: None)


class Stopped(BaseException):
    """The worker stops: the job engine must keep the job for the next one, so this is no outcome of the job."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Begun:
    """A job in the hands of this worker: what is computed, and how much time (s) it has."""

    job: Job
    state: JobState | None
    parts: Mapping[int, Document]
    seconds: float | None

    @property
    def hopeless(self) -> bool:
        """Whether it was begun too often since it last got further."""
        return self.job.attempts - (0 if self.state is None else self.state.attempt) > MAX_ATTEMPTS


class Supervisor:
    """Does the jobs that the engine hands to this worker, at most ``slots`` at a time."""

    def __init__(
        self, database: Database, queue: JobQueue, zygote: Zygote, *, worker: str, slots: int, traced: Traced
    ) -> None:
        self._database = database
        self._queue = queue
        self._zygote = zygote
        self._worker = worker
        self._traced = traced
        self._slots = threading.Semaphore(slots)
        self._stopping = threading.Event()
        self._idle = threading.Condition()
        self._tickets: list[str] = []
        self._told: dict[str, float] = {}

    def stop(self, timeout: float) -> None:
        """Kill every child, give the jobs back, and wait until that is done."""
        self._stopping.set()
        with self._idle:
            self._idle.wait_for(lambda: not self._tickets, timeout)

    @property
    def in_hand(self) -> frozenset[str]:
        """The tickets of the jobs that this worker does, or will do with its next free slot."""
        with self._idle:
            return frozenset(self._tickets)

    def run(self, job_id: str, ticket: str) -> None:
        """Do one job, or find that there is nothing to do any more.

        Raises
        ------
        Stopped
            When the worker stops first.
        """
        with self._held(ticket), _set(CURRENT_JOB, job_id), self._slot():
            begun = self._write(lambda session: self._begin(session, job_id, ticket))
            if begun is None:
                return
            job = begun.job
            with _set(ASKED_BY, job.request_id), self._traced(job) as tell:
                _log.info("job %s (%s) begins, attempt %d", job.id, job.kind, job.attempts)
                self._attempt(begun)
                tell(self._write(lambda session: self._let_go(session, job)))
                _log.info("job %s (%s) has been let go", job.id, job.kind)

    def _attempt(self, begun: _Begun) -> None:
        job = begun.job
        if begun.hopeless:
            detail = f"the job was begun {MAX_ATTEMPTS} times, and each time its worker died or was cut off"
            self._fail(job, "interrupted", "Interrupted too often", detail)
            return
        warm = self._warm(begun)
        if warm is None:
            return
        child = self._zygote.start(
            ComputeJob(
                id=job.id,
                kind=job.kind,
                body=job.body,
                workspace_id=job.workspace_id,
                database_url=self._database.url,
                state=None if warm.state is None else warm.state.state,
                parts=warm.parts,
                request_id=job.request_id,
                seconds=warm.seconds,
            )
        )
        try:
            self._follow(warm, child)
        except Exception as error:  # noqa: BLE001 - a result that is no JSON, or anything else: the job must end
            _log.exception("job %s (%s) cannot be brought to its end", job.id, job.kind)
            self._internal_error(job, type(error).__name__)
        finally:
            child.kill()
            self._told.pop(job.id, None)

    def _let_go(self, session: Session, job: Job) -> str:
        """Give what was put aside its turn; return the status in which the job is left."""
        self._queue.release(session, job.workspace_id)
        left = session.get(Job, job.id, populate_existing=True)
        return "deleted" if left is None else left.status

    def _begin(self, session: Session, job_id: str, ticket: str) -> _Begun | None:
        job = jobs.begin(session, job_id, worker=self._worker, ticket=ticket)
        if job is None:
            return None
        return _Begun(
            job=job,
            state=jobs.state_of(session, job_id),
            parts=parts.results(session, job),
            seconds=_time_left(job, now=shared_now(session)),
        )

    def _warm(self, begun: _Begun) -> _Begun | None:
        """Wait until the kernels are there, which is no time of the job's; None when it is not wanted any more."""
        job, since = begun.job, time.monotonic()
        if self._zygote.settled(0.0):
            return begun
        while not self._zygote.settled(_LOOK_INTERVAL):
            if self._stopping.is_set():
                self._give_back(job)
            if not self._write(lambda session: jobs.is_wanted(session, job.id, attempt=job.attempts)):
                return None
        waited = time.monotonic() - since

        def postpone(session: Session) -> _Begun | None:
            later = jobs.postpone(session, job.id, attempt=job.attempts, seconds=waited)
            if later is None:
                return None
            return replace(begun, job=later, seconds=_time_left(later, now=shared_now(session)))

        return self._write(postpone)

    def _follow(self, begun: _Begun, child: Child) -> None:
        job, look_at = begun.job, 0.0
        # What is left is measured by a clock that nobody sets.
        ends_at = None if begun.seconds is None else time.monotonic() + begun.seconds
        ended = listens = False
        while not ended:
            if self._stopping.is_set():
                self._give_back(job)
            if ends_at is not None and time.monotonic() >= ends_at:
                self._fail(job, "overdue", "Out of time", overdue_detail(job))
                return
            if time.monotonic() >= look_at:
                look_at = time.monotonic() + _LOOK_INTERVAL
                if not self._write(lambda session: jobs.is_wanted(session, job.id, attempt=job.attempts)):
                    if listens:
                        self._hear_out(job, child)
                    return
            try:
                frame = child.receive(_LOOK_INTERVAL)
            except ChildDied as death:
                self._fail(job, "process-died", "The computation was cut off", str(death))
                return
            listens = listens or isinstance(frame, Listening)
            ended = frame is not None and self._take(job, frame)

    def _hear_out(self, job: Job, child: Child) -> None:
        """Keep what a cancelled computation has, if it hands that over in time."""
        if not self._write(lambda session: jobs.is_cancelled(session, job.id, attempt=job.attempts)):
            return
        child.end()
        until = time.monotonic() + _LAST_WORD
        while time.monotonic() < until and not self._stopping.is_set():
            try:
                frame = child.receive(_LOOK_INTERVAL)
            except ChildDied:
                return
            if isinstance(frame, Refused | Crashed):
                return
            if isinstance(frame, Done):
                if not isinstance(frame.result, Parts):
                    self._keep_best(job, frame.result)
                return

    def _keep_best(self, job: Job, result: Mapping[str, Any]) -> None:
        def keep(session: Session) -> None:
            if jobs.is_cancelled(session, job.id, attempt=job.attempts):
                jobs.attach(session, job.id, self._result(session, job, result))

        self._write(keep)

    def _take(self, job: Job, frame: Frame) -> bool:
        """Write down what the child tells; True when it was its last word."""
        match frame:
            case Progress(fraction, message):
                if job.parent_id is None:
                    self._report(job, fraction, message or None)
                else:
                    self._report_part(job, job.parent_id, fraction)
            case Message(text):
                if job.parent_id is None:  # of a part nobody reads the lines
                    self._report(job, None, text)
            case Kept(state):
                self._write(lambda session: jobs.keep_state(session, job.id, attempt=job.attempts, state=state))
            case Done(result):
                if isinstance(result, Parts):
                    self._cut(job, result)
                else:
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

    def _report(self, job: Job, progress: float | None, message: str | None) -> None:
        self._write(
            lambda session: jobs.report(session, job.id, attempt=job.attempts, progress=progress, message=message)
        )

    def _report_part(self, job: Job, parent_id: str, fraction: float) -> None:
        """Let the parent's progress be the mean of its parts', now and then."""
        now = time.monotonic()
        if now < self._told.get(job.id, 0.0):
            return
        self._told[job.id] = now + _PART_INTERVAL

        def tell(session: Session) -> None:
            if jobs.lock(session, parent_id, attempt=None) and jobs.lock(session, job.id, attempt=job.attempts):
                jobs.set_progress(session, job.id, fraction)
                _, mean = parts.progress(session, parent_id)
                jobs.append_event(session, parent_id, "progress", {"progress": mean}, progress=mean)

        self._write(tell)

    def _cut(self, job: Job, wanted: Parts) -> None:
        """Put the parts of a job into the queue; the last of them to end brings the job back there."""

        def cut(session: Session) -> None:
            if jobs.lock(session, job.id, attempt=job.attempts):
                rows = parts.create(session, _with_deadline(session, job), wanted.documents, wanted.known)
                text = f"cut into {len(rows)} parts"
                jobs.append_event(session, job.id, "message", {"message": text}, message=text, ticket=None, worker=None)
                self._queue.carry(session, rows)

        self._write(cut)

    def _succeed(self, job: Job, result: Mapping[str, Any]) -> None:
        def keep(session: Session) -> None:
            parent = job.parent_id
            if parent is not None and not jobs.lock(session, parent, attempt=None):
                return
            if not jobs.lock(session, job.id, attempt=job.attempts):
                return
            kept = self._result(session, job, result)
            jobs.finish(session, job.id, status=JobStatus.SUCCEEDED, attempt=job.attempts, result_id=kept)
            if parent is None:
                return
            left, mean = parts.progress(session, parent)
            if left == 0:
                self._queue.carry(session, [session.get_one(Job, parent, populate_existing=True)])
            else:  # a part may be over before it has told anything
                jobs.append_event(session, parent, "progress", {"progress": mean}, progress=mean)

        self._write(keep)

    def _result(self, session: Session, job: Job, result: Mapping[str, Any]) -> str:
        """Store a result and return its id."""
        system = result.get("system")
        system = system if isinstance(system, Mapping) else {}
        versions = result.get("versions")
        row = ResultRepository(session, job.workspace_id).create(
            kind=job.kind,
            body=result,
            request=job.body if job.parent_id is None else None,
            system_id=system.get("id"),
            system_revision=system.get("revision"),
            versions=versions if isinstance(versions, Mapping) else None,
            within_quota=False,
        )
        return row.id

    def _internal_error(self, job: Job, kind: str) -> None:
        detail = f"the computation met an internal error ({kind}); the service's log tells more under {job.id}"
        self._fail(job, "internal", "Internal error", detail)

    def _fail(self, job: Job, slug: str, title: str, detail: str) -> None:
        self._finish_failed(job, {"type": f"urn:servotune:problem:{slug}", "title": title, "detail": detail})

    def _finish_failed(self, job: Job, problem: Document) -> None:
        def fail(session: Session) -> None:
            if job.parent_id is None:
                jobs.finish(session, job.id, status=JobStatus.FAILED, attempt=job.attempts, error=problem)
            elif jobs.lock(session, job.parent_id, attempt=None) and jobs.lock(session, job.id, attempt=job.attempts):
                # The whole fails with its part, and takes all the others with it.
                jobs.finish(session, job.parent_id, status=JobStatus.FAILED, error=problem)

        self._write(fail)

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
    def _held(self, ticket: str) -> Iterator[None]:
        with self._idle:
            self._tickets.append(ticket)
        try:
            yield
        finally:
            with self._idle:
                self._tickets.remove(ticket)
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


@contextmanager
def _set(variable: ContextVar[str | None], value: str | None) -> Iterator[None]:
    """Let what is logged meanwhile say which job it is about, and who asked for it."""
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


def overdue_detail(job: Job) -> str:
    """Return the sentence for a job that did not end in time."""
    if job.time_limit is not None and (job.deadline is None or _limit_ends_first(job)):
        return f"the job must be computed within its time_limit of {job.time_limit:g} s, got one that needs longer"
    return f"the job must end before its deadline {job.deadline}, got one that does not"


def _limit_ends_first(job: Job) -> bool:
    assert job.time_limit is not None
    assert job.deadline is not None
    return job.started_at is not None and job.started_at + timedelta(seconds=job.time_limit) < job.deadline


def _time_left(job: Job, *, now: datetime) -> float | None:
    """Return how long (s) a job that has begun may still take; None without an end."""
    ends = []
    if job.time_limit is not None:
        assert job.started_at is not None
        ends.append(job.time_limit - (now - job.started_at).total_seconds())
    if job.deadline is not None:
        ends.append((job.deadline - now).total_seconds())
    return min(ends) if ends else None


def _with_deadline(session: Session, job: Job) -> Job:
    """Return the present row of a job that is cut, its parts' deadline in it."""
    row = session.get_one(Job, job.id, populate_existing=True)
    now = shared_now(session)
    left = _time_left(row, now=now)
    if left is not None:
        row.deadline = now + timedelta(seconds=left)
    return row
