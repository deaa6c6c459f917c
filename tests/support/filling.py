"""Fills a database with as many jobs, events and recordings as years bring, by one statement for each table.

Jobs are of `KINDS` in turn; all but the newest `ALIVE` have ended, every fourth with a kept answer. Every hundredth is schedule `SCHEDULE`'s, every
five-hundredth the part of another. Each recording was read by a job.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from sqlalchemy import Connection, text

from storage import Database
from storage.models import DEFAULT_WORKSPACE

KINDS = ("optimization", "identification", "validation", "simulation")
ALIVE = 100
SCHEDULE = "sch_nightly"
#: When the first one was made; each further one a second later.
BEGIN = datetime(2026, 1, 1, tzinfo=UTC)

_NUMBERS = "WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n WHERE i + 1 < {count}) "

_JOBS = """
INSERT INTO job (result_id, parent_id, part, id, workspace_id, kind, status, progress, message, body, attempts, last_event, schedule_id, round, priority,
                 paused, created_at, started_at, finished_at)
{numbers}
SELECT CASE WHEN i % 4 = 2 AND i < {ended} THEN 'res_' || (100000000 + i) END,
       CASE WHEN i % 500 = 1 THEN 'job_' || (100000000 + i - 1) END, CASE WHEN i % 500 = 1 THEN 0 END,
       'job_' || (100000000 + i), '{workspace}',
       CASE i % 4 WHEN 0 THEN '{kinds[0]}' WHEN 1 THEN '{kinds[1]}' WHEN 2 THEN '{kinds[2]}' ELSE '{kinds[3]}' END,
       CASE WHEN i >= {ended} THEN CASE i % 2 WHEN 0 THEN 'queued' ELSE 'running' END
            ELSE CASE i % 10 WHEN 0 THEN 'failed' WHEN 1 THEN 'cancelled' ELSE 'succeeded' END END,
       0, '', '{{}}', 1, {events}, CASE WHEN i % 100 = 0 THEN '{schedule}' END, 1, 2, false, {time}, {time},
       CASE WHEN i < {ended} THEN {time} END
FROM n
"""
_RESULTS = """
INSERT INTO result (id, workspace_id, kind, body, versions, created_at)
{numbers}
SELECT 'res_' || (100000000 + i), '{workspace}', '{kinds[2]}', '{{}}', '{{}}', {time} FROM n WHERE i % 4 = 2 AND i < {ended}
"""
_EVENTS = """
INSERT INTO job_event (job_id, id, type, payload, at)
{numbers}
SELECT 'job_' || (100000000 + i / {events}), 1 + i % {events}, CASE i % {events} WHEN 0 THEN 'status' ELSE 'progress' END,
       '{{}}', {event_time}
FROM n
"""
_DATASETS = """
INSERT INTO dataset (id, workspace_id, name, format, status, channels, job_id, commits, sample_bytes, created_at)
{numbers}
SELECT 'ds_' || (100000000 + i), '{workspace}', 'run ' || (i % 1000), 'raw',
       CASE i % 50 WHEN 0 THEN 'failed' ELSE 'ready' END, '[]', 'job_' || (100000000 + i), 1, 0, {time}
FROM n
"""
_COMMENTS = """
INSERT INTO comment (id, workspace_id, job_id, dataset_id, author_id, author_name, text, created_at)
{numbers}
SELECT 'com_' || (100000000 + i), '{workspace}', CASE WHEN i % 2 = 1 THEN 'job_' || (100000000 + i) END,
       CASE WHEN i % 2 = 0 THEN 'ds_' || (100000000 + i) END, 'key_1', 'someone', 'said', {time}
FROM n
"""


def fill(database: Database, *, jobs: int, events: int, datasets: int, comments: int = 0) -> None:
    """Fill the tables of a migrated database; ``events`` is the number for each job, ``comments`` are on jobs and recordings in turn."""
    with database.engine.begin() as connection:
        spread = {"workspace": DEFAULT_WORKSPACE, "kinds": KINDS, "schedule": SCHEDULE, "events": events}
        spread |= {
            "ended": jobs - ALIVE,
            "time": _time(connection, "i"),
            "event_time": _time(connection, f"(i / {events})"),
        }
        filled = [(_RESULTS, jobs), (_JOBS, jobs), (_EVENTS, jobs * events), (_DATASETS, datasets)]
        for statement, count in [*filled, *([(_COMMENTS, comments)] if comments else [])]:
            numbers = _NUMBERS.format(count=count)
            connection.execute(text(statement.format(numbers=numbers, **spread).replace(":", "\\:")))


def analyze(database: Database) -> None:
    """Let the database count what is in its tables, as Postgres does by itself after a while."""
    with database.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        connection.execute(text("ANALYZE"))


def moment(number: int) -> datetime:
    """Return when job or recording ``number`` was made."""
    return BEGIN + timedelta(seconds=number)


def _time(connection: Connection, seconds: str) -> str:
    if connection.dialect.name == "sqlite":
        return f"strftime('%Y-%m-%d %H:%M:%f000', '{BEGIN:%Y-%m-%d %H:%M:%S}', '+' || {seconds} || ' seconds')"
    return f"timestamptz '{BEGIN.isoformat()}' + {seconds} * interval '1 second'"
