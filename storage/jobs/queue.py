"""Asks for long work: a job and its place in the queue are written in one transaction."""

from __future__ import annotations

from dbos import DBOSClient
from sqlalchemy.orm import Session

from storage.jobs.engine import APPLICATION, QUEUE, SERIALIZER, WORKFLOW
from storage.models import Job
from storage.models.base import Document
from storage.repositories.jobs import JobRepository
from storage.session import Database


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

    def enqueue(self, session: Session, *, kind: str, body: Document, workspace_id: str) -> Job:
        """Write a job and its place in the queue; both exist when the caller's transaction commits, or neither."""
        job = JobRepository(session, workspace_id).create(kind=kind, body=body)
        self.place(session, job.id)
        return job

    def place(self, session: Session, job_id: str) -> None:
        """Give a job its place in the queue, which it has not got yet; it exists when the caller's transaction commits."""
        self._client.enqueue_in_transaction(
            session, {"workflow_name": WORKFLOW, "queue_name": QUEUE, "workflow_id": job_id}, job_id
        )

    def close(self) -> None:
        """Let go of the job engine; the database stays open."""
        self._client.destroy()
