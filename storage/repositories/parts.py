"""Parts of a job: jobs that no user sees, computed by any worker, whose results the job puts together.

A part belongs to its parent's workspace and goes with it: whatever ends the parent deletes its parts and their results.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import delete, func, select, update
from sqlalchemy.orm import Session

from storage.ids import new_id
from storage.models import Job, JobEvent, JobStatus, Result
from storage.models.base import Document, utc_now
from storage.repositories.results import ResultRepository

#: Where a parent keeps what it knew when it was cut.
KNOWN = -1

_ALIVE = (JobStatus.QUEUED, JobStatus.RUNNING)


def create(session: Session, parent: Job, documents: Sequence[Document], known: Mapping[str, Any] | None) -> list[Job]:
    """Cut a job, which the caller has locked, into parts; parts that it had are deleted.

    Parameters
    ----------
    documents : sequence of dict
        What each part is to do: put into the parent's body under ``part``.
    known : mapping, optional
        What the parent wants back with the results of its parts.
    """
    drop(session, parent.id)
    rows = [_row(parent, number, {**parent.body, "part": document}) for number, document in enumerate(documents)]
    if known is not None:
        result = ResultRepository(session, parent.workspace_id).create(kind=parent.kind, body=known, within_quota=False)
        keeper = _row(parent, KNOWN, {})
        keeper.status, keeper.result_id, keeper.finished_at = JobStatus.SUCCEEDED, result.id, utc_now()
        session.add(keeper)
    session.add_all(rows)
    session.flush()
    return rows


def _row(parent: Job, number: int, body: Document) -> Job:
    return Job(
        id=new_id("job"),
        workspace_id=parent.workspace_id,
        kind=parent.kind,
        body=body,
        status=JobStatus.QUEUED,
        priority=parent.priority,
        deadline=parent.deadline,
        parent_id=parent.id,
        part=number,
        request_id=parent.request_id,
        traceparent=parent.traceparent,
    )


def results(session: Session, parent: Job) -> dict[int, Document]:
    """Return what the parts found, by their numbers; nothing for a job without parts."""
    repository = ResultRepository(session, parent.workspace_id)
    rows = session.execute(
        select(Job.part, Job.result_id).where(Job.parent_id == parent.id, Job.status == JobStatus.SUCCEEDED)
    )
    return {
        number: repository.body(repository.get(result))
        for number, result in rows.all()
        if number is not None and result is not None
    }


def progress(session: Session, parent_id: str) -> tuple[int, float]:
    """Return how many parts are unfinished, and the mean progress of all."""
    mean, alive = session.execute(
        select(func.avg(Job.progress), func.count().filter(Job.status.in_(_ALIVE))).where(
            Job.parent_id == parent_id, Job.part > KNOWN
        )
    ).one()
    return int(alive), float(mean or 0.0)


def pause(session: Session, parent_id: str) -> None:
    """Take the unfinished parts of a job, which the caller has locked, from the workers."""
    session.execute(
        update(Job)
        .where(Job.parent_id == parent_id, Job.status.in_(_ALIVE))
        .values(status=JobStatus.QUEUED, paused=True, ticket=None, worker=None)
        .execution_options(synchronize_session=False)
    )


def unfinished(session: Session, parent_id: str) -> Sequence[Job]:
    """Return the parts of a job that have not ended."""
    rows = select(Job).where(Job.parent_id == parent_id, Job.status.in_(_ALIVE)).order_by(Job.part)
    return session.scalars(rows.execution_options(populate_existing=True)).all()


def drop(session: Session, parent_id: str) -> None:
    """Delete the parts of a job, which the caller has locked; whoever computes one finds that out."""
    rows = session.execute(select(Job.id, Job.result_id).where(Job.parent_id == parent_id)).all()
    if not rows:
        return
    session.execute(delete(JobEvent).where(JobEvent.job_id.in_([row.id for row in rows])))
    session.execute(delete(Job).where(Job.parent_id == parent_id).execution_options(synchronize_session=False))
    for row in rows:
        result = None if row.result_id is None else session.get(Result, row.result_id)
        if result is not None:
            discard(session, result)


def discard(session: Session, result: Result) -> None:
    """Delete a result that no job names any more."""
    ResultRepository(session, result.workspace_id).delete(result.id)
