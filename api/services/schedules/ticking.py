"""The one tick of all schedules: whatever is due is dealt with, by one process of however many there are."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime

from sqlalchemy.orm import Session

from api.problems.exceptions import KNOWN, problem_of
from api.services.operation.app_context import Caller, Installation
from api.services.schedules import scheduled
from api.services.schedules.calendars import Plan, calendar, plan
from api.services.schedules.newest import current_body
from api.services.webhooks import alerts
from api.telemetry.logs import CURRENT_REQUEST
from storage.audit import ACTOR, Actor
from storage.errors import UNAVAILABLE
from storage.ids import new_id
from storage.models import RunOutcome, Schedule, ScheduleRun
from storage.repositories import JobRepository, schedules

INTERVAL = 1.0
"""s between two looks."""

#: The most instants, and the most waiting runs, that one tick deals with.
_BATCH = 100
#: The most runs of a schedule that wait for the job before them.
_MOST_WAITING = 100

_log = logging.getLogger(__name__)


def tick(service: Installation, *, now: datetime) -> int:
    """Deal with what is due; return how many instants and waiting runs that were.

    Raises
    ------
    storage.errors.UNAVAILABLE
        When the database does not answer.
    """
    with service.database.session() as session:
        due = schedules.due(session, now=now, limit=_BATCH)
    for row in due:
        assert row.next_at is not None
        steps = plan(calendar(row.cron, row.time_zone), policy=row.missed, due=row.next_at, now=now)
        _deal_with(service, row, row.next_at, steps)
    return len(due) + _go_on(service)


def _deal_with(service: Installation, row: Schedule, instant: datetime, steps: Plan) -> None:
    """Take an instant of a schedule and start its job, or write down why not."""

    def take(session: Session) -> bool:
        if not schedules.claim(session, row.id, instant=instant, next_at=steps.next_at):
            return False
        if steps.missed is not None:
            first, last = steps.missed
            detail = None if first == last else f"and all until {last.isoformat()}"
            schedules.add_run(session, row.id, due_at=first, outcome=RunOutcome.MISSED, detail=detail)
        return True

    run_at = steps.run
    if run_at is None:
        with service.database.session() as session:
            take(session)
        return

    def start(session: Session, submit: scheduled.Submit) -> None:
        if take(session) and not schedules.was_run(session, row.id, due_at=run_at):
            decide(session, row, submit, due_at=run_at)

    def refuse(session: Session, detail: str) -> None:
        if take(session):
            known = schedules.last_outcome(session, row.id) == RunOutcome.REFUSED
            run = schedules.add_run(session, row.id, due_at=run_at, outcome=RunOutcome.REFUSED, detail=detail)
            if not known:  # one alert tells of all that follow for the same reason
                alerts.on_refusal(session, row, run)

    _attempt(service, row, start, refuse)


def _go_on(service: Installation) -> int:
    """Start the runs whose predecessors have ended."""
    with service.database.session() as session:
        found = schedules.ready(session, limit=_BATCH)
    for run, row in found:
        _start_waiting(service, run, row)
    return len(found)


def _start_waiting(service: Installation, run: ScheduleRun, row: Schedule) -> None:
    def start(session: Session, submit: scheduled.Submit) -> None:
        free = schedules.lock(session, row.id) and not schedules.unfinished(session, row.id)
        if free and schedules.claim_run(session, run.id, outcome=RunOutcome.STARTED):
            schedules.attach(session, run.id, schedule_id=row.id, job_id=submit(session))

    def refuse(session: Session, detail: str) -> None:
        if schedules.claim_run(session, run.id, outcome=RunOutcome.REFUSED, detail=detail):
            session.refresh(run)
            alerts.on_refusal(session, row, run)

    _attempt(service, row, start, refuse)


def decide(session: Session, row: Schedule, submit: scheduled.Submit, *, due_at: datetime) -> ScheduleRun:
    """Start the job of a schedule that the caller has locked, or let it wait, or skip it, as its overlap policy says."""
    busy = schedules.unfinished(session, row.id)
    if busy and row.overlap == "skip":
        return schedules.add_run(
            session, row.id, due_at=due_at, outcome=RunOutcome.SKIPPED, detail=f"job {busy[0]} has not ended"
        )
    if row.overlap == "queue" and (ahead := schedules.waiting(session, row.id) or bool(busy)):
        full = ahead >= _MOST_WAITING
        return schedules.add_run(
            session,
            row.id,
            due_at=due_at,
            outcome=RunOutcome.SKIPPED if full else RunOutcome.WAITING,
            detail=f"{_MOST_WAITING} runs wait already" if full else None,
        )
    for job in busy:
        JobRepository(session, row.workspace_id).cancel(job)
    run = schedules.add_run(session, row.id, due_at=due_at, outcome=RunOutcome.STARTED)
    schedules.attach(session, run.id, schedule_id=row.id, job_id=submit(session))
    session.refresh(run)
    return run


def _attempt(
    service: Installation,
    row: Schedule,
    start: Callable[[Session, scheduled.Submit], None],
    refuse: Callable[[Session, str], None],
) -> None:
    """Prove that the job can be run and start it, in one transaction; where it cannot, write that down in another."""
    caller = Caller(principal=row.id, workspace=row.workspace_id, scopes=frozenset({"run"}), name=row.name)
    request_id = new_id("tick")
    with _acting(row.id, request_id), service.traces.schedule(row, request_id=request_id):
        try:
            submit = scheduled.prepare(service, caller, row.kind, current_body(service, row))
            with service.database.session() as session:
                start(session, submit)
        except UNAVAILABLE:
            raise
        except KNOWN as error:
            problem = problem_of(error)
            assert problem is not None
            _write(service, refuse, problem.detail)
        except Exception:  # noqa: BLE001 - what is wrong with one schedule must not stop all the others
            _log.exception("schedule %s cannot be run", row.id)
            _write(service, refuse, "the service failed on it; its log says where")


def _write(service: Installation, refuse: Callable[[Session, str], None], detail: str) -> None:
    with service.database.session() as session:
        refuse(session, detail)


@contextmanager
def _acting(schedule_id: str, request_id: str) -> Iterator[None]:
    """Let the audit log, the log and the job say that the schedule does it, and at which occasion."""
    acting, asking = ACTOR.set(Actor(principal=schedule_id, request_id=request_id)), CURRENT_REQUEST.set(request_id)
    try:
        yield
    finally:
        CURRENT_REQUEST.reset(asking)
        ACTOR.reset(acting)
