"""Databases as earlier versions left them are brought up to date with everything in them.

``databases/0003.sql`` is what ``sqlite3.Connection.iterdump`` wrote of a SQLite database of that time, the job engine's tables among
them; those of every revision, on both databases, are made as `tests.support.old_databases` says.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import inspect, select

from storage import Database, migrations, open_database
from storage.migrations.filter import is_ours
from storage.models import DEFAULT_WORKSPACE, Base, Job, Result, Schedule, ScheduleRun, System, Workspace
from storage.repositories import DatasetRepository, ResultRepository, SystemRepository, authenticate
from tests.support.old_databases import KEY, make, revisions

DUMP = Path(__file__).parent / "databases" / "0003.sql"


@pytest.fixture
def dumped(tmp_path) -> Iterator[Database]:
    path = tmp_path / "old.db"
    connection = sqlite3.connect(path)
    connection.executescript(DUMP.read_text(encoding="utf-8"))
    connection.close()
    opened = open_database(f"sqlite:///{path}")
    yield opened
    opened.dispose()


@pytest.fixture
def empty(empty_database_url) -> Iterator[Database]:
    opened = open_database(empty_database_url)
    yield opened
    opened.dispose()


def test_a_database_that_was_dumped_then_is_brought_up_to_date(dumped) -> None:
    assert not dumped.is_current()
    dumped.migrate()
    assert dumped.is_current()
    holds_what_it_held(dumped, scheduled=True)
    has_the_tables_of_a_new_one(dumped)


@pytest.mark.parametrize("revision", revisions())
def test_a_database_of_any_revision_is_brought_up_to_date(empty, revision) -> None:
    make(empty, revision)
    migrations.upgrade_tables(empty.engine)
    holds_what_it_held(empty, scheduled=revision >= "0003")
    has_the_tables_of_a_new_one(empty)


def test_the_oldest_database_gets_the_tables_of_the_job_engine_too(empty) -> None:
    make(empty, revisions()[0])
    assert not empty.is_current()
    empty.migrate()
    assert empty.is_current()
    holds_what_it_held(empty, scheduled=False)
    with empty.session() as session:  # counted by a migration
        assert session.get_one(Workspace, DEFAULT_WORKSPACE).stored_bytes > 40 * 8


def holds_what_it_held(database: Database, *, scheduled: bool) -> None:
    with database.session() as session:
        (system,) = session.scalars(select(System))
        documents = SystemRepository(session, DEFAULT_WORKSPACE)
        assert documents.get(system.id).document["parameters"]["k"] == {"value": 3}
        assert documents.get(system.id, revision=1).document["parameters"]["k"] == {"value": 2}

        (dataset,) = DatasetRepository(session, DEFAULT_WORKSPACE).page().items
        samples = DatasetRepository(session, DEFAULT_WORKSPACE).read_channel(dataset.id, "y")
        assert samples.tolist() == list(range(1, 40, 2))  # 0 ... 39, two channels in turn
        sent = b"".join(DatasetRepository(session, DEFAULT_WORKSPACE).original(dataset.id))
        assert np.frombuffer(sent).tolist() == list(range(40))

        (result,) = session.scalars(select(Result))
        body = ResultRepository(session, DEFAULT_WORKSPACE).body(result)
        assert body["parameters"] == {"k": 3.0}
        np.testing.assert_array_equal(body["y"], np.sin(np.arange(20) / 3))

        jobs = {job.status: job for job in session.scalars(select(Job))}
        assert set(jobs) == {"succeeded", "queued"}
        assert jobs["succeeded"].result_id == result.id

        assert [(row.cron, row.paused) for row in session.scalars(select(Schedule))] == [
            ("30 2 * * *", True)
        ] * scheduled
        assert session.scalars(select(ScheduleRun.outcome)).all() == ["skipped"] * scheduled

        key = authenticate(session, KEY)
        assert key is not None
        assert key.scopes == ["admin"]


def has_the_tables_of_a_new_one(database: Database) -> None:
    assert set(Base.metadata.tables) <= set(inspect(database.engine).get_table_names())
    with database.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"include_name": is_ours, "compare_type": True})
        assert compare_metadata(context, Base.metadata) == []
