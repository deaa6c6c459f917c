"""Schedules as their users see them: made, changed, paused, triggered, deleted."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy.orm import Session

from api.problems.documents import Problem, at
from api.schemas.schedules import ScheduleRequest
from api.services.operation.app_context import Caller, Installation
from api.services.schedules import scheduled, ticking
from api.services.schedules.calendars import calendar
from api.services.schedules.newest import current_body, with_newest
from storage.clock import shared_now
from storage.models import RunOutcome, Schedule, ScheduleRun
from storage.models.base import utc_now
from storage.repositories import ScheduleRepository, schedules

_SHOWN = 5


def check(service: Installation, caller: Caller, request: ScheduleRequest) -> dict[str, Any]:
    """Prove that a schedule has instants and that its job can be run now; return what is kept of it.

    Raises
    ------
    Problem
        422 with the place of what is wrong.
    """
    calendar(request.cron, request.time_zone)
    document = request.model_dump(by_alias=True, exclude_unset=True)
    kind, body = document["job"]["kind"], document["job"]["body"]
    current = with_newest(service, caller.workspace, body, request.newest)
    with at("job", "body"):
        scheduled.prepare(service, caller, kind, current)
    return {
        "name": request.name,
        "cron": request.cron,
        "time_zone": request.time_zone,
        "kind": kind,
        "body": body,
        "overlap": request.overlap,
        "missed": request.missed,
        "newest": request.newest,
        **_rhythm(request.cron, request.time_zone, paused=request.paused, now=service.database.now()),
    }


def _rhythm(cron: str, time_zone: str, *, paused: bool, now: datetime) -> dict[str, Any]:
    return {"paused": paused, "next_at": None if paused else calendar(cron, time_zone).after(now)}


def create(session: Session, caller: Caller, values: dict[str, Any]) -> dict[str, Any]:
    """Keep a checked schedule."""
    return to_wire(ScheduleRepository(session, caller.workspace).create(**values))


def get(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return a schedule."""
    return to_wire(ScheduleRepository(session, caller.workspace).get(identifier))


def page(session: Session, caller: Caller, *, cursor: str | None, limit: int) -> dict[str, Any]:
    """Return one page of the schedules, newest first."""
    found = ScheduleRepository(session, caller.workspace).page(cursor=cursor, limit=limit)
    return {"items": [_head(row) for row in found.items], "next_cursor": found.next_cursor}


def update(
    session: Session, caller: Caller, identifier: str, values: dict[str, Any], *, expected_revision: int
) -> dict[str, Any]:
    """Replace a schedule by a checked one."""
    repository = ScheduleRepository(session, caller.workspace)
    return to_wire(repository.update(identifier, expected_revision=expected_revision, **values))


def delete(session: Session, caller: Caller, identifier: str, *, expected_revision: int) -> None:
    """Forget a schedule and its history."""
    ScheduleRepository(session, caller.workspace).delete(identifier, expected_revision=expected_revision)


def pause(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Let nothing be started; nothing happens when it is paused."""
    return _set_paused(session, caller, identifier, paused=True)


def resume(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Go on with the next instant: none is made up for."""
    return _set_paused(session, caller, identifier, paused=False)


def _set_paused(session: Session, caller: Caller, identifier: str, *, paused: bool) -> dict[str, Any]:
    repository = ScheduleRepository(session, caller.workspace)
    row = repository.get(identifier)
    if row.paused != paused:
        action = "pause" if paused else "resume"
        rhythm = _rhythm(row.cron, row.time_zone, paused=paused, now=shared_now(session))
        row = repository.update(identifier, expected_revision=None, action=action, **rhythm)
    return to_wire(row)


def prepare_trigger(service: Installation, caller: Caller, identifier: str) -> tuple[Schedule, scheduled.Submit]:
    """Return a schedule and what starts its job now."""
    with service.database.session() as session:
        row = ScheduleRepository(session, caller.workspace).get(identifier)
    return row, scheduled.prepare(service, caller, row.kind, current_body(service, row))


def trigger(session: Session, row: Schedule, submit: scheduled.Submit) -> dict[str, Any]:
    """Run the job now, whether it is due or paused.

    Raises
    ------
    Problem
        409 where the job before has not ended and the schedule then skips.
    """
    if not schedules.lock(session, row.id):
        raise Problem(409, "conflict", f"schedule {row.id!r} must exist, it was deleted meanwhile")
    run = ticking.decide(session, row, submit, due_at=shared_now(session))
    if run.outcome == RunOutcome.SKIPPED:
        raise Problem(409, "conflict", f"schedule {row.id!r} must be free to run: {run.detail}")
    return run_to_wire(run)


def runs(session: Session, caller: Caller, identifier: str, *, cursor: str | None, limit: int) -> dict[str, Any]:
    """Return one page of what became of a schedule's instants, newest first."""
    found = ScheduleRepository(session, caller.workspace).runs(identifier, cursor=cursor, limit=limit)
    return {"items": [run_to_wire(row) for row in found.items], "next_cursor": found.next_cursor}


def run_to_wire(row: ScheduleRun) -> dict[str, Any]:
    """Return what became of an instant."""
    return {
        "id": row.id,
        "due_at": row.due_at.isoformat(),
        "outcome": str(row.outcome),
        "job": row.job_id,
        "detail": row.detail,
        "created_at": row.created_at.isoformat(),
    }


def to_wire(row: Schedule) -> dict[str, Any]:
    """Return a schedule with its next instants."""
    return {**_head(row), "document": _document(row), "next_runs": [time.isoformat() for time in _next(row)]}


def _next(row: Schedule) -> list[datetime]:
    return [] if row.paused else calendar(row.cron, row.time_zone).following(utc_now(), _SHOWN)


def _document(row: Schedule) -> dict[str, Any]:
    return {
        "name": row.name,
        "cron": row.cron,
        "time_zone": row.time_zone,
        "job": {"kind": row.kind, "body": row.body},
        "overlap": row.overlap,
        "missed": row.missed,
        "paused": row.paused,
        "newest": row.newest,
    }


def _head(row: Schedule) -> dict[str, Any]:
    return {
        "id": row.id,
        "name": row.name,
        "revision": row.revision,
        "created_at": row.created_at.isoformat(),
        "kind": row.kind,
        "cron": row.cron,
        "time_zone": row.time_zone,
        "paused": row.paused,
        "next_at": row.next_at.isoformat() if row.next_at else None,
    }
