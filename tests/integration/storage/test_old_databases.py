"""Databases as earlier versions left them are brought up to date with everything in them.

``databases/<revision>.sql`` is what ``sqlite3.Connection.iterdump`` wrote of a SQLite database at that revision of the
migrations: a system with two revisions, a recording, a finished job with a result and one that waits, a schedule that has run, a key.
"""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import select

from storage import open_database
from storage.models import DEFAULT_WORKSPACE, Job, Result, Schedule, ScheduleRun, System
from storage.repositories import DatasetRepository, ResultRepository, SystemRepository, authenticate

OLD = sorted((Path(__file__).parent / "databases").glob("*.sql"))


@pytest.fixture(params=OLD, ids=lambda path: path.stem)
def old(request, tmp_path):
    path = tmp_path / "old.db"
    connection = sqlite3.connect(path)
    connection.executescript(request.param.read_text(encoding="utf-8"))
    connection.close()
    opened = open_database(f"sqlite:///{path}")
    yield opened
    opened.dispose()


def test_an_old_database_is_brought_up_to_date_with_what_is_in_it(old) -> None:
    assert not old.is_current()
    old.migrate()
    assert old.is_current()
    with old.session() as session:
        (system,) = session.scalars(select(System))
        documents = SystemRepository(session, DEFAULT_WORKSPACE)
        assert documents.get(system.id).document["parameters"]["k"] == {"value": 3}
        assert documents.get(system.id, revision=1).document["parameters"]["k"] == {"value": 2}

        (dataset,) = DatasetRepository(session, DEFAULT_WORKSPACE).page().items
        samples = DatasetRepository(session, DEFAULT_WORKSPACE).read_channel(dataset.id, "y")
        assert samples.tolist() == list(range(1, 40, 2))  # 0 ... 39, two channels in turn

        (result,) = session.scalars(select(Result))
        body = ResultRepository(session, DEFAULT_WORKSPACE).body(result)
        assert body["parameters"] == {"k": 3.0}
        np.testing.assert_array_equal(body["y"], np.sin(np.arange(20) / 3))

        jobs = {job.status: job for job in session.scalars(select(Job))}
        assert set(jobs) == {"succeeded", "queued"}
        assert jobs["succeeded"].result_id == result.id

        (schedule,) = session.scalars(select(Schedule))
        assert (schedule.cron, schedule.paused) == ("30 2 * * *", True)
        assert session.scalars(select(ScheduleRun.outcome)).all() == ["skipped"]

        key = authenticate(session, "st_the_key_of_an_old_installation")
        assert key is not None
        assert key.scopes == ["admin"]


def test_a_migrated_old_database_has_the_tables_of_a_new_one(old, sqlite_template) -> None:
    old.migrate()
    with sqlite3.connect(sqlite_template) as new, sqlite3.connect(old.engine.url.database) as migrated:
        assert columns(migrated) == columns(new)


def columns(connection: sqlite3.Connection) -> dict[str, set[str]]:
    names = [name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
    return {name: {row[1] for row in connection.execute(f"PRAGMA table_info('{name}')")} for name in names}
