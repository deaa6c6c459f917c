"""Long work: what was asked for, how far it is, what came out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy.orm import Session

from api.problems.documents import Problem, invalid
from api.schemas.queue import QueueDocument
from api.services.operation.app_context import Caller, Installation
from api.telemetry import tracing
from storage.models import Job, JobEvent, JobStatus, Priority
from storage.models.base import utc_now
from storage.pagination import Narrowing
from storage.repositories import JobRepository, ResultRepository


def job_to_wire(job: Job) -> dict[str, Any]:
    """Return a job as the contract has it."""
    return {
        "id": job.id,
        "kind": job.kind,
        "status": str(job.status),
        "progress": job.progress,
        "message": job.message or _waiting(job),
        "created_at": job.created_at.isoformat(),
        "started_at": job.started_at.isoformat() if job.started_at else None,
        "finished_at": job.finished_at.isoformat() if job.finished_at else None,
        "seconds": _seconds(job),
        "result": f"/v1/jobs/{job.id}/result" if job.result_id else None,
        "error": job.error,
        "paused": job.paused,
        "priority": Priority(job.priority).name.lower(),
        "time_limit": job.time_limit,
        "deadline": job.deadline.isoformat() if job.deadline else None,
        "attempts": job.attempts,
        "schedule": job.schedule_id,
        "system": job.body.get("system_reference"),
        "warnings": job.body.get("warnings", []),
    }


def _waiting(job: Job) -> str:
    """Return what a job without a message of its own waits for."""
    if job.status != JobStatus.QUEUED:
        return ""
    return "paused: it waits until it is resumed" if job.paused else "waits for a free worker"


def _seconds(job: Job) -> float | None:
    """Return how long a job took, s; None before its end."""
    if job.started_at is None or job.finished_at is None:
        return None
    return max((job.finished_at - job.started_at).total_seconds(), 0.0)


def get(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return a job."""
    return job_to_wire(JobRepository(session, caller.workspace).get(identifier))


def page(
    session: Session,
    caller: Caller,
    *,
    kind: str | None,
    status: str | None,
    schedule: str | None,
    narrowing: Narrowing,
    cursor: str | None,
    limit: int,
) -> dict[str, Any]:
    """Return one page of the jobs, newest first."""
    found = JobRepository(session, caller.workspace).page(
        kind=kind, status=status, schedule=schedule, narrowing=narrowing, cursor=cursor, limit=limit
    )
    return {"items": [job_to_wire(job) for job in found.items], "next_cursor": found.next_cursor}


def result(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return what came out; 409 for a job that has nothing (yet)."""
    results = ResultRepository(session, caller.workspace)
    return results.body(results.get(result_of(JobRepository(session, caller.workspace).get(identifier))))


def result_of(job: Job) -> str:
    """Return the id of a job's result; 409 for a job that has nothing (yet)."""
    if job.result_id is None:
        raise Problem(
            409,
            "no-result",
            f"job {job.id!r} must have succeeded to have a result, or have been a search with a best point when it was cancelled; it is {job.status}",
        )
    return job.result_id


def request(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return what was asked for, the system written out as it was then; 409 for a job that nobody asked for in words."""
    job = JobRepository(session, caller.workspace).get(identifier)
    asked = job.body.get("request")
    if not isinstance(asked, dict):
        raise Problem(409, "no-request", f"job {identifier!r} must come from a request of its own, it is {job.kind}")
    return asked


def cancel(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Stop a job; one that has ended already stays as it is."""
    return job_to_wire(JobRepository(session, caller.workspace).cancel(identifier))


def pause(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Stop a job where it is, until it is resumed; 409 for one that has ended."""
    return job_to_wire(JobRepository(session, caller.workspace).pause(identifier))


def resume(service: Installation, session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Let a paused job go on; 409 for one that has ended."""
    return job_to_wire(service.queue.resume(session, caller.workspace, identifier))


def enqueue(
    service: Installation,
    session: Session,
    caller: Caller,
    *,
    kind: str,
    body: dict[str, Any],
    queue: QueueDocument | None,
) -> dict[str, Any]:
    """Write a job down in the caller's transaction; what it says about the queue is no part of what is computed."""
    wanted = queue or QueueDocument()
    if wanted.deadline is not None and wanted.deadline <= utc_now():
        raise invalid(f"deadline must lie in the future, got {wanted.deadline.isoformat()}", "queue", "deadline")
    job = service.queue.enqueue(
        session,
        kind=kind,
        body=body,
        workspace_id=caller.workspace,
        priority=Priority[wanted.priority.upper()],
        time_limit=wanted.time_limit,
        deadline=wanted.deadline,
        traceparent=tracing.traceparent(),
    )
    return job_to_wire(job)


def events(session: Session, caller: Caller, identifier: str, *, after: int) -> Sequence[JobEvent]:
    """Return the events of a job after the one with this id."""
    return JobRepository(session, caller.workspace).events(identifier, after=after)


def is_final(status: str) -> bool:
    """Return whether nothing happens any more after this status."""
    return JobStatus(status).final
