"""How much a workspace may have: systems, schedules, webhooks, stored bytes, unfinished jobs, and how many of them at a time.

What is counted is counted under a lock on the workspace's row, so that two requests at once cannot both take the last place.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from sqlalchemy import func, select, update
from sqlalchemy.orm import Session

from storage.errors import NotFoundError, QuotaExceededError
from storage.models import Job, JobStatus, Schedule, System, Webhook, Workspace

#: The limits of a workspace that has none of its own.
DEFAULTS: Mapping[str, int] = MappingProxyType(
    {
        "systems": 10_000,
        "schedules": 10_000,
        "webhooks": 20,
        "stored_bytes": 100 * 2**30,
        "jobs": 1000,
        "running_jobs": 1000,
    }
)


def limits_of(workspace: Workspace) -> dict[str, int]:
    """Return every limit of a workspace."""
    return {**DEFAULTS, **(workspace.limits or {})}


def count_system(session: Session, workspace_id: str, size: int) -> None:
    """Count a system that was just added, and the bytes of its document; the caller's last statement, because it locks.

    Raises
    ------
    QuotaExceededError
        When there was no room for it.
    """
    workspace = _lock(session, workspace_id, more=size)
    limits = limits_of(workspace)
    _check("systems", limits, used=_systems(session, workspace_id) - 1, more=1)
    _check("stored_bytes", limits, used=workspace.stored_bytes - size, more=size)


def admit_schedule(session: Session, workspace_id: str) -> None:
    """Make sure that there is room for one more schedule; raise `QuotaExceededError` otherwise."""
    limits = limits_of(_lock(session, workspace_id))
    _check("schedules", limits, used=_schedules(session, workspace_id), more=1)


def admit_webhook(session: Session, workspace_id: str) -> None:
    """Make sure that there is room for one more webhook; raise `QuotaExceededError` otherwise."""
    limits = limits_of(_lock(session, workspace_id))
    _check("webhooks", limits, used=_webhooks(session, workspace_id), more=1)


def admit_job(session: Session, workspace_id: str) -> None:
    """Make sure that there is room for one more unfinished job; raise `QuotaExceededError` otherwise."""
    limits = limits_of(_lock(session, workspace_id))
    _check("jobs", limits, used=_jobs(session, workspace_id), more=1)


def may_run(session: Session, workspace_id: str) -> bool:
    """Tell whether one more job of a workspace may be computed now; where it has a limit of its own, under its lock."""
    if "running_jobs" not in (session.scalar(select(Workspace.limits).where(Workspace.id == workspace_id)) or {}):
        return True
    limits = limits_of(_lock(session, workspace_id))
    return running_jobs(session, workspace_id) < limits["running_jobs"]


def add_bytes(session: Session, workspace_id: str, count: int, *, within_quota: bool = True) -> None:
    """Count ``count`` more bytes (fewer when negative) as stored; the caller's last statement, because it locks.

    Raises
    ------
    QuotaExceededError
        When that is more than the workspace may store; not asked ``within_quota`` or when bytes are given back.
    """
    if count == 0:
        return
    workspace = _lock(session, workspace_id, more=count)
    if within_quota and count > 0:
        _check("stored_bytes", limits_of(workspace), used=workspace.stored_bytes - count, more=count)


def check_bytes(session: Session, workspace_id: str, more: int) -> None:
    """Make sure that there would be room for ``more`` bytes, without counting them: long work need not go on without.

    Raises
    ------
    QuotaExceededError
        When there is none.
    """
    workspace = session.get(Workspace, workspace_id, populate_existing=True)
    if workspace is None:
        raise NotFoundError("workspace", workspace_id)
    _check("stored_bytes", limits_of(workspace), used=workspace.stored_bytes, more=more)


def usage(session: Session, workspace: Workspace) -> dict[str, int]:
    """Return how much of each limit is used."""
    return {
        "systems": _systems(session, workspace.id),
        "schedules": _schedules(session, workspace.id),
        "webhooks": _webhooks(session, workspace.id),
        "stored_bytes": workspace.stored_bytes,
        "jobs": _jobs(session, workspace.id),
        "running_jobs": running_jobs(session, workspace.id),
    }


def _lock(session: Session, workspace_id: str, *, more: int = 0) -> Workspace:
    """Lock the workspace's row, on either database, by writing to it; return it as it then is."""
    workspace = session.scalar(
        update(Workspace)
        .where(Workspace.id == workspace_id)
        .values(stored_bytes=Workspace.stored_bytes + more)
        .returning(Workspace)
        .execution_options(synchronize_session=False, populate_existing=True)
    )
    if workspace is None:
        raise NotFoundError("workspace", workspace_id)
    return workspace


def _systems(session: Session, workspace_id: str) -> int:
    return _count(
        session,
        select(func.count())
        .select_from(System)
        .where(System.workspace_id == workspace_id, System.deleted_at.is_(None)),
    )


def _schedules(session: Session, workspace_id: str) -> int:
    return _count(session, select(func.count()).select_from(Schedule).where(Schedule.workspace_id == workspace_id))


def _webhooks(session: Session, workspace_id: str) -> int:
    return _count(session, select(func.count()).select_from(Webhook).where(Webhook.workspace_id == workspace_id))


def _jobs(session: Session, workspace_id: str) -> int:
    alive = Job.status.in_((JobStatus.QUEUED, JobStatus.RUNNING))
    return _count(session, select(func.count()).select_from(Job).where(Job.workspace_id == workspace_id, alive))


def running_jobs(session: Session, workspace_id: str) -> int:
    """Return how many jobs of a workspace are being computed by workers; what an agent does is not."""
    computed = (Job.status == JobStatus.RUNNING) & Job.ticket.is_not(None)
    return _count(session, select(func.count()).select_from(Job).where(Job.workspace_id == workspace_id, computed))


def _count(session: Session, question: Any) -> int:
    return int(session.scalar(question) or 0)


def _check(name: str, limits: Mapping[str, int], *, used: int, more: int) -> None:
    if used + more > limits[name]:
        raise QuotaExceededError(name, limit=limits[name], used=used)
