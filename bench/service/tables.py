"""Lists, admission, claims and sweeps on a database that years have filled: how long each takes at the median."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from datetime import timedelta

from sqlalchemy.orm import Session

from storage import open_database
from storage.jobs import requeue
from storage.jobs.queue import JobQueue
from storage.models import DEFAULT_WORKSPACE, JobStatus
from storage.repositories import DatasetRepository, JobRepository, jobs, schedules
from tests.support.filling import ALIVE, BEGIN, SCHEDULE, analyze, fill, moment

_TIMES = 15


def tables(url: str, *, count: int) -> Iterator[tuple[str, float]]:
    """Fill a database with ``count`` jobs, as many recordings and ten times as many events; give what each question takes, s."""
    database = open_database(url)
    database.migrate()
    queue = JobQueue(database)
    begun = time.perf_counter()
    fill(database, jobs=count, events=10, datasets=count)
    analyze(database)
    yield "filled", time.perf_counter() - begun
    for name, ask in _questions(queue, count).items():
        taken = []
        for turn in range(_TIMES):
            with database.sessions() as session:
                begun = time.perf_counter()
                ask(session, turn)
                taken.append(time.perf_counter() - begun)
                session.rollback()
        yield name, statistics.median(taken)
    queue.close()
    database.dispose()


def _questions(queue: JobQueue, count: int) -> dict[str, Callable[[Session, int], object]]:
    def own(session: Session) -> JobRepository:
        return JobRepository(session, DEFAULT_WORKSPACE)

    def admit(session: Session, _: int) -> object:
        return queue.enqueue(session, kind="validation", body={}, workspace_id=DEFAULT_WORKSPACE)

    waiting = [f"job_{100_000_000 + number}" for number in range(count - ALIVE, count, 2)]
    before = BEGIN - timedelta(days=1)
    return {
        "list of jobs": lambda session, _: own(session).page(limit=20),
        "of a kind that does not occur": lambda session, _: own(session).page(kind="acquisition", limit=20),
        "of a kind and status": lambda session, _: own(session).page(kind="simulation", status="failed", limit=20),
        "of a schedule": lambda session, _: own(session).page(schedule=SCHEDULE, status="cancelled", limit=20),
        "events of a job": lambda session, turn: own(session).events(f"job_{100_000_000 + 4 * turn}"),
        "list of recordings": lambda session, _: DatasetRepository(session, DEFAULT_WORKSPACE).page(limit=20),
        "newest recording of a name": lambda session, _: DatasetRepository(session, DEFAULT_WORKSPACE).newest("run 7"),
        "admission": admit,
        "beginning": lambda session, turn: jobs.begin(session, waiting[turn], worker="lab-0"),
        "end": lambda session, turn: jobs.finish(session, waiting[turn], status=JobStatus.CANCELLED),
        "claims": lambda session, _: requeue.claimed(session, "lab-0"),
        "what is overdue": lambda session, _: jobs.overdue(session),
        "what nobody carries": lambda session, _: requeue.uncarried(session),
        "unfinished of a schedule": lambda session, _: schedules.unfinished(session, SCHEDULE),
        "sweep, nothing old": lambda session, _: (jobs.forget(session, before=before), jobs.forget_events(session, before=before)),
        "sweep of 100 events": lambda session, _: jobs.forget_events(session, before=moment(count), limit=100),
        "sweep of one job": lambda session, _: jobs.forget(session, before=moment(count), limit=1),
    }  # fmt: skip
