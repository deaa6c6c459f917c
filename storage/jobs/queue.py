"""Asks for long work: a job and its place in the queue are written in one transaction.

The queue has a partition for each workspace. A worker with a free slot asks the partitions in random order and takes the
first job, by priority and then by age, of the first one that has any: a workspace with ten thousand jobs gets no more than
its share, and one with a single job does not wait for them.
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime

from dbos import DBOSClient
from sqlalchemy import select, update
from sqlalchemy.orm import Session

from storage import quotas
from storage.audit import record
from storage.errors import StateError
from storage.jobs.bell import ring
from storage.jobs.engine import APPLICATION, QUEUE, SERIALIZER, WORKFLOW
from storage.models import Job, JobStatus, Priority, Workspace
from storage.models.base import Document
from storage.repositories.jobs import DONE_ELSEWHERE, JobRepository, append_event
from storage.session import Database

#: The most jobs that are given back to the workers at once.
_MOST_RELEASED = 1000


class JobQueue:
    """The asking side; one for each process, on a migrated database.

    There is no ``cancel`` here: `JobRepository.cancel` marks the job, and whoever computes it sees that.
    """

    def __init__(self, database: Database) -> None:
        self._client = DBOSClient(
            system_database_engine=database.engine,
            serializer=SERIALIZER,
            application_name=APPLICATION,
            lazy=True,
            retry_connection_errors=False,
        )

    def enqueue(
        self,
        session: Session,
        *,
        kind: str,
        body: Document,
        workspace_id: str,
        priority: Priority = Priority.NORMAL,
        time_limit: float | None = None,
        deadline: datetime | None = None,
        traceparent: str | None = None,
    ) -> Job:
        """Write a job and its place in the queue; both exist when the caller's transaction commits, or neither."""
        job = JobRepository(session, workspace_id).create(
            kind=kind,
            body=body,
            priority=priority,
            time_limit=time_limit,
            deadline=deadline,
            traceparent=traceparent,
        )
        self.carry(session, [job])
        session.refresh(job)
        return job

    def carry(self, session: Session, jobs: Iterable[Job]) -> None:
        """Hand jobs to the workers, each with a ticket that makes every earlier one of its worthless."""
        for job in jobs:
            job.ticket = job.id if job.round == 0 else f"{job.id}.{job.round}"
            job.round += 1
            self._client.enqueue_in_transaction(
                session,
                {
                    "workflow_name": WORKFLOW,
                    "queue_name": QUEUE,
                    "workflow_id": job.ticket,
                    "priority": job.priority,
                    "queue_partition_key": job.workspace_id,
                },
                job.id,
            )
            ring(session)
        session.flush()

    def place(self, session: Session, job_id: str) -> None:
        """Give an unfinished job of another database its place in the queue of this one."""
        job = session.get_one(Job, job_id)
        if job.ticket is not None:
            self.carry(session, [job])

    def resume(self, session: Session, workspace_id: str, identifier: str) -> Job:
        """Let a paused job go on from where it was; one that is not paused stays as it is.

        Raises
        ------
        StateError
            When it has ended.
        """
        jobs = JobRepository(session, workspace_id)
        job = jobs.get(identifier)
        if JobStatus(job.status).final:
            raise StateError(f"job {identifier!r} must not have ended to be resumed, it is {job.status}")
        if not job.paused:
            return job
        append_event(session, identifier, "status", {"status": JobStatus.QUEUED}, paused=False, status=JobStatus.QUEUED)
        session.refresh(job)
        self.carry(session, [job])
        record(session, workspace_id, "job.resume", identifier)
        session.refresh(job)
        return job

    def release(self, session: Session, workspace_id: str | None = None) -> int:
        """Hand jobs that were put aside to the workers, as many as their workspaces have room for; return how many."""
        rows = select(Job).where(Job.status == JobStatus.QUEUED, Job.ticket.is_(None), Job.paused.is_(False))
        rows = rows.where(Job.kind.not_in(DONE_ELSEWHERE))
        if workspace_id is not None:
            rows = rows.where(Job.workspace_id == workspace_id)
        aside = session.scalars(rows.order_by(Job.priority, Job.created_at, Job.id).limit(_MOST_RELEASED)).all()
        if not aside:
            return 0
        room = {
            workspace.id: quotas.limits_of(workspace)["running_jobs"] - quotas.running_jobs(session, workspace.id)
            for workspace in session.scalars(
                select(Workspace).where(Workspace.id.in_({job.workspace_id for job in aside}))
            )
        }
        free = []
        for job in aside:
            if room[job.workspace_id] > 0:
                room[job.workspace_id] -= 1
                free.append(job)
        # Two workers may look at once: who locks the row first hands it out.
        free = [job for job in free if _lock_aside(session, job)]
        self.carry(session, free)
        return len(free)

    def forget(self, *, before: datetime, limit: int = 1000) -> int:
        """Delete what the engine remembers of workflows that have ended; return how many, at most ``limit``."""
        ended = self._client.list_workflows(
            status=["SUCCESS", "ERROR", "CANCELLED"],
            queue_name=QUEUE,
            completed_before=before.isoformat(),
            limit=limit,
            load_input=False,
            load_output=False,
        )
        if ended:
            self._client.delete_workflows([workflow.workflow_id for workflow in ended])
        return len(ended)

    def close(self) -> None:
        """Let go of the job engine; the database stays open."""
        self._client.destroy()


def _lock_aside(session: Session, job: Job) -> bool:
    locked = session.scalars(
        update(Job)
        .where(Job.id == job.id, Job.status == JobStatus.QUEUED, Job.ticket.is_(None), Job.paused.is_(False))
        .values(last_event=Job.last_event)
        .returning(Job.id)
        .execution_options(synchronize_session=False)
    ).one_or_none()
    if locked is not None:
        session.refresh(job)
    return locked is not None
