"""Jobs and their events. Every change of a job goes with the event that tells it.

::

    queued -> running -> succeeded | failed | cancelled
    queued -> cancelled,  running -> queued (given back by a worker that stops, or paused)
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import CursorResult, delete, func, literal_column, select, tuple_, update
from sqlalchemy.orm import Session

from storage import quotas
from storage.audit import ACTOR, record
from storage.clock import shared_now
from storage.errors import NotFoundError, StateError
from storage.ids import new_id
from storage.imports import abandon
from storage.insertion import insert_if_absent
from storage.lineage import remember, sources_in
from storage.models import Job, JobEvent, JobState, JobStatus, JobTally, Priority, Result
from storage.models.base import MAX_INTEGER, Document
from storage.pagination import EVERY, Narrowing, Page, paginate
from storage.repositories.results import ResultRepository
from storage.repositories.webhooks import tell_end

_ALIVE = (JobStatus.QUEUED, JobStatus.RUNNING)


#: Kinds that no worker computes: an agent on a lab PC does them.
DONE_ELSEWHERE = frozenset({"acquisition"})


class JobRepository:
    """The jobs of one workspace, as their users see them."""

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def create(
        self,
        *,
        kind: str,
        body: Document,
        priority: Priority = Priority.NORMAL,
        time_limit: float | None = None,
        deadline: datetime | None = None,
        traceparent: str | None = None,
    ) -> Job:
        """Write down a queued job (`storage.jobs.queue.JobQueue.enqueue` also hands it to the workers).

        Parameters
        ----------
        priority : Priority
            Among the jobs of its workspace.
        time_limit : float, optional
            How long (s) it may take from its start.
        deadline : datetime, optional
            When it must have ended.
        traceparent : str, optional
            The span that asks for it, as W3C's Trace Context writes it.

        Raises
        ------
        QuotaExceededError
            When the workspace has too many unfinished ones.
        """
        quotas.admit_job(self._session, self._workspace_id)
        job = Job(
            id=new_id("job"),
            workspace_id=self._workspace_id,
            kind=kind,
            body=body,
            status=JobStatus.QUEUED,
            priority=priority,
            time_limit=time_limit,
            deadline=deadline,
            request_id=ACTOR.get().request_id,
            traceparent=traceparent,
        )
        self._session.add(job)
        self._session.flush()
        if "request" in body:  # without one it reads a file into its place: nothing is made from anything
            remember(self._session, self._workspace_id, job.id, sources_in(body))
        append_event(self._session, job.id, "status", {"status": JobStatus.QUEUED})
        record(self._session, self._workspace_id, "job.create", job.id, kind=kind)
        self._session.refresh(job)
        return job

    def get(self, identifier: str) -> Job:
        """Return a job as it is now; raise `NotFoundError` when it is not in this workspace."""
        job = self._session.get(Job, identifier, populate_existing=True)
        if job is None or job.workspace_id != self._workspace_id:
            raise NotFoundError("job", identifier)
        return job

    def page(
        self,
        *,
        kind: str | None = None,
        status: str | None = None,
        schedule: str | None = None,
        narrowing: Narrowing = EVERY,
        cursor: str | None = None,
        limit: int = 100,
    ) -> Page[Job]:
        """Return the jobs of the workspace, newest first."""
        rows = select(Job).where(Job.workspace_id == self._workspace_id)
        if kind is not None:
            rows = rows.where(Job.kind == kind)
        if status is not None:
            rows = rows.where(Job.status == status)
        if schedule is not None:
            rows = rows.where(Job.schedule_id == schedule)
        return paginate(self._session, narrowing.of(rows, Job), Job, cursor=cursor, limit=limit)

    def events(self, identifier: str, *, after: int = 0, limit: int = 1000) -> Sequence[JobEvent]:
        """Return the events of a job with ids above ``after``, in order."""
        self.get(identifier)
        rows = select(JobEvent).where(JobEvent.job_id == identifier, JobEvent.id > min(after, MAX_INTEGER))
        return self._session.scalars(rows.order_by(JobEvent.id).limit(limit)).all()

    def cancel(self, identifier: str) -> Job:
        """Mark a job that is not finished as cancelled.

        Whoever computes it stops within a second; a search hands over its best point before, which may take some seconds.
        """
        self.get(identifier)
        if finish(self._session, identifier, status=JobStatus.CANCELLED):
            record(self._session, self._workspace_id, "job.cancel", identifier)
        return self.get(identifier)

    def pause(self, identifier: str) -> Job:
        """Take an unfinished job from whoever computes it and keep it where it is, until it is resumed.

        Raises
        ------
        StateError
            When it has ended.
        """
        job = self.get(identifier)
        if job.kind in DONE_ELSEWHERE:
            raise StateError(f"job {identifier!r} must be one of a worker to be paused, it is an {job.kind}: cancel it")
        if job.paused and not JobStatus(job.status).final:
            return job
        if not lock(self._session, identifier, attempt=None):
            raise StateError(
                f"job {identifier!r} must not have ended to be paused, it is {self.get(identifier).status}"
            )
        hold(self._session, identifier, paused=True)
        record(self._session, self._workspace_id, "job.pause", identifier)
        return self.get(identifier)


def append_event(session: Session, job_id: str, type_: str, payload: Document, **job_values: Any) -> int:
    """Append an event, change the job with it, and return the event's id.

    The update of the job locks its row, so ids have no gaps and become visible in order.
    """
    number = session.scalars(
        update(Job)
        .where(Job.id == job_id)
        .values(last_event=Job.last_event + 1, **job_values)
        .returning(Job.last_event)
        .execution_options(synchronize_session=False)
    ).one()
    session.add(JobEvent(job_id=job_id, id=number, type=type_, payload=payload))
    session.flush()
    return number


def begin(session: Session, job_id: str, *, worker: str, ticket: str | None = None) -> Job | None:
    """Begin (or, after its worker died, begin again) a job; None when ``ticket`` has nothing to do any more.

    A job whose workspace has as many running as it may have is put aside, see `storage.jobs.queue.JobQueue.release`.
    """
    found = session.get(Job, job_id, populate_existing=True)
    if found is None or found.parent_id is not None:  # a part is joined to its whole, see `storage.jobs.requeue.joined`
        return None
    if found.status == JobStatus.QUEUED and not quotas.may_run(session, found.workspace_id):
        if session.scalar(select(Job.id).where(Job.id == job_id, _carried_by(ticket))) is not None:
            hold(session, job_id, paused=False)
        return None
    begun = session.scalars(
        update(Job)
        .where(Job.id == job_id, _carried_by(ticket))
        .values(status=JobStatus.RUNNING, worker=worker, attempts=Job.attempts + 1, message="")
        .returning(Job.id)
        .execution_options(synchronize_session=False)
    ).one_or_none()
    if begun is None:
        return None
    job = session.get_one(Job, job_id, populate_existing=True)
    started_at = job.started_at or shared_now(session)
    payload = {"status": JobStatus.RUNNING, "attempt": job.attempts}
    append_event(session, job_id, "status", payload, started_at=started_at)
    session.refresh(job)
    return job


def _carried_by(ticket: str | None) -> Any:
    """Return the condition that a job is unfinished and that this ticket, of all that it ever had, is the valid one."""
    return Job.status.in_(_ALIVE) & (Job.ticket.is_(None) if ticket is None else Job.ticket == ticket)


def hold(session: Session, job_id: str, *, paused: bool) -> None:
    """Take a job from the workers; the caller has locked it."""
    payload: Document = {"status": JobStatus.QUEUED, **({"paused": True} if paused else {})}
    append_event(
        session, job_id, "status", payload, status=JobStatus.QUEUED, paused=paused, ticket=None, worker=None
    )  # fmt: skip


def keep_state(session: Session, job_id: str, *, attempt: int, state: Document) -> bool:
    """Remember where the computation is; False when this attempt does not have the job any more."""
    if not lock(session, job_id, attempt=attempt):
        return False
    values = {"attempt": attempt, "state": state, "at": shared_now(session)}
    if not insert_if_absent(session, JobState, job_id=job_id, **values):
        session.execute(update(JobState).where(JobState.job_id == job_id).values(**values))
    return True


def state_of(session: Session, job_id: str) -> JobState | None:
    """Return where the computation of a job was last."""
    return session.get(JobState, job_id, populate_existing=True)


def report(session: Session, job_id: str, *, attempt: int, progress: float | None, message: str | None) -> bool:
    """Write down how far a job is; False when this attempt does not have the job any more."""
    if not lock(session, job_id, attempt=attempt):
        return False
    payload: Document = {}
    if progress is not None:
        payload["progress"] = progress
    if message is not None:
        payload["message"] = message
    append_event(session, job_id, "message" if progress is None else "progress", payload, **payload)
    return True


def postpone(session: Session, job_id: str, *, attempt: int, seconds: float) -> Job | None:
    """Count a time for which a job had to wait in its worker (s) as one before its start; None when another attempt has it."""
    if not lock(session, job_id, attempt=attempt):
        return None
    job = session.get_one(Job, job_id, populate_existing=True)
    assert job.started_at is not None
    job.started_at += timedelta(seconds=seconds)
    session.flush()
    return job


def finish(
    session: Session,
    job_id: str,
    *,
    status: JobStatus,
    attempt: int | None = None,
    error: Document | None = None,
    result_id: str | None = None,
) -> bool:
    """Bring a job to its end; False when it had ended before, or ``attempt`` does not have it any more."""
    if not lock(session, job_id, attempt=attempt):
        return False
    now = shared_now(session)
    values: Document = {
        "status": status, "finished_at": now, "error": error, "result_id": result_id, "ticket": None, "paused": False,
    }  # fmt: skip
    if status is JobStatus.SUCCEEDED:
        values["progress"] = 1.0
    payload: Document = {"status": status} if error is None else {"status": status, "error": error}
    append_event(session, job_id, "status", payload, **values)
    if status is not JobStatus.SUCCEEDED:
        abandon(session, job_id, error or {"title": "Cancelled", "detail": "the job that read the file was cancelled"})
    session.execute(delete(JobState).where(JobState.job_id == job_id))
    job = session.get_one(Job, job_id, populate_existing=True)
    tell_end(session, job_id)
    seconds = 0.0 if job.started_at is None else max((now - job.started_at).total_seconds(), 0.0)
    _count(session, job.kind, status, seconds)
    return True


def _count(session: Session, kind: str, status: JobStatus, seconds: float) -> None:
    """Count an ended job; the last row that is locked, because everybody needs it."""
    insert_if_absent(session, JobTally, kind=kind, status=status, count=0, seconds=0.0)
    session.execute(
        update(JobTally)
        .where(JobTally.kind == kind, JobTally.status == status)
        .values(count=JobTally.count + 1, seconds=JobTally.seconds + seconds)
        .execution_options(synchronize_session=False)
    )


def give_back(session: Session, job_id: str, *, attempt: int) -> None:
    """Return an unfinished job of a worker that stops in good order: that attempt does not count."""
    if lock(session, job_id, attempt=attempt):
        values: Document = {"status": JobStatus.QUEUED, "worker": None, "attempts": Job.attempts - 1}
        append_event(session, job_id, "status", {"status": JobStatus.QUEUED}, **values)


def is_wanted(session: Session, job_id: str, *, attempt: int) -> bool:
    """Tell, without a lock, whether a job is running in the hands of ``attempt``."""
    row = session.execute(select(Job.status, Job.attempts).where(Job.id == job_id)).one_or_none()
    return row is not None and (row.status, row.attempts) == (JobStatus.RUNNING, attempt)


def is_cancelled(session: Session, job_id: str, *, attempt: int) -> bool:
    """Tell, without a lock, whether a job was cancelled while ``attempt`` had it."""
    row = session.execute(select(Job.status, Job.attempts).where(Job.id == job_id)).one_or_none()
    return row is not None and (row.status, row.attempts) == (JobStatus.CANCELLED, attempt)


def attach(session: Session, job_id: str, result_id: str) -> None:
    """Give a cancelled job what its computation had until then."""
    session.execute(
        update(Job)
        .where(Job.id == job_id, Job.status == JobStatus.CANCELLED, Job.result_id.is_(None))
        .values(result_id=result_id)
        .execution_options(synchronize_session=False)
    )


def lock(session: Session, job_id: str, *, attempt: int | None) -> bool:
    """Lock a job's row and tell whether it is unfinished and (still) in the hands of ``attempt``."""
    held = update(Job).where(Job.id == job_id, Job.status.in_(_ALIVE)).values(last_event=Job.last_event)
    if attempt is not None:
        held = held.where(Job.attempts == attempt, Job.status == JobStatus.RUNNING)
    return (
        session.scalars(held.returning(Job.id).execution_options(synchronize_session=False)).one_or_none() is not None
    )


