"""No list, count, claim or sweep reads a large table from end to end, whatever is asked for and does not occur.

The statements are those that the repositories issue; the tables are filled so far that their planners decide as with a million rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import timedelta

import pytest
from sqlalchemy.orm import Session

from storage import Database, open_database, quotas
from storage.blobs import forget_unused
from storage.imports import abandon
from storage.jobs import requeue
from storage.jobs.queue import JobQueue
from storage.models import DEFAULT_WORKSPACE, JobStatus, Workspace
from storage.repositories import CommentRepository, DatasetRepository, JobRepository, ResultRepository, jobs, schedules
from storage.repositories.lineage import LineageRepository
from tests.support.filling import ALIVE, BEGIN, SCHEDULE, analyze, fill, moment
from tests.support.plans import watched

JOBS = DATASETS = 20_000
LARGE = {"job", "job_event", "dataset", "comment"}
#: Rows read in vain by one statement (Postgres) and instructions (SQLite, some ten for a row that is looked at and some thousand for
#: the last page of a list): a twentieth of the table.
MOST = {"postgresql": JOBS // 20, "sqlite": 50_000}

ENDED, QUEUED, RUNNING = (f"job_{100_000_000 + number}" for number in (7, JOBS - ALIVE, JOBS - ALIVE + 1))
RECORDING = "ds_100000005"


@pytest.fixture(scope="module")
def filled(module_database_url: str) -> Iterator[Database]:
    database = open_database(module_database_url)
    fill(database, jobs=JOBS, events=5, datasets=DATASETS, comments=JOBS)
    yield database
    database.dispose()


@pytest.fixture(scope="module")
def queue(filled: Database) -> Iterator[JobQueue]:
    made = JobQueue(filled)
    yield made
    made.close()


def jobs_of(session: Session) -> JobRepository:
    return JobRepository(session, DEFAULT_WORKSPACE)


def comments_of(session: Session) -> CommentRepository:
    return CommentRepository(session, DEFAULT_WORKSPACE)


def far_down(session: Session) -> str | None:
    cursor = None
    for _ in range(3):
        cursor = jobs_of(session).page(cursor=cursor, limit=100).next_cursor
    return cursor


ASKED: dict[str, Callable[[Session], object]] = {
    "jobs": lambda session: jobs_of(session).page(),
    "jobs, further down": lambda session: jobs_of(session).page(cursor=far_down(session)),
    "jobs of a kind": lambda session: jobs_of(session).page(kind="validation"),
    "jobs of a kind that does not occur": lambda session: jobs_of(session).page(kind="acquisition"),
    "jobs that have failed": lambda session: jobs_of(session).page(status="failed"),
    "jobs that run": lambda session: jobs_of(session).page(status="running"),
    "jobs of a kind and status": lambda session: jobs_of(session).page(kind="simulation", status="failed"),
    "jobs of a kind and status that do not meet": lambda session: jobs_of(session).page(kind="validation", status="queued"),
    "jobs of a schedule": lambda session: jobs_of(session).page(schedule=SCHEDULE),
    "jobs of a schedule and status": lambda session: jobs_of(session).page(schedule=SCHEDULE, status="cancelled"),
    "jobs of a schedule that is none": lambda session: jobs_of(session).page(schedule="sch_gone"),
    "events": lambda session: jobs_of(session).events(ENDED),
    "events after one": lambda session: jobs_of(session).events(ENDED, after=3),
    "unfinished jobs of a schedule": lambda session: schedules.unfinished(session, SCHEDULE),
    "runs that may begin": lambda session: schedules.ready(session, limit=100),
    "admission": lambda session: jobs_of(session).create(kind="validation", body={}),
    "usage": lambda session: quotas.usage(session, session.get_one(Workspace, DEFAULT_WORKSPACE)),
    "a beginning": lambda session: jobs.begin(session, QUEUED, worker="lab-0"),
    "a report": lambda session: jobs.report(session, RUNNING, attempt=1, progress=0.5, message="half"),
    "an end": lambda session: jobs.finish(session, RUNNING, status=JobStatus.FAILED, attempt=1, error={}),
    "what is overdue": jobs.overdue,
    "numbers of what waits": jobs.waiting,
    "what nobody carries": requeue.uncarried,
    "claims": lambda session: requeue.claimed(session, "lab-0"),
    "holders of tickets": lambda session: requeue.holders(session, [ENDED, QUEUED]),
    "executors that are no workers": requeue.strangers,
    "jobs that were cut": requeue.joined,
    "old jobs": lambda session: jobs.forget(session, before=moment(5), limit=3),
    "no old jobs": lambda session: jobs.forget(session, before=BEGIN - timedelta(days=1)),
    "old events": lambda session: jobs.forget_events(session, before=moment(5), limit=10),
    "no old events": lambda session: jobs.forget_events(session, before=BEGIN - timedelta(days=1)),
    "unused blobs": lambda session: forget_unused(session, before=moment(5)),
    "recordings": lambda session: DatasetRepository(session, DEFAULT_WORKSPACE).page(),
    "a recording": lambda session: DatasetRepository(session, DEFAULT_WORKSPACE).get(RECORDING),
    "a recording that goes": lambda session: DatasetRepository(session, DEFAULT_WORKSPACE).delete(RECORDING),
    "the newest recording of a name": lambda session: DatasetRepository(session, DEFAULT_WORKSPACE).newest("run 7"),
    "the newest recording of no name": lambda session: DatasetRepository(session, DEFAULT_WORKSPACE).newest("none"),
    "an import that ends": lambda session: abandon(session, ENDED, {}),
    "kept answers of a kind": lambda session: ResultRepository(session, DEFAULT_WORKSPACE).page(kind="simulation"),
    "comments": lambda session: comments_of(session).page(),
    "comments, further down": lambda session: comments_of(session).page(cursor=comments_of(session).page().next_cursor),
    "comments on a job": lambda session: comments_of(session).page(subject=ENDED),
    "comments on a recording": lambda session: comments_of(session).page(subject="ds_100000006"),
    "comments on what has none": lambda session: comments_of(session).page(subject="res_100000002"),
    "comments on what is not there": lambda session: comments_of(session).page(subject="sys_gone"),
    "a comment that is written": lambda session: comments_of(session).create(subject=ENDED, author_id="key_1", author_name="someone", text="said"),
    "a comment that goes": lambda session: comments_of(session).delete("com_100000006"),
    "lineage": lambda session: LineageRepository(session, DEFAULT_WORKSPACE).graph(RECORDING),
    "lineage of a job": lambda session: LineageRepository(session, DEFAULT_WORKSPACE).graph(ENDED),
}  # fmt: skip


def asked(database: Database, ask: Callable[[Session], object]) -> None:
    """Ask, and take back whatever that changed."""
    with database.sessions() as session:
        ask(session)
        session.rollback()


@pytest.mark.parametrize("counted", [False, True], ids=["as filled", "analyzed"])
def test_no_large_table_is_read_from_end_to_end(filled: Database, queue: JobQueue, counted: bool) -> None:
    dialect = filled.engine.dialect.name
    if dialect == "postgresql" or counted:  # Postgres counts by itself after a while, SQLite never
        analyze(filled)
    questions = ASKED | {"jobs put aside": queue.release}
    told = []
    for name, ask in questions.items():
        with watched(filled) as watch:
            asked(filled, ask)
        assert watch.plans, name
        told += [
            f"{name}: {', '.join(plan.scanned) or f'{plan.cost} looked at'}: {plan.statement}"
            for plan in watch.plans
            if plan.scanned & LARGE or plan.cost > MOST[dialect]
        ]
    assert not told, "\n".join(told)


def test_a_statement_without_an_index_is_found_out(filled: Database) -> None:
    analyze(filled)
    with watched(filled) as watch, filled.sessions() as session:
        session.execute(jobs.select(jobs.Job.id).where(jobs.Job.message == "never")).all()
    (plan,) = watch.plans
    assert plan.scanned == {"job"}
    assert plan.cost > MOST[filled.engine.dialect.name]
