"""Schedules and their runs.

Whoever deals with an instant moves ``next_at`` on in the same transaction, provided that it still is that instant: of two
processes that find a schedule due, one does its work.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import CursorResult, delete, func, select, update
from sqlalchemy.orm import Session

from storage import quotas
from storage.ids import new_id
from storage.models import Job, JobStatus, RunOutcome, Schedule, ScheduleRun
from storage.pagination import Page, paginate
from storage.repositories.revised import RevisedRepository

#: Runs among which an instant that comes round again is looked for: of one each minute, those of a night.
_REMEMBERED = 500
_UNFINISHED = Job.status.in_((JobStatus.QUEUED, JobStatus.RUNNING))


class ScheduleRepository(RevisedRepository[Schedule]):
    """The schedules of one workspace; the jobs of one that is deleted stay, its history goes with it."""

    _row, _prefix, _name, _told_as = Schedule, "sch", "schedule", "schedule"

    def create(self, **values: Any) -> Schedule:
        """Keep a schedule; ``values`` are its columns from ``name`` to ``next_at``.

        Raises
        ------
        QuotaExceededError
            When there are too many.
        """
        quotas.admit_schedule(self._session, self._workspace_id)
        return self._add(**values)

    def runs(self, identifier: str, *, cursor: str | None = None, limit: int = 100) -> Page[ScheduleRun]:
        """Return what became of a schedule's instants, newest first."""
        self.get(identifier)
        rows = select(ScheduleRun).where(ScheduleRun.schedule_id == identifier)
        return paginate(self._session, rows, ScheduleRun, cursor=cursor, limit=limit)


def due(session: Session, *, now: datetime, limit: int) -> Sequence[Schedule]:
    """Return schedules, of whatever workspace, with an instant that has come."""
    return session.scalars(
        select(Schedule).where(Schedule.next_at <= now).order_by(Schedule.next_at).limit(limit)
    ).all()


def ready(session: Session, *, limit: int) -> Sequence[tuple[ScheduleRun, Schedule]]:
    """Return waiting runs whose schedule has no unfinished job (any more), the oldest first."""
    busy = select(Job.id).where(Job.schedule_id == Schedule.id, _UNFINISHED).exists()
    rows = (
        select(ScheduleRun, Schedule)
        .join(Schedule, Schedule.id == ScheduleRun.schedule_id)
        .where(ScheduleRun.outcome == RunOutcome.WAITING, Schedule.paused.is_(False), ~busy)
    )
    found = session.execute(rows.order_by(ScheduleRun.due_at, ScheduleRun.id).limit(limit))
    return [(run, schedule) for run, schedule in found]


def claim(session: Session, identifier: str, *, instant: datetime, next_at: datetime | None) -> bool:
    """Take an instant of a schedule, and lock it: False when another process has, or the schedule has changed."""
    taken = session.execute(
        update(Schedule)
        .where(Schedule.id == identifier, Schedule.next_at == instant)
        .values(next_at=next_at)
        .returning(Schedule.id)
        .execution_options(synchronize_session=False)
    )
    return taken.one_or_none() is not None


def lock(session: Session, identifier: str) -> bool:
    """Lock a schedule, so that nobody else decides about it; False when it is gone."""
    held = session.execute(
        update(Schedule)
        .where(Schedule.id == identifier)
        .values(revision=Schedule.revision)
        .returning(Schedule.id)
        .execution_options(synchronize_session=False)
    )
    return held.one_or_none() is not None


def claim_run(session: Session, identifier: str, *, outcome: RunOutcome, detail: str | None = None) -> bool:
    """Give a waiting run its outcome; False when another process has."""
    taken = session.execute(
        update(ScheduleRun)
        .where(ScheduleRun.id == identifier, ScheduleRun.outcome == RunOutcome.WAITING)
        .values(outcome=outcome, detail=detail)
        .returning(ScheduleRun.id)
        .execution_options(synchronize_session=False)
    )
    return taken.one_or_none() is not None


def add_run(
    session: Session, schedule_id: str, *, due_at: datetime, outcome: RunOutcome, detail: str | None = None
) -> ScheduleRun:
    """Write down what becomes of an instant."""
    run = ScheduleRun(id=new_id("run"), schedule_id=schedule_id, due_at=due_at, outcome=outcome, detail=detail)
    session.add(run)
    session.flush()
    return run


def was_run(session: Session, schedule_id: str, *, due_at: datetime) -> bool:
    """Tell whether an instant of a schedule was run, or waits to be; the caller has locked the schedule.

    A clock that was set back brings an instant round again.
    """
    newest = (
        select(ScheduleRun.due_at, ScheduleRun.outcome)
        .where(ScheduleRun.schedule_id == schedule_id)
        .order_by(ScheduleRun.created_at.desc(), ScheduleRun.id.desc())
        .limit(_REMEMBERED)
        .subquery()
    )
    was = newest.c.outcome.in_((RunOutcome.STARTED, RunOutcome.WAITING)) & (newest.c.due_at == due_at)
    return session.scalar(select(newest.c.due_at).where(was).limit(1)) is not None


def attach(session: Session, run_id: str, *, schedule_id: str, job_id: str) -> None:
    """Say that a job was started for a run."""
    session.execute(update(Job).where(Job.id == job_id).values(schedule_id=schedule_id))
    session.execute(update(ScheduleRun).where(ScheduleRun.id == run_id).values(job_id=job_id))


def unfinished(session: Session, schedule_id: str) -> Sequence[str]:
    """Return the jobs of a schedule that have not ended, the oldest first."""
    rows = select(Job.id).where(Job.schedule_id == schedule_id, _UNFINISHED)
    return session.scalars(rows.order_by(Job.created_at, Job.id)).all()


def waiting(session: Session, schedule_id: str) -> int:
    """Return how many runs of a schedule wait for the job before them."""
    rows = (
        select(func.count())
        .select_from(ScheduleRun)
        .where(ScheduleRun.schedule_id == schedule_id, ScheduleRun.outcome == RunOutcome.WAITING)
    )
    return int(session.scalar(rows) or 0)


def last_outcome(session: Session, schedule_id: str) -> str | None:
    """Return what became of the last instant that somebody dealt with."""
    rows = select(ScheduleRun.outcome).where(ScheduleRun.schedule_id == schedule_id)
    return session.scalar(rows.order_by(ScheduleRun.created_at.desc(), ScheduleRun.id.desc()).limit(1))


def forget(session: Session, *, before: datetime) -> int:
    """Delete runs written before a time; return how many."""
    result = session.execute(
        delete(ScheduleRun).where(ScheduleRun.created_at < before, ScheduleRun.outcome != RunOutcome.WAITING)
    )
    assert isinstance(result, CursorResult)
    return result.rowcount
