"""How long a job may take: its own limit, and the deadline by which it must have ended."""

from __future__ import annotations

from datetime import datetime, timedelta

from storage.models import Job


def overdue_detail(job: Job) -> str:
    """Return the sentence for a job that did not end in time."""
    if job.time_limit is not None and (job.deadline is None or _limit_ends_first(job)):
        return f"the job must be computed within its time_limit of {job.time_limit:g} s, got one that needs longer"
    return f"the job must end before its deadline {job.deadline}, got one that does not"


def _limit_ends_first(job: Job) -> bool:
    assert job.time_limit is not None
    assert job.deadline is not None
    return job.started_at is not None and job.started_at + timedelta(seconds=job.time_limit) < job.deadline


def time_left(job: Job, *, now: datetime) -> float | None:
    """Return how long (s) a job that has begun may still take; None without an end."""
    ends = []
    if job.time_limit is not None:
        assert job.started_at is not None
        ends.append(job.time_limit - (now - job.started_at).total_seconds())
    if job.deadline is not None:
        ends.append((job.deadline - now).total_seconds())
    return min(ends) if ends else None