def overdue(session: Session, *, limit: int = 100) -> Sequence[str]:
    """Return jobs that wait although the time by which they must have ended is over."""
    rows = select(Job.id).where(Job.status == JobStatus.QUEUED, Job.deadline < shared_now(session))
    return session.scalars(rows.limit(limit)).all()


def forget(session: Session, *, before: datetime, limit: int = 200) -> int:
    """Delete jobs that ended before, with their events and results; return how many, at most ``limit``."""
    rows = select(Job).where(Job.finished_at < before).order_by(Job.finished_at)
    jobs = session.scalars(rows.limit(limit)).all()
    for job in jobs:
        result = None if job.result_id is None else session.get(Result, job.result_id)
        session.delete(job)
        session.flush()
        if result is not None:
            ResultRepository(session, result.workspace_id).delete(result.id)
    return len(jobs)


def forget_events(session: Session, *, before: datetime, limit: int = 1000) -> int:
    """Delete the reports of progress and messages written before, the oldest first; return how many, at most ``limit``.

    What changed a job's status stays as long as the job.
    """
    reports = JobEvent.type != literal_column("'status'")  # in the words of the index, which has no parameter
    old = select(JobEvent.job_id, JobEvent.id).where(reports, JobEvent.at < before).order_by(JobEvent.at).limit(limit)
    gone = session.execute(
        delete(JobEvent)
        .where(tuple_(JobEvent.job_id, JobEvent.id).in_(old))
        .execution_options(synchronize_session=False)
    )
    assert isinstance(gone, CursorResult)
    return gone.rowcount


def waiting(session: Session) -> Sequence[tuple[str, str, int, datetime]]:
    """Return (kind, status, number, the oldest one's time) of the unfinished jobs."""
    rows = select(Job.kind, Job.status, func.count(), func.min(Job.created_at)).where(Job.status.in_(_ALIVE))
    return [
        (kind, status, count, oldest)
        for kind, status, count, oldest in session.execute(rows.group_by(Job.kind, Job.status))
    ]


def tallies(session: Session) -> Sequence[JobTally]:
    """Return how many jobs of each kind have ever ended how, and after how long."""
    return session.scalars(select(JobTally).order_by(JobTally.kind, JobTally.status)).all()
