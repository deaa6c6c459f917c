"""Jobs and their events. Every change of a job goes with the event that tells it.

::

    queued -> running -> succeeded | failed | cancelled
    queued -> cancelled,  running -> queued (given back by a worker that stops)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from storage import quotas
from storage.audit import record
from storage.errors import NotFoundError
from storage.ids import new_id
from storage.imports import abandon
from storage.lineage import remember, sources_in
from storage.models import Job, JobEvent, JobStatus
from storage.models.base import MAX_INTEGER, Document, utc_now
from storage.pagination import Page, paginate
from storage.repositories.webhooks import tell_end

_ALIVE = (JobStatus.QUEUED, JobStatus.RUNNING)


class JobRepository:
    """The jobs of one workspace, as their users see them."""

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def create(self, *, kind: str, body: Document) -> Job:
        """Write down a queued job (`storage.jobs.queue.JobQueue.enqueue` also hands it to the workers).

        Raises
        ------
        QuotaExceededError
            When the workspace has too many unfinished ones.
        """
        quotas.admit_job(self._session, self._workspace_id)
        job = Job(id=new_id("job"), workspace_id=self._workspace_id, kind=kind, body=body, status=JobStatus.QUEUED)
        self._session.add(job)
        self._session.flush()
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
        return paginate(self._session, rows, Job, cursor=cursor, limit=limit)

    def events(self, identifier: str, *, after: int = 0, limit: int = 1000) -> Sequence[JobEvent]:
        """Return the events of a job with ids above ``after``, in order."""
        self.get(identifier)
        rows = select(JobEvent).where(JobEvent.job_id == identifier, JobEvent.id > min(after, MAX_INTEGER))
        return self._session.scalars(rows.order_by(JobEvent.id).limit(limit)).all()

    def cancel(self, identifier: str) -> Job:
        """Mark a job that is not finished as cancelled; whoever computes it stops within a second."""
        self.get(identifier)
        if finish(self._session, identifier, status=JobStatus.CANCELLED):
            record(self._session, self._workspace_id, "job.cancel", identifier)
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


def begin(session: Session, job_id: str, *, worker: str) -> Job | None:
    """Begin (or, after its worker died, begin again) a job; None when there is nothing to do any more."""
    begun = session.scalars(
        update(Job)
        .where(Job.id == job_id, Job.status.in_(_ALIVE))
        .values(status=JobStatus.RUNNING, worker=worker, attempts=Job.attempts + 1, progress=0.0, message="")
        .returning(Job.id)
        .execution_options(synchronize_session=False)
    ).one_or_none()
    if begun is None:
        return None
    job = session.get_one(Job, job_id, populate_existing=True)
    started_at = job.started_at or utc_now()
    payload = {"status": JobStatus.RUNNING, "attempt": job.attempts}
    append_event(session, job_id, "status", payload, started_at=started_at)
    session.refresh(job)
    return job


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
    values: Document = {"status": status, "finished_at": utc_now(), "error": error, "result_id": result_id}
    if status is JobStatus.SUCCEEDED:
        values["progress"] = 1.0
    payload: Document = {"status": status} if error is None else {"status": status, "error": error}
    append_event(session, job_id, "status", payload, **values)
    if status is not JobStatus.SUCCEEDED:
        abandon(session, job_id, error or {"title": "Cancelled", "detail": "the job that read the file was cancelled"})
    tell_end(session, job_id)
    return True


def give_back(session: Session, job_id: str, *, attempt: int) -> None:
    """Return an unfinished job of a worker that stops in good order: that attempt does not count."""
    if lock(session, job_id, attempt=attempt):
        values: Document = {"status": JobStatus.QUEUED, "worker": None, "attempts": Job.attempts - 1}
        append_event(session, job_id, "status", {"status": JobStatus.QUEUED}, **values)


def is_wanted(session: Session, job_id: str, *, attempt: int) -> bool:
    """Tell, without a lock, whether a job is running in the hands of ``attempt``."""
    row = session.execute(select(Job.status, Job.attempts).where(Job.id == job_id)).one()
    return (row.status, row.attempts) == (JobStatus.RUNNING, attempt)


def lock(session: Session, job_id: str, *, attempt: int | None) -> bool:
    """Lock a job's row and tell whether it is unfinished and (still) in the hands of ``attempt``."""
    held = update(Job).where(Job.id == job_id, Job.status.in_(_ALIVE)).values(last_event=Job.last_event)
    if attempt is not None:
        held = held.where(Job.attempts == attempt, Job.status == JobStatus.RUNNING)
    return (
        session.scalars(held.returning(Job.id).execution_options(synchronize_session=False)).one_or_none() is not None
    )
