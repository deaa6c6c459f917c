"""Sees one job through: a child computes it, the job's row tells how far it is and how it ended."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass, replace

from sqlalchemy.orm import Session

from storage.clock import shared_now
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
    Progress,
    Refused,
)
from storage.jobs.outcomes import Outcomes, Stopped
from storage.jobs.queue import JobQueue
from storage.jobs.time_limits import overdue_detail, time_left
from storage.models import Job, JobState
from storage.repositories import jobs
from storage.session import Database

#: How often a job may begin without getting further: a third worker that dies with it has had enough.
MAX_ATTEMPTS = 3
#: How often (s) a running job is asked whether it is still wanted.
_LOOK_INTERVAL = 0.2
#: How long (s) a cancelled computation that listens may take to hand over what it has.
_LAST_WORD = 20.0

_log = logging.getLogger(__name__)

Traced = Callable[[Job], AbstractContextManager[Callable[[str], None]]]
"""What surrounds one attempt at a job for whoever collects traces; takes the status in which the attempt leaves it."""


def untraced(_: Job) -> AbstractContextManager[Callable[[str], None]]:
    """Surround an attempt with nothing."""
    return nullcontext(lambda _status: None)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Begun:
    """A job in the hands of this worker: what is computed, and how much time (s) it has."""

    job: Job
    state: JobState | None
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
        self._zygote = zygote
        self._worker = worker
        self._traced = traced
        self._slots = threading.Semaphore(slots)
        self._stopping = threading.Event()
        self._idle = threading.Condition()
        self._tickets: list[str] = []
        self._outcomes = Outcomes(database, queue, self._stopping)

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
            begun = self._outcomes.write(lambda session: self._begin(session, job_id, ticket))
            if begun is None:
                return
            job = begun.job
            with _set(ASKED_BY, job.request_id), self._traced(job) as tell:
                _log.info("job %s (%s) begins, attempt %d", job.id, job.kind, job.attempts)
                self._attempt(begun)
                tell(self._outcomes.let_go(job))
                _log.info("job %s (%s) has been let go", job.id, job.kind)

    def _attempt(self, begun: _Begun) -> None:
        job = begun.job
        if begun.hopeless:
            detail = f"the job was begun {MAX_ATTEMPTS} times, and each time its worker died or was cut off"
            self._outcomes.fail(job, "interrupted", "Interrupted too often", detail)
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
                request_id=job.request_id,
                seconds=warm.seconds,
            )
        )
        try:
            self._follow(warm, child)
        except Exception as error:  # noqa: BLE001 - a result that is no JSON, or anything else: the job must end
            _log.exception("job %s (%s) cannot be brought to its end", job.id, job.kind)
            self._outcomes.internal_error(job, type(error).__name__)
        finally:
            child.kill()

    def _begin(self, session: Session, job_id: str, ticket: str) -> _Begun | None:
        job = jobs.begin(session, job_id, worker=self._worker, ticket=ticket)
        if job is None:
            return None
        return _Begun(
            job=job,
            state=jobs.state_of(session, job_id),
            seconds=time_left(job, now=shared_now(session)),
        )

    def _warm(self, begun: _Begun) -> _Begun | None:
        """Wait until the kernels are there, which is no time of the job's; None when it is not wanted any more."""
        job, since = begun.job, time.monotonic()
        if self._zygote.settled(0.0):
            return begun
        while not self._zygote.settled(_LOOK_INTERVAL):
            if self._stopping.is_set():
                self._outcomes.give_back(job)
            if not self._outcomes.write(lambda session: jobs.is_wanted(session, job.id, attempt=job.attempts)):
                return None
        waited = time.monotonic() - since

        def postpone(session: Session) -> _Begun | None:
            later = jobs.postpone(session, job.id, attempt=job.attempts, seconds=waited)
            if later is None:
                return None
            return replace(begun, job=later, seconds=time_left(later, now=shared_now(session)))

        return self._outcomes.write(postpone)

    def _follow(self, begun: _Begun, child: Child) -> None:
        job, look_at = begun.job, 0.0
        # What is left is measured by a clock that nobody sets.
        ends_at = None if begun.seconds is None else time.monotonic() + begun.seconds
        ended = listens = False
        while not ended:
            if self._stopping.is_set():
                self._outcomes.give_back(job)
            if ends_at is not None and time.monotonic() >= ends_at:
                self._outcomes.fail(job, "overdue", "Out of time", overdue_detail(job))
                return
            if time.monotonic() >= look_at:
                look_at = time.monotonic() + _LOOK_INTERVAL
                if not self._outcomes.write(lambda session: jobs.is_wanted(session, job.id, attempt=job.attempts)):
                    if listens:
                        self._hear_out(job, child)
                    return
            try:
                frame = child.receive(_LOOK_INTERVAL)
            except ChildDied as death:
                self._outcomes.fail(job, "process-died", "The computation was cut off", str(death))
                return
            listens = listens or isinstance(frame, Listening)
            ended = frame is not None and self._take(job, frame)

    def _hear_out(self, job: Job, child: Child) -> None:
        """Keep what a cancelled computation has, if it hands that over in time."""
        if not self._outcomes.write(lambda session: jobs.is_cancelled(session, job.id, attempt=job.attempts)):
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
                self._outcomes.keep_best(job, frame.result)
                return

    def _take(self, job: Job, frame: Frame) -> bool:
        """Write down what the child tells; True when it was its last word."""
        match frame:
            case Progress(fraction, message):
                self._outcomes.progress(job, fraction, message or None)
            case Message(text):
                self._outcomes.message(job, text)
            case Kept(state):
                self._outcomes.keep_state(job, state)
            case Done(result):
                self._outcomes.succeed(job, result)
                return True
            case Refused(problem):
                self._outcomes.refuse(job, problem)
                return True
            case Crashed(kind, traceback):
                _log.error("job %s (%s) failed:\n%s", job.id, job.kind, traceback)
                self._outcomes.internal_error(job, kind)
                return True
        return False

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
