"""Finds what the job engine does not carry although it should: jobs without a workflow, workflows of workers that nobody knows.

Neither happens by itself. A database restored from a backup, moved to another server or brought up from an earlier version
has both, and so has one whose engine gave a job up. What it claimed and never began is told by `storage.jobs.claims`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from sqlalchemy import Column, MetaData, String, Table, exists, select, update
from sqlalchemy.orm import Session

from storage.jobs.engine import QUEUE
from storage.models import Job, JobStatus, Worker

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
