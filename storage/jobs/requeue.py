"""Finds what the job engine does not carry although it should: jobs without a workflow, workflows of nobody's, jobs that were cut.

None happens by itself. A database restored from a backup, moved to another server or brought up from an earlier version
has the first two, and so has one whose engine gave a job up; earlier versions cut large jobs into parts. What it claimed and never began is told by `storage.jobs.claims`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from sqlalchemy import Column, MetaData, String, Table, exists, select, update
from sqlalchemy.orm import Session

from storage.jobs.engine import QUEUE
from storage.models import Job, JobStatus, Worker
from storage.repositories import jobs
from storage.repositories.results import ResultRepository

_CARRIED = ("ENQUEUED", "PENDING", "DELAYED")
_UNFINISHED = (JobStatus.QUEUED, JobStatus.RUNNING)
_MOST = 1000


def _workflows(session: Session) -> Table:
    """Return the part of the job engine's table that is read here."""
    schema = None if session.get_bind().dialect.name == "sqlite" else "dbos"
    columns = (Column(name, String) for name in ("workflow_uuid", "status", "executor_id", "queue_name"))
    return Table("workflow_status", MetaData(), *columns, schema=schema)


def uncarried(session: Session) -> Sequence[Job]:
    """Return unfinished jobs whose ticket is no workflow that somebody will run, locked."""
    workflows = _workflows(session)
    carried = exists(
        select(workflows.c.workflow_uuid).where(
            workflows.c.workflow_uuid == Job.ticket,
            workflows.c.status.in_(_CARRIED),
            workflows.c.queue_name == QUEUE,
        )
    )
    rows = (
        update(Job)
        .where(Job.status.in_(_UNFINISHED), Job.ticket.is_not(None), ~carried)
        .values(last_event=Job.last_event, round=Job.round + 1)
        .returning(Job.id)
        .execution_options(synchronize_session=False)
    )
    found = session.scalars(rows).all()[:_MOST]
    return session.scalars(select(Job).where(Job.id.in_(found)).execution_options(populate_existing=True)).all()


def strangers(session: Session) -> Sequence[str]:
    """Return executors that have begun workflows and are no workers."""
    workflows = _workflows(session)
    known = exists(select(Worker.id).where(Worker.id == workflows.c.executor_id))
    rows = select(workflows.c.executor_id).where(
        workflows.c.status == "PENDING", workflows.c.queue_name == QUEUE, ~known
    )
    return session.scalars(rows.distinct()).all()


def claimed(session: Session, worker: str) -> Sequence[str]:
    """Return the valid tickets of unfinished jobs that the engine has claimed for a worker."""
    workflows = _workflows(session)
    rows = select(workflows.c.workflow_uuid).where(
        workflows.c.status == "PENDING",
        workflows.c.executor_id == worker,
        workflows.c.queue_name == QUEUE,
        exists(select(Job.id).where(Job.ticket == workflows.c.workflow_uuid, Job.status.in_(_UNFINISHED))),
    )
    return session.scalars(rows).all()


def holders(session: Session, tickets: Collection[str]) -> Sequence[Job]:
    """Return the unfinished jobs that have these tickets, locked."""
    rows = (
        update(Job)
        .where(Job.ticket.in_(tickets), Job.status.in_(_UNFINISHED))
        .values(last_event=Job.last_event)
        .returning(Job.id)
        .execution_options(synchronize_session=False)
    )
    found = session.scalars(rows).all()
    return session.scalars(select(Job).where(Job.id.in_(found)).execution_options(populate_existing=True)).all()


def joined(session: Session) -> Sequence[str]:
    """Delete the parts into which an earlier version has cut jobs, and put these aside, whole, for the next release; return which.

    Such a version may still cut some while it serves beside this one.
    """
    parts = session.scalars(select(Job).where(Job.parent_id.is_not(None))).all()
    whole = sorted({str(part.parent_id) for part in parts})
    for identifier in whole:
        if jobs.lock(session, identifier, attempt=None) and not session.get_one(Job, identifier).paused:
            jobs.hold(session, identifier, paused=False)
    for part in parts:
        session.delete(part)
    session.flush()
    for part in parts:
        if part.result_id is not None:
            ResultRepository(session, part.workspace_id).delete(part.result_id)
    return whole
